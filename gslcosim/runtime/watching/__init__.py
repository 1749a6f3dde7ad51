"""Flights that others of the same user look at while they go on: `gslcosim ps`, `top` and `stop`."""
