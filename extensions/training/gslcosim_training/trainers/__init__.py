"""Trainers of policies: each learns in rounds, can be interrupted between two of them, and ends with a policy."""
