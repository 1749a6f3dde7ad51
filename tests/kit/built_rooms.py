"""Rooms that tests make up: air on a grid, and a closed room with its walls."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gslcosim.environment.model import Box, Cell, Environment, Grid, WindFrames

WALL_M = 0.2
STILL_M_S = (0.0, 0.0, 0.0)


def build_air(
    cells: np.ndarray | tuple[int, int, int] = (20, 16, 12),
    wind_m_s: ArrayLike = STILL_M_S,
    *,
    cell_m: float = 0.25,
    origin_m=(0.0, 0.0, 0.0),
    boxes: Sequence[Box] = (),
    name: str = "room",
    **wind: Any,
) -> Environment:
    """Return a room of these cells, or of free ones in this number along x, y and z.

    `wind_m_s` is one velocity, one for each frame, or the whole field (frames, x, y, z, 3).
    """
    occupancy = cells if isinstance(cells, np.ndarray) else np.zeros(cells, np.uint8)
    velocity_m_s = np.atleast_2d(np.asarray(wind_m_s, np.float32))
    if velocity_m_s.ndim == 2:
        velocity_m_s = np.tile(velocity_m_s[:, None, None, None, :], (1, *occupancy.shape, 1))
    return Environment(
        name=name,
        grid=Grid(origin_m=origin_m, cell_m=cell_m, shape=occupancy.shape),
        occupancy=occupancy,
        wind=WindFrames(velocity_m_s=velocity_m_s, **wind),
        boxes=tuple(boxes),
        openings=(),
        content_hash=name,
    )


def build_closed_room(
    shape: tuple[int, int, int] = (60, 40, 24),
    *,
    cell_m: float = 0.25,
    wind_m_s: ArrayLike = STILL_M_S,
    obstacles: Sequence[tuple[str, Any, Any]] = (),
    **wind: Any,
) -> Environment:
    """Return a closed room, by default of 15 x 10 x 6 m, with named obstacles; see `build_air` for its wind."""
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=cell_m, shape=shape)
    (x_m, y_m, z_m), wall = grid.max_m, WALL_M
    boxes = [
        Box(name="floor", kind="floor", min_m=(-wall, -wall, -wall), max_m=(x_m + wall, y_m + wall, 0.0)),
        Box(name="ceiling", kind="ceiling", min_m=(-wall, -wall, z_m), max_m=(x_m + wall, y_m + wall, z_m + wall)),
        Box(name="wall_west", kind="wall", min_m=(-wall, -wall, 0.0), max_m=(0.0, y_m + wall, z_m)),
        Box(name="wall_east", kind="wall", min_m=(x_m, -wall, 0.0), max_m=(x_m + wall, y_m + wall, z_m)),
        Box(name="wall_south", kind="wall", min_m=(0.0, -wall, 0.0), max_m=(x_m, 0.0, z_m)),
        Box(name="wall_north", kind="wall", min_m=(0.0, y_m, 0.0), max_m=(x_m, y_m + wall, z_m)),
    ]
    occupancy = np.zeros(grid.shape, np.uint8)
    for name, min_m, max_m in obstacles:
        boxes.append(Box(name=name, kind="obstacle", min_m=min_m, max_m=max_m))
        low, high = grid.cell_of(np.array(min_m) + 1e-9), grid.cell_of(np.array(max_m) - 1e-9) + 1
        occupancy[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = Cell.SOLID
    return build_air(occupancy, wind_m_s, cell_m=grid.cell_m, boxes=boxes, **wind)
