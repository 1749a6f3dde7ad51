"""Figures of one flight: pure functions of its track, its declarations, its belief, and the truth."""
