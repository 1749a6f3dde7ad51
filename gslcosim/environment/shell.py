"""What closes a room from outside: walls, floor and ceiling as boxes, and the colours of solids."""

from gslcosim.environment.model import Box
from gslcosim.quantities import Vec3

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
