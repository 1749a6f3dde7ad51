"""Paths through the free cells of an environment: shortest ones for the referee, and planned ones for vehicles."""
