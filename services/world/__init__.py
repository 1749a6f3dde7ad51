"""The world process."""
