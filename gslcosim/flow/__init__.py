"""Offline wind: incompressible flow on a staggered grid, from a room's geometry to velocities at cell centres."""

from gslcosim.errors import FlowError
from gslcosim.flow.plot import plot_history
from gslcosim.flow.report import WindReport
from gslcosim.flow.settling import Settling, WindowCheck
from gslcosim.flow.solve import solve_wind, solve_wind_report
from gslcosim.flow.walls.inflow import Schedule, log_profile, parabolic_profile
from gslcosim.flow.walls.patches import Inlet, MovingWall, Open, Outlet, Patch, SlipWall

__all__ = [
    "FlowError",
    "Inlet",
    "MovingWall",
    "Open",
    "Outlet",
    "Patch",
    "Schedule",
    "Settling",
    "SlipWall",
    "WindReport",
    "WindowCheck",
    "log_profile",
    "parabolic_profile",
    "plot_history",
    "solve_wind",
    "solve_wind_report",
]
