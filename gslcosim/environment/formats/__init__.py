"""Formats of other programs for environments and winds: readers, writers and pictures.

From outside: `exporting` writes, `gaden`, `gsl_bench` and `grid_room` read rooms, `wind_files` reads winds,
`picture` draws.
"""
