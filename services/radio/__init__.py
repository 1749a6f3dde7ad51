"""The radio process."""
