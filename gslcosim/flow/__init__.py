"""Wind solvers: incompressible flow on a staggered grid, from a geometry to velocities at cell centres."""

from gslcosim.base.errors import FlowError
from gslcosim.flow.convergence import ConvergenceResult, WindowCheck
from gslcosim.flow.patches import (
    Inlet,
    MovingWall,
    Open,
    Outlet,
    Patch,
    Schedule,
    SlipWall,
    log_profile,
)
from gslcosim.flow.report import WindReport
from gslcosim.flow.solve import solve_wind, solve_wind_report

__all__ = [
    "ConvergenceResult",
    "FlowError",
    "Inlet",
    "MovingWall",
    "Open",
    "Outlet",
    "Patch",
    "Schedule",
    "SlipWall",
    "WindReport",
    "WindowCheck",
    "log_profile",
    "solve_wind",
    "solve_wind_report",
]
