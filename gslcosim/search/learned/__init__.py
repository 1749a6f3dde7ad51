"""What learned methods share: observations as vectors, actions as commands, and policies that numpy alone evaluates."""
