"""The sensing process."""
