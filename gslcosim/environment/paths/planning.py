"""Ways that a vehicle flies through a room: inflated solids, the parts of the free air, and paths around corners.

The referee's shortest ways, by which flights are judged, are in `paths`, with the reason why there are two.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Box, Cell, Environment
from gslcosim.environment.paths.planning_kernels import (
    block_near_boxes_inplace,
    is_curve_free,
    lattice_path,
    nearest_cell,
    parts_of,
    shortened,
)
from gslcosim.environment.room import Room
from gslcosim.environment.sight_kernels import is_line_of_sight_free
from gslcosim.quantities import Vec3

# Nearest free places: of any part, and of what is in sight or not; compiled functions take positional arguments only.
_ANY_PART = 0
_IN_SIGHT, _ANYWHERE = True, False
# A path is looked at at least this often per cell.
_LOOKS_PER_CELL = 4
# What a vehicle keeps from obstacles beyond its radius: errors of its control [m].
MARGIN_M = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeSpace:
    """Where the centre of a vehicle may be: every point of a free cell keeps its distance from all solids.

    `blocked` is (nx, ny, nz) uint8, 1 where it may not be; `solid` the same for what is in the way of anything;
    `parts` numbers the connected parts of the free cells from 1.
    """

    grid: Grid
    blocked: NDArray[np.uint8] = field(repr=False)
    solid: NDArray[np.uint8] = field(repr=False)
    parts: NDArray[np.int32] = field(repr=False)

    def is_free(self, point_m: Vec3) -> bool:
        """Return whether a point, world frame [m], lies in a free cell."""
        return self.part_of(point_m) > 0

    def part_of(self, point_m: Vec3) -> int:
        """Return the number of the part in which a point lies, world frame [m]; 0 where it is not free."""
        cell = self.grid.cell_of(np.array(point_m))
        return int(self.parts[tuple(cell)]) if self.grid.contains_cell(cell) else 0

    def sees(self, a_m: Vec3, b_m: Vec3) -> bool:
        """Return whether the straight way between two points, world frame [m], is free."""
        return bool(is_line_of_sight_free(self.blocked, self.grid.origin_m, self.grid.cell_m, *a_m, *b_m))

    def nearest_m(self, point_m: Vec3, *, part: int = _ANY_PART, in_sight: bool = False) -> Vec3 | None:
        """Return the centre of the nearest free cell, world frame [m], or nothing when there is none.

        Args:
            point_m: The point, world frame [m].
            part: The part that it has to be of; 0: any.
            in_sight: Whether solids between the two rule it out.
        """
        sight = _IN_SIGHT if in_sight else _ANYWHERE
        place = (np.asarray(self.grid.origin_m), self.grid.cell_m, np.array(point_m, np.float64))
        node = int(nearest_cell(self.parts, part, self.solid, sight, *place))
        return None if node < 0 else _centre_m(self.grid, np.array(np.unravel_index(node, self.grid.shape)))

    def path(self, start_m: Vec3, goal_m: Vec3) -> NDArray[np.float64] | None:
        """Return a short path between two points in free cells as (n, 3) start, bends and goal, world frame [m].

        It is the shortest one over neighbouring cells, see `lattice_path`, with the bends left out that it can pass by
        in a straight line; nothing when there is none.
        """
        if self.part_of(start_m) == 0 or self.part_of(start_m) != self.part_of(goal_m):
            return None
        ends_m = np.array([start_m, goal_m], np.float64)
        if self.sees(start_m, goal_m):
            return ends_m
        cells = lattice_path(self.blocked, *self.grid.cell_of(ends_m))
        points_m = np.asarray(self.grid.origin_m) + (cells + 0.5) * self.grid.cell_m
        points_m[0], points_m[-1] = ends_m
        return shortened(points_m, self.blocked, np.asarray(self.grid.origin_m), self.grid.cell_m)

    def holds_curve(self, coefficients: NDArray[np.float64], duration_s: float, *, max_speed_m_s: float) -> bool:
        """Return whether a polynomial path stays in free cells; see `is_curve_free`.

        Args:
            coefficients: (3, 6) axis xyz, power 0 to 5, world frame [m/s^n].
            duration_s: How long it takes [s].
            max_speed_m_s: The greatest speed on it [m/s].
        """
        n_looks = 1 + math.ceil(_LOOKS_PER_CELL * max_speed_m_s * duration_s / self.grid.cell_m)
        origin_m = np.asarray(self.grid.origin_m)
        return bool(is_curve_free(coefficients, duration_s, self.blocked, origin_m, self.grid.cell_m, n_looks))

    def slab(self, low_m: float, high_m: float) -> "FreeSpace":
        """Return one layer of cells, free where all cells between two heights [m] are; its points have height 0."""
        low, high = (self._layer(height_m) for height_m in (low_m, high_m))
        blocked = self.blocked[:, :, low : high + 1].max(axis=2, keepdims=True)
        solid = self.solid[:, :, low : high + 1].max(axis=2, keepdims=True)
        x_m, y_m, _ = self.grid.origin_m
        nx, ny, _ = self.grid.shape
        grid = Grid(origin_m=(x_m, y_m, -self.grid.cell_m / 2), cell_m=self.grid.cell_m, shape=(nx, ny, 1))
        return FreeSpace(grid=grid, blocked=blocked, solid=solid, parts=parts_of(blocked))

    def _layer(self, height_m: float) -> int:
        layer = math.floor((height_m - self.grid.origin_m[2]) / self.grid.cell_m)
        return min(max(layer, 0), self.grid.shape[2] - 1)


def free_space(
    environment: Environment | Room, *, radius_m: float, margin_m: float, ground_m: float | None = None
) -> FreeSpace:
    """Return where the centre of a vehicle may be.

    Every point of a free cell is at least radius and margin from all boxes and from the faces of the room at its
    sides, and its centre at least the radius from floor and ceiling.

    Args:
        environment: The room.
        radius_m: The vehicle's radius [m].
        margin_m: What it keeps beyond that [m].
        ground_m: For a vehicle that drives, the height of what it stands on, world frame [m]: that is not in its way.
    """
    grid, clearance_m = environment.grid, radius_m + margin_m
    solid = (environment.occupancy == Cell.SOLID).astype(np.uint8)
    blocked = solid.copy()
    boxes = [box for box in environment.boxes if _is_in_the_way(box, ground_m)]
    lows_m, highs_m = (np.array([getattr(box, end) for box in boxes]).reshape(-1, 3) for end in ("min_m", "max_m"))
    block_near_boxes_inplace(blocked, lows_m, highs_m, np.asarray(grid.origin_m), grid.cell_m, clearance_m)
    n_side, n_height = math.ceil(clearance_m / grid.cell_m - 1e-6), math.ceil(radius_m / grid.cell_m - 0.5 - 1e-6)
    for axis, n_layers in enumerate((n_side, n_side, 0 if ground_m is not None else n_height)):
        layers = np.moveaxis(blocked, axis, 0)
        layers[:n_layers] = 1
        layers[layers.shape[0] - n_layers :] = 1
    return FreeSpace(grid=grid, blocked=blocked, solid=solid, parts=parts_of(blocked))


def rehearse_planning() -> None:
    """Plan once around a made-up corner, so that no kernel is compiled or loaded while simulated time passes."""
    blocked = np.zeros((3, 3, 1), np.uint8)
    blocked[1, :2] = 1
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=1.0, shape=(3, 3, 1))
    space = FreeSpace(grid=grid, blocked=blocked, solid=blocked, parts=parts_of(blocked))
    space.path((0.5, 0.5, 0.5), (2.5, 0.5, 0.5))
    space.nearest_m((1.5, 0.5, 0.5), in_sight=True)
    space.holds_curve(np.zeros((3, 6)), 1.0, max_speed_m_s=1.0)


def _is_in_the_way(box: Box, ground_m: float | None) -> bool:
    return box.kind not in ("floor", "ceiling") and (ground_m is None or box.max_m[2] > ground_m + 1e-6)


def _centre_m(grid: Grid, cell: NDArray[np.int64]) -> Vec3:
    x_m, y_m, z_m = (np.asarray(grid.origin_m) + (cell + 0.5) * grid.cell_m).tolist()
    return x_m, y_m, z_m
