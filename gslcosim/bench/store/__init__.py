"""Storage of trial rows: appended as they come, read back whole, written as tables."""
