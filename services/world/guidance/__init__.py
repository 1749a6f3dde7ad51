"""Guidance: from an agent's command to the reference that a vehicle's control follows."""
