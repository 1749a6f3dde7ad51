"""Trainings: from a train file to a policy, with checkpoints, curves and evaluation flights."""
