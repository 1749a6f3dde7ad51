"""Planned geometry of an environment: its air, solids and openings, the shell around it, and errors of the plan."""

from dataclasses import dataclass

from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Box, Light, Opening

LAYOUT_PATH = "environment.layout"
# More cells than this would not fit into the memory of a common machine together with the solver's fields.
MAX_CELLS = 200_000_000


@dataclass(frozen=True, kw_only=True)
class GeometryPlan:
    """A room on paper: where its air, its solids and its openings are.

    `grid` covers exactly the air, from the corner (0, 0, 0) to the layout's `size_m`; walls, floor and ceiling lie
    outside it. Openings are whole cells; walls are closed behind them, so that no vehicle leaves the room.
    `notices` are sentences on what was done differently from what the layout says.
    """

    name: str
    grid: Grid
    boxes: tuple[Box, ...]
    openings: tuple[Opening, ...]
    notices: tuple[str, ...] = ()
    lights: tuple[Light, ...] = ()


WALL_NAMES = ("wall_x_min", "wall_x_max", "wall_y_min", "wall_y_max", "floor", "ceiling")

FLOOR_RGBA = (0.45, 0.45, 0.47, 1.0)
CEILING_RGBA = (0.8, 0.8, 0.82, 0.15)
OBSTACLE_RGBA = (0.62, 0.46, 0.30, 1.0)


def closing_boxes(min_m: Vec3, max_m: Vec3, wall_m: float) -> tuple[Box, ...]:
    """Return the six boxes named `WALL_NAMES` that close a box of air from outside, without overlap.

    Args:
        min_m: Lower corner of the air, world frame [m].
        max_m: Upper corner of the air, world frame [m].
        wall_m: How thick they are [m].
    """
    (x0, y0, z0), (x1, y1, z1), w = min_m, max_m, wall_m
    low, high = (x0 - w, y0 - w), (x1 + w, y1 + w)
    return (
        Box(name="wall_x_min", kind="wall", min_m=(*low, z0), max_m=(x0, high[1], z1)),
        Box(name="wall_x_max", kind="wall", min_m=(x1, low[1], z0), max_m=(*high, z1)),
        Box(name="wall_y_min", kind="wall", min_m=(x0, low[1], z0), max_m=(x1, y0, z1)),
        Box(name="wall_y_max", kind="wall", min_m=(x0, y1, z0), max_m=(x1, high[1], z1)),
        Box(name="floor", kind="floor", min_m=(*low, z0 - w), max_m=(*high, z0), rgba=FLOOR_RGBA),
        Box(name="ceiling", kind="ceiling", min_m=(*low, z1), max_m=(*high, z1 + w), rgba=CEILING_RGBA),
    )
