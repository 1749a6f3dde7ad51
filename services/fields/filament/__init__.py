"""Filament model: release, advection, dispersion, walls, buoyancy and the downwash of rotors.

From outside: `plume.FilamentPlume`; the rest is its parts.
"""
