"""Vertical clearance in a room: the greatest straight climb or descent of a vehicle from a place."""

import math

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Cell, EnvironmentGeometry

# A vehicle stays on the ground unless it can rise by this much, or to its search height [m].
_MIN_CLIMB_M = 0.5
# Clearance of a vehicle from solids above and below, beyond its radius [m].
_MARGIN_M = 0.05
# Cells that overlap the column only by rounding do not block it.
_CELL_TOLERANCE = 1e-6


def clear_height_m(room: EnvironmentGeometry, radius_m: float, place_m: Vec3, to_m: float) -> float:
    """Return the height nearest to a target that a vehicle reaches straight up or down, world frame [m].

    Args:
        room: The room.
        radius_m: The vehicle's radius [m].
        place_m: Its position, world frame [m]; its own cell never blocks it.
        to_m: The target, world frame [m].
    """
    origin_m, cell_m = room.grid.origin_m[2], room.grid.cell_m
    keeps_m = radius_m + _MARGIN_M
    here = (place_m[2] - origin_m) / cell_m
    if to_m >= place_m[2]:
        above = _solid_layers(room, radius_m, place_m, here, (to_m + keeps_m - origin_m) / cell_m + 1.0)
        return min(to_m, origin_m + float(above[0]) * cell_m - keeps_m) if len(above) else to_m
    below = _solid_layers(room, radius_m, place_m, (to_m - keeps_m - origin_m) / cell_m - 1.0, here)
    return max(to_m, origin_m + float(below[-1] + 1) * cell_m + keeps_m) if len(below) else to_m


def is_climb_sufficient(from_m: float, to_m: float, wanted_m: float) -> bool:
    """Return whether a climb ends at its target height, or at least half a metre above its start.

    Args:
        from_m: Its start, world frame [m].
        to_m: Its end, world frame [m].
        wanted_m: Its target, world frame [m].
    """
    return to_m >= min(wanted_m, from_m + _MIN_CLIMB_M)


def is_descent_clear(room: EnvironmentGeometry, radius_m: float, place_m: Vec3, ground_m: float) -> bool:
    """Return whether a vehicle's descent from a place to the ground, world frame [m], is free of solids."""
    origin_m, cell_m = room.grid.origin_m[2], room.grid.cell_m
    low, high = ((height_m - origin_m) / cell_m for height_m in (ground_m, place_m[2]))
    return not len(_solid_layers(room, radius_m, place_m, low, high))


# Layers wholly between two heights, in cells, with a solid cell within the vehicle's radius of the vertical line.
def _solid_layers(
    room: EnvironmentGeometry, radius_m: float, place_m: Vec3, low: float, high: float
) -> NDArray[np.int64]:
    first = max(0, math.ceil(low - _CELL_TOLERANCE))
    layers = room.occupancy[:, :, first : max(first, math.floor(high + _CELL_TOLERANCE))] == Cell.SOLID
    # Distances of the cells from the line; 0 for the one that holds it.
    x_gap_m, y_gap_m = (
        np.maximum(np.abs(room.grid.axis_centres_m(axis) - place_m[axis]) - room.grid.cell_m / 2, 0.0)
        for axis in (0, 1)
    )
    is_near = np.add.outer(x_gap_m * x_gap_m, y_gap_m * y_gap_m) < radius_m * radius_m
    return first + np.flatnonzero(layers[is_near].any(axis=0))
