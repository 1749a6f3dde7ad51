"""Environments from the user's own geometry: surfaces from files, voxels between them, openings, leaks.

`solid_geometry` makes the environment, `mesh_formats` reads a file.
"""
