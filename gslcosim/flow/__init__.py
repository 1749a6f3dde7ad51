"""Offline wind: incompressible flow on a staggered grid, from a room's geometry to velocities at cell centres."""

from gslcosim.errors import FlowError
from gslcosim.flow.patches import Inlet, MovingWall, Outlet, Patch, SlipWall
from gslcosim.flow.solve import WindReport, solve_wind, solve_wind_report

__all__ = [
    "FlowError",
    "Inlet",
    "MovingWall",
    "Outlet",
    "Patch",
    "SlipWall",
    "WindReport",
    "solve_wind",
    "solve_wind_report",
]
