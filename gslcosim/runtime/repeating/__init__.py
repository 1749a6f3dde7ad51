"""Runs flown again from what they have left: as they were, or another way from some tick on."""
