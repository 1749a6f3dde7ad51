"""Paths of vehicles: free space, routes through it, legs, and the trajectories along them."""
