"""Turbulence of the air: its strength in a room, large eddies that all share, and what is inside a filament."""
