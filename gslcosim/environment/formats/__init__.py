"""Formats of other programs for environments and winds: readers, writers and pictures.

`export` writes; `environment_folders` reads environments, `wind_files` reads winds, `picture` draws.
"""
