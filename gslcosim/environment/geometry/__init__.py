"""Environments from the user's own geometry: surfaces from files, voxels between them, openings, leaks.

From outside: `solid_room` makes the room, `mesh_formats` reads a file.
"""
