"""The fields process."""
