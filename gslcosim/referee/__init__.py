"""Judges a run: who reached the source, how well, and when it is over; `core.RefereeCore` is the participant."""
