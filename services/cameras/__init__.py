"""The cameras process."""
