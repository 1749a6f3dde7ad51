# pyright: basic
"""Path planner of vehicles: inflated solids, connected parts of the free air, and paths around corners.

It finds a path over neighbouring cells and shortens it: unnecessary bends are left out. The referee's shortest paths,
by which runs are scored, are in `scoring_paths`, with the reason for two planners.
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import heapq
import math
from dataclasses import dataclass, field

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.cell_kernels import is_step_free, keep_bends, label_parts
from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid_kernels import is_line_of_sight_free
from gslcosim.environment.model import Cell, EnvironmentGeometry, Grid

# Lengths of steps in whole numbers, so that equal paths are equal to the bit: 2^32 to the edge of a cell.
_ONE = 1 << 32
_STEP = (0, _ONE, round(math.sqrt(2.0) * _ONE), round(math.sqrt(3.0) * _ONE))
_BLOCKED = 1
_ANY_PART = 0
# Least number of samples of a path per cell.
_LOOKS_PER_CELL = 4
# Clearance of a vehicle from obstacles beyond its radius, for errors of its control [m].
MARGIN_M = 0.05


@numba.njit(cache=True, nogil=True)
def block_near_boxes_inplace(blocked, lows_m, highs_m, origin_m, cell_m, clearance_m):
    """Block the cells that hold a point nearer to a box than the clearance.

    gap_a = max(low_a - cell_high_a, cell_low_a - high_a, 0) on each axis a; blocked when |gap| < clearance
    [m] = [m]

    Args:
        blocked: (nx, ny, nz) uint8, set to 1 in place; index order ij.
        lows_m: (n, 3) lower corners of the boxes, world frame [m].
        highs_m: (n, 3) upper corners [m].
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        clearance_m: Least distance of every point of a free cell from the boxes [m], >= 0.

    Source:
        Our derivation.
    Held by:
        tests/unit/environment/paths/test_planner.py (against brute force)
    """
    low, high, gap_m = np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(3)
    # A cell exactly at the clearance, up to rounding, is free.
    nearer_m2 = max(0.0, clearance_m - 1e-6) ** 2
    for box in range(lows_m.shape[0]):
        for a in range(3):
            low[a] = max(0, math.floor((lows_m[box, a] - clearance_m - origin_m[a]) / cell_m))
            high[a] = min(blocked.shape[a], math.ceil((highs_m[box, a] + clearance_m - origin_m[a]) / cell_m))
        for i in range(low[0], high[0]):
            gap_m[0] = _gap(lows_m[box, 0], highs_m[box, 0], origin_m[0] + i * cell_m, cell_m)
            for j in range(low[1], high[1]):
                gap_m[1] = _gap(lows_m[box, 1], highs_m[box, 1], origin_m[1] + j * cell_m, cell_m)
                for k in range(low[2], high[2]):
                    gap_m[2] = _gap(lows_m[box, 2], highs_m[box, 2], origin_m[2] + k * cell_m, cell_m)
                    if gap_m[0] ** 2 + gap_m[1] ** 2 + gap_m[2] ** 2 < nearer_m2:
                        blocked[i, j, k] = 1


@numba.njit(cache=True, nogil=True, inline="always")
def _gap(low, high, cell_low, cell_m):
    return max(low - (cell_low + cell_m), cell_low - high, 0.0)


@numba.njit(cache=True, nogil=True)
def nearest_cell(parts, part, solid, is_seen_only, origin_m, cell_m, point_m):
    """Find the free cell whose centre is nearest to a point.

    Args:
        parts: (nx, ny, nz) int32 as of `label_parts`.
        part: Number of its part; 0: any.
        solid: (nx, ny, nz) uint8, 1 where cells block the line of sight.
        is_seen_only: Consider only cells in sight of the point.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        point_m: (3,) the point, world frame [m].

    Returns:
        Index of the cell in the flat grid, the first of equally near ones; -1 when there is none.

    Held by:
        tests/unit/environment/paths/test_planner.py
    """
    nx, ny, nz = parts.shape
    best, best_m2 = -1, np.inf
    for i in range(nx):
        x = origin_m[0] + (i + 0.5) * cell_m
        for j in range(ny):
            y = origin_m[1] + (j + 0.5) * cell_m
            for k in range(nz):
                if parts[i, j, k] == 0 or (part != 0 and parts[i, j, k] != part):
                    continue
                z = origin_m[2] + (k + 0.5) * cell_m
                away_m2 = (x - point_m[0]) ** 2 + (y - point_m[1]) ** 2 + (z - point_m[2]) ** 2
                if away_m2 >= best_m2:
                    continue
                if is_seen_only and not is_line_of_sight_free(
                    solid, origin_m, cell_m, point_m[0], point_m[1], point_m[2], x, y, z
                ):
                    continue
                best, best_m2 = (i * ny + j) * nz + k, away_m2
    return best


@numba.njit(cache=True, nogil=True, inline="always")
def _left(di, dj, dk):
    # The length of the shortest path without obstacles: diagonal steps first.
    a, b, c = abs(di), abs(dj), abs(dk)
    most, least = max(a, b, c), min(a, b, c)
    middle = a + b + c - most - least
    return (most - middle) * _STEP[1] + (middle - least) * _STEP[2] + least * _STEP[3]


@numba.njit(cache=True, nogil=True)
def lattice_path(blocked, start, goal):
    """Return a shortest path of steps to neighbouring cells, without cutting corners.

    A*: a cell has 26 neighbours, in a grid of one layer 8. A step of (di, dj, dk) is as long as the distance of the
    centres, and all cells of the block that it spans must be free. The choice among equally long paths is fixed:
    lengths are whole numbers, and ties go to the cell with less left to go, then to the lower index.

    Args:
        blocked: (nx, ny, nz) uint8, 0 where free; index order ij.
        start: (3,) int64, a free cell.
        goal: (3,) int64, a free cell.

    Returns:
        (n, 3) int64 cells from start to goal; (0, 3) when there is no path.

    Source:
        Hart, Nilsson and Raphael 1968, A formal basis for the heuristic determination of minimum cost paths,
        doi:10.1109/TSSC.1968.300136.
    Held by:
        tests/unit/environment/paths/test_planner.py (lengths of Dijkstra's algorithm in scipy on random grids)
    """
    _, ny, nz = blocked.shape
    length = np.full(blocked.size, np.iinfo(np.int64).max, np.int64)
    came_by = np.full(blocked.size, -1, np.int8)
    first = (start[0] * ny + start[1]) * nz + start[2]
    last = (goal[0] * ny + goal[1]) * nz + goal[2]
    length[first] = 0
    left = _left(goal[0] - start[0], goal[1] - start[1], goal[2] - start[2])
    queue = [(left, left, first)]
    while len(queue) > 0:
        total, left, node = heapq.heappop(queue)
        so_far = length[node]
        if total > so_far + left:
            continue
        if node == last:
            return _steps_back(came_by, node, ny, nz)
        i, j, k = node // (ny * nz), (node // nz) % ny, node % nz
        for step in range(27):
            di, dj, dk = step // 9 - 1, (step // 3) % 3 - 1, step % 3 - 1
            if step == 13 or not is_step_free(blocked, _BLOCKED, i, j, k, di, dj, dk):
                continue
            other = ((i + di) * ny + j + dj) * nz + k + dk
            through = so_far + _STEP[abs(di) + abs(dj) + abs(dk)]
            if through < length[other]:
                length[other] = through
                came_by[other] = step
                left = _left(goal[0] - i - di, goal[1] - j - dj, goal[2] - k - dk)
                heapq.heappush(queue, (through + left, left, other))
    return np.empty((0, 3), np.int64)


@numba.njit(cache=True, nogil=True)
def _steps_back(came_by, node, ny, nz):
    n = 1
    end = node
    while came_by[node] >= 0:
        node -= _offset(came_by[node], ny, nz)
        n += 1
    cells = np.empty((n, 3), np.int64)
    node = end
    for p in range(n - 1, -1, -1):
        cells[p, 0], cells[p, 1], cells[p, 2] = node // (ny * nz), (node // nz) % ny, node % nz
        if p > 0:
            node -= _offset(came_by[node], ny, nz)
    return cells


@numba.njit(cache=True, nogil=True, inline="always")
def _offset(step, ny, nz):
    return ((step // 9 - 1) * ny + (step // 3) % 3 - 1) * nz + step % 3 - 1


@numba.njit(cache=True, nogil=True, inline="always")
def _is_leg_free(space, a_m, b_m):
    blocked, origin_m, cell_m = space
    return is_line_of_sight_free(blocked, origin_m, cell_m, a_m[0], a_m[1], a_m[2], b_m[0], b_m[1], b_m[2])


@numba.njit(cache=True, nogil=True)
def _shorten_path(points_m, blocked, origin_m, cell_m):
    return keep_bends(points_m, _is_leg_free, (blocked, origin_m, cell_m))


@numba.njit(cache=True, nogil=True)
def is_curve_free(coefficients, duration_s, blocked, origin_m, cell_m, n_samples):
    """Return whether a polynomial path stays in free cells, sampled in equal steps of time.

    p_a(t) = sum over powers n of c[a, n] t^n        [m] = [m/s^n] * [s]^n

    Args:
        coefficients: (3, 6) axis xyz, power 0 to 5, world frame [m/s^n].
        duration_s: Its duration [s].
        blocked: (nx, ny, nz) uint8, 0 where free; index order ij; outside the grid nothing is free.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        n_samples: Number of steps, >= 1; the path between two samples is not checked.

    Returns:
        True when all samples, both ends included, are in free cells.

    Held by:
        tests/unit/environment/paths/test_planner.py
    """
    for sample in range(n_samples + 1):
        t_s = duration_s * sample / n_samples
        cell = (0, 0, 0)
        for a in range(3):
            value_m = 0.0
            for n in range(5, -1, -1):
                value_m = value_m * t_s + coefficients[a, n]
            i = math.floor((value_m - origin_m[a]) / cell_m)
            if i < 0 or i >= blocked.shape[a]:
                return False
            cell = (cell[1], cell[2], i)
        if blocked[cell[0], cell[1], cell[2]] != 0:
            return False
    return True


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeSpace:
    """Free space for the centre of a vehicle: every point of a free cell keeps the clearance from all solids.

    `blocked` is (nx, ny, nz) uint8, 1 where the centre may not be; `solid` the same for solid cells; `parts` numbers
    the connected parts of the free cells from 1.
    """

    grid: Grid
    blocked: NDArray[np.uint8] = field(repr=False)
    solid: NDArray[np.uint8] = field(repr=False)
    parts: NDArray[np.int32] = field(repr=False)

    def is_free(self, point_m: Vec3) -> bool:
        """Return whether a point, world frame [m], lies in a free cell."""
        return self.part_of(point_m) > 0

    def part_of(self, point_m: Vec3) -> int:
        """Return the number of the part that holds a point, world frame [m]; 0 where it is not free."""
        cell = self.grid.cell_of(np.array(point_m))
        return int(self.parts[tuple(cell)]) if self.grid.contains_cell(cell) else 0

    def sees(self, a_m: Vec3, b_m: Vec3) -> bool:
        """Return whether the straight line between two points, world frame [m], is free."""
        return bool(is_line_of_sight_free(self.blocked, self.grid.origin_m, self.grid.cell_m, *a_m, *b_m))

    def nearest_m(self, point_m: Vec3, *, part: int = _ANY_PART, in_sight: bool = False) -> Vec3 | None:
        """Return the centre of the nearest free cell, world frame [m]; None without one.

        Args:
            point_m: The point, world frame [m].
            part: Number of the cell's part; 0: any.
            in_sight: Consider only cells without a solid between the two.
        """
        place = (np.asarray(self.grid.origin_m), self.grid.cell_m, np.array(point_m, np.float64))
        node = int(nearest_cell(self.parts, part, self.solid, in_sight, *place))
        if node < 0:
            return None
        x_m, y_m, z_m = self.grid.centres_of(np.array(np.unravel_index(node, self.grid.shape))).tolist()
        return x_m, y_m, z_m

    def path(self, start_m: Vec3, goal_m: Vec3) -> NDArray[np.float64] | None:
        """Return a short path between two points in free cells as (n, 3) start, bends and goal, world frame [m].

        It is that of `lattice_path` without the bends that a straight line avoids; None when there is none.
        """
        if self.part_of(start_m) == 0 or self.part_of(start_m) != self.part_of(goal_m):
            return None
        ends_m = np.array([start_m, goal_m], np.float64)
        if self.sees(start_m, goal_m):
            return ends_m
        cells = lattice_path(self.blocked, *self.grid.cell_of(ends_m))
        points_m = self.grid.centres_of(cells)
        points_m[0], points_m[-1] = ends_m
        return _shorten_path(points_m, self.blocked, np.asarray(self.grid.origin_m), self.grid.cell_m)

    def holds_curve(self, coefficients: NDArray[np.float64], duration_s: float, *, max_speed_m_s: float) -> bool:
        """Return whether a polynomial path stays in free cells, sampled as in `is_curve_free`.

        Args:
            coefficients: (3, 6) axis xyz, power 0 to 5, world frame [m/s^n].
            duration_s: Its duration [s].
            max_speed_m_s: The greatest speed on it [m/s].
        """
        n_looks = 1 + math.ceil(_LOOKS_PER_CELL * max_speed_m_s * duration_s / self.grid.cell_m)
        origin_m = np.asarray(self.grid.origin_m)
        return bool(is_curve_free(coefficients, duration_s, self.blocked, origin_m, self.grid.cell_m, n_looks))

    def slab(self, low_m: float, high_m: float) -> "FreeSpace":
        """Return one layer of cells, free where all cells between two heights [m] are; its points have height 0."""
        low, high = (self.grid.index_at(2, height_m) for height_m in (low_m, high_m))
        blocked = self.blocked[:, :, low : high + 1].max(axis=2, keepdims=True)
        solid = self.solid[:, :, low : high + 1].max(axis=2, keepdims=True)
        x_m, y_m, _ = self.grid.origin_m
        nx, ny, _ = self.grid.shape
        grid = Grid(origin_m=(x_m, y_m, -self.grid.cell_m / 2), cell_m=self.grid.cell_m, shape=(nx, ny, 1))
        return FreeSpace(grid=grid, blocked=blocked, solid=solid, parts=label_parts(blocked, _BLOCKED))


def free_space(
    environment: EnvironmentGeometry, *, radius_m: float, margin_m: float, ground_m: float | None = None
) -> FreeSpace:
    """Return the free space for the centre of a vehicle.

    Every point of a free cell is at least radius and margin from all boxes and from the room's side faces, and its
    centre at least the radius from floor and ceiling.

    Args:
        environment: The room.
        radius_m: The vehicle's radius [m].
        margin_m: Further clearance [m].
        ground_m: For a vehicle that drives, the height of its ground, world frame [m]; boxes below are no obstacles.
    """
    grid, clearance_m = environment.grid, radius_m + margin_m
    solid = (environment.occupancy == Cell.SOLID).astype(np.uint8)
    blocked = solid.copy()
    boxes = [
        box
        for box in environment.boxes
        if box.kind not in ("floor", "ceiling") and (ground_m is None or box.max_m[2] > ground_m + 1e-6)
    ]
    lows_m, highs_m = (np.array([getattr(box, end) for box in boxes]).reshape(-1, 3) for end in ("min_m", "max_m"))
    block_near_boxes_inplace(blocked, lows_m, highs_m, np.asarray(grid.origin_m), grid.cell_m, clearance_m)
    n_side, n_height = math.ceil(clearance_m / grid.cell_m - 1e-6), math.ceil(radius_m / grid.cell_m - 0.5 - 1e-6)
    for axis, n_layers in enumerate((n_side, n_side, 0 if ground_m is not None else n_height)):
        layers = np.moveaxis(blocked, axis, 0)
        layers[:n_layers] = 1
        layers[layers.shape[0] - n_layers :] = 1
    return FreeSpace(grid=grid, blocked=blocked, solid=solid, parts=label_parts(blocked, _BLOCKED))


def warm_up_planner() -> None:
    """Plan once around a corner, so that no kernel is compiled or loaded during a run."""
    blocked = np.zeros((3, 3, 1), np.uint8)
    blocked[1, :2] = 1
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=1.0, shape=(3, 3, 1))
    space = FreeSpace(grid=grid, blocked=blocked, solid=blocked, parts=label_parts(blocked, _BLOCKED))
    space.path((0.5, 0.5, 0.5), (2.5, 0.5, 0.5))
    space.nearest_m((1.5, 0.5, 0.5), in_sight=True)
    space.holds_curve(np.zeros((3, 6)), 1.0, max_speed_m_s=1.0)
