"""Metrics of one run: pure functions of its track, declarations, belief and the truth."""
