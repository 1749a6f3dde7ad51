"""Vertical clearance in a room: how far a vehicle can rise or sink straight up and down from a place."""

import math

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Cell, EnvironmentGeometry, Grid

# A vehicle that could rise by less than this, and not to its height of search, stays on the ground [m].
_MIN_CLIMB_M = 0.5
# What a vehicle keeps from what is above or below it, beyond its radius [m].
_MARGIN_M = 0.05
# Cells that only just reach into the way, up to rounding, do not.
_CELL_TOLERANCE = 1e-6


def clear_height_m(room: EnvironmentGeometry, radius_m: float, place_m: Vec3, to_m: float) -> float:
    """Return the height nearest to a wanted one that a vehicle reaches straight up or down, world frame [m].

    Args:
        room: The room.
        radius_m: The vehicle's radius [m].
        place_m: Where it is, world frame [m]; the cell it is in is not in its way.
        to_m: The height wanted, world frame [m].
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
    """Return whether a climb ends at the wanted height, or at least half a metre higher than it began.

    Args:
        from_m: Where it begins, world frame [m].
        to_m: Where it ends, world frame [m].
        wanted_m: The height wanted, world frame [m].
    """
    return to_m >= min(wanted_m, from_m + _MIN_CLIMB_M)


def is_descent_clear(room: EnvironmentGeometry, radius_m: float, place_m: Vec3, ground_m: float) -> bool:
    """Return whether a vehicle of a radius [m] meets nothing solid between a place and the ground, world frame [m]."""
    origin_m, cell_m = room.grid.origin_m[2], room.grid.cell_m
    low, high = ((height_m - origin_m) / cell_m for height_m in (ground_m, place_m[2]))
    return not len(_solid_layers(room, radius_m, place_m, low, high))


# Layers wholly between two heights, in cells, with something solid within the vehicle's radius of the vertical line.
def _solid_layers(
    room: EnvironmentGeometry, radius_m: float, place_m: Vec3, low: float, high: float
) -> NDArray[np.int64]:
    first = max(0, math.ceil(low - _CELL_TOLERANCE))
    layers = room.occupancy[:, :, first : max(first, math.floor(high + _CELL_TOLERANCE))] == Cell.SOLID
    x_gap_m, y_gap_m = (_gaps_m(room.grid, axis, place_m[axis]) for axis in (0, 1))
    is_near = np.add.outer(x_gap_m**2, y_gap_m**2) < radius_m**2
    return first + np.flatnonzero(layers[is_near].any(axis=0))


# How far the cells along an axis are from a coordinate; 0 for the one that holds it.
def _gaps_m(grid: Grid, axis: int, at_m: float) -> NDArray[np.float64]:
    centres_m = grid.origin_m[axis] + (np.arange(grid.shape[axis]) + 0.5) * grid.cell_m
    return np.maximum(np.abs(centres_m - at_m) - grid.cell_m / 2, 0.0)
