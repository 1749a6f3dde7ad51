"""Vehicles of my own."""
