"""Formats of other programs for environments and winds: readers, writers and pictures.

`export` writes; `gaden`, `gsl_bench` and `occupancy_import` read environments, `wind_files` reads winds, `picture`
draws.
"""
