"""OpenFOAM's pimpleFoam as wind solver, where it is installed: cases, their solution, and its result as wind."""

from gslcosim_formats.openfoam.case import FoamCase, write_case
from gslcosim_formats.openfoam.solve import Installation, find_installation, read_wind, run_case, solve_wind_openfoam

__all__ = [
    "FoamCase",
    "Installation",
    "find_installation",
    "read_wind",
    "run_case",
    "solve_wind_openfoam",
    "write_case",
]
