"""OpenFOAM's pimpleFoam as wind solver, where it is installed: cases, their solution, and its result as wind."""

from gslcosim.flow.openfoam.case import FoamCase, write_case
from gslcosim.flow.openfoam.installation import Installation, find_installation
from gslcosim.flow.openfoam.solve import read_wind, run_case, solve_wind_openfoam

__all__ = [
    "FoamCase",
    "Installation",
    "find_installation",
    "read_wind",
    "run_case",
    "solve_wind_openfoam",
    "write_case",
]
