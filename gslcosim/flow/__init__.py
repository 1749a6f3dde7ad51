"""Offline wind: incompressible flow on a staggered grid, from a room's geometry to velocities at cell centres."""

from gslcosim.errors import FlowError
from gslcosim.flow.inflow import Schedule, log_profile, parabolic_profile
from gslcosim.flow.patches import Inlet, MovingWall, Open, Outlet, Patch, SlipWall
from gslcosim.flow.solve import WindReport, solve_wind, solve_wind_report

__all__ = [
    "FlowError",
    "Inlet",
    "MovingWall",
    "Open",
    "Outlet",
    "Patch",
    "Schedule",
    "SlipWall",
    "WindReport",
    "log_profile",
    "parabolic_profile",
    "solve_wind",
    "solve_wind_report",
]
