"""Paths and trajectories: legs through free space, and the polynomials that are flown along them."""
