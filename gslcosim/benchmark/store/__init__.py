"""Rows of trials on disk: appended as they come, read back whole, written as tables."""
