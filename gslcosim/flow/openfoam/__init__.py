"""Wind by OpenFOAM's pimpleFoam, where it is installed: rooms as cases, their solution, and its result as wind."""

from gslcosim.flow.openfoam.case import FoamCase, write_case
from gslcosim.flow.openfoam.installation import Installation, find_installation
from gslcosim.flow.openfoam.result import read_wind
from gslcosim.flow.openfoam.run import run_case
from gslcosim.flow.openfoam.solve import solve_wind_openfoam

__all__ = [
    "FoamCase",
    "Installation",
    "find_installation",
    "read_wind",
    "run_case",
    "solve_wind_openfoam",
    "write_case",
]
