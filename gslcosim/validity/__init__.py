"""Validity of runs: findings for and against their figures, and the conduct of agents that they are made of."""
