"""What learned methods share: observations as vectors, actions as commands."""
