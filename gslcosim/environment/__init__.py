"""Environments: grids, occupancy, layouts, wind frames, and the folder that holds them."""
