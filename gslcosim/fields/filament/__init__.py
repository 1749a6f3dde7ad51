"""The filament model: release, advection, dispersion, walls, buoyancy, rotors' downwash.

From outside: `plume.FilamentPlume`; the rest is its parts.
"""
