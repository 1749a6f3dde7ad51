"""Paths through the free cells of a room: shortest ones, which judge flights, and planned ones, which are flown."""
