"""Estimation of sources from fixed sensors: responses to a source, backgrounds, events, and position and rate."""
