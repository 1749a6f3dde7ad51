# pyright: basic
"""Shortest collision-free paths through an environment: the truth by which the referee scores runs.

Vehicles plan with `planner` instead. Two planners are intended, so that no vehicle's planner scores itself: the paths
here do not depend on a vehicle's inflated boxes or corners. Their purposes differ too: here the least length, with
bends anywhere between the cells, once per run; there a path over neighbouring cells for a vehicle of some size, during
its motion. Both have only the rule for a step between cells in common.
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.cell_kernels import is_step_free
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import norm3
from gslcosim.environment.grid_kernels import is_line_of_sight_free
from gslcosim.environment.model import Cell, EnvironmentGeometry, Grid

_BLOCKED = 1
_MAX_TIGHTENING_ROUNDS = 200
# Step at which tightening ends, in cells.
_SMALLEST_STEP = 1e-4

Sees = Callable[[NDArray[np.float64], NDArray[np.float64]], bool]


@numba.njit(cache=True, nogil=True, inline="always")
def _point_of(node, ends, shape, origin_m, cell_m):
    # Cell centres, except for the exact points at both ends of the path.
    start_node, start_m, goal_node, goal_m = ends
    if node == start_node:
        return start_m[0], start_m[1], start_m[2]
    if node == goal_node:
        return goal_m[0], goal_m[1], goal_m[2]
    i, j, k = node // (shape[1] * shape[2]), (node // shape[2]) % shape[1], node % shape[2]
    return origin_m[0] + (i + 0.5) * cell_m, origin_m[1] + (j + 0.5) * cell_m, origin_m[2] + (k + 0.5) * cell_m


@numba.njit(cache=True, nogil=True, inline="always")
def _node_of(point_m, shape, origin_m, cell_m):
    # Flat index of the cell that holds a point; -1 outside the grid.
    i = math.floor((point_m[0] - origin_m[0]) / cell_m)
    j = math.floor((point_m[1] - origin_m[1]) / cell_m)
    k = math.floor((point_m[2] - origin_m[2]) / cell_m)
    return (i * shape[1] + j) * shape[2] + k if 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2] else -1


@numba.njit(cache=True, nogil=True, inline="always")
def _distance(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@numba.njit(cache=True, nogil=True)
def any_angle_path(blocked, origin_m, cell_m, start_m, goal_m, within_m):
    """Return a short path between two points through free cells, with straight legs of any direction.

    Lazy Theta*: A* over the 26 neighbours of each cell, where a leg to a cell may start at any earlier point in its
    sight. Bends lie at cell centres, so the path exceeds the shortest by about half a cell at each bend.

    Args:
        blocked: (nx, ny, nz) uint8, 0 where free; index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        start_m: (3,) start, world frame [m], in a free cell.
        goal_m: (3,) goal, world frame [m].
        within_m: The path may end anywhere within this distance of the goal [m], >= 0.

    Returns:
        (n, 3) points of the path, world frame [m], the start first; (0, 3) when there is none.

    Source:
        Nash, Koenig and Tovey 2010, Lazy Theta*: any-angle path planning and path length analysis in 3D, AAAI, fig. 4.
    Held by:
        tests/unit/environment/paths/test_scoring_paths.py (closed forms around one box)
    """
    shape = blocked.shape
    _, ny, nz = shape
    start_node, goal_node = _node_of(start_m, shape, origin_m, cell_m), _node_of(goal_m, shape, origin_m, cell_m)
    ends = (start_node, start_m, goal_node, goal_m)
    length_m = np.full(blocked.size, np.inf)
    parent = np.full(blocked.size, -1, dtype=np.int64)
    is_closed = np.zeros(blocked.size, dtype=np.bool_)
    length_m[start_node] = 0.0
    parent[start_node] = start_node
    queue = [(0.0, start_node)]
    while len(queue) > 0:
        _, node = heapq.heappop(queue)
        if is_closed[node]:
            continue
        is_closed[node] = True
        here = _point_of(node, ends, shape, origin_m, cell_m)
        i, j, k = node // (ny * nz), (node // nz) % ny, node % nz
        before = _point_of(parent[node], ends, shape, origin_m, cell_m)
        if not is_line_of_sight_free(
            blocked, origin_m, cell_m, before[0], before[1], before[2], here[0], here[1], here[2]
        ):
            # The assumed straight leg is blocked: come from the best neighbour instead.
            length_m[node] = np.inf
            for step in range(27):
                di, dj, dk = step // 9 - 1, (step // 3) % 3 - 1, step % 3 - 1
                other = node + (di * ny + dj) * nz + dk
                if other == node or not is_step_free(blocked, _BLOCKED, i, j, k, di, dj, dk) or not is_closed[other]:
                    continue
                through_m = length_m[other] + _distance(_point_of(other, ends, shape, origin_m, cell_m), here)
                if through_m < length_m[node]:
                    length_m[node] = through_m
                    parent[node] = other
        if _distance(here, goal_m) <= within_m or node == goal_node:
            return _points_back_to_start(node, parent, ends, shape, origin_m, cell_m)
        origin_node = parent[node]
        corner = _point_of(origin_node, ends, shape, origin_m, cell_m)
        for step in range(27):
            di, dj, dk = step // 9 - 1, (step // 3) % 3 - 1, step % 3 - 1
            other = node + (di * ny + dj) * nz + dk
            if not is_step_free(blocked, _BLOCKED, i, j, k, di, dj, dk) or is_closed[other]:
                continue
            there = _point_of(other, ends, shape, origin_m, cell_m)
            through_m = length_m[origin_node] + _distance(corner, there)
            if through_m < length_m[other]:
                length_m[other] = through_m
                parent[other] = origin_node
                left_m = max(0.0, _distance(there, goal_m) - within_m)
                heapq.heappush(queue, (float(through_m + left_m), other))
    return np.empty((0, 3))


@numba.njit(cache=True, nogil=True)
def _points_back_to_start(node, parent, ends, shape, origin_m, cell_m):
    points = [_point_of(node, ends, shape, origin_m, cell_m)]
    while node != ends[0]:
        node = parent[node]
        points.append(_point_of(node, ends, shape, origin_m, cell_m))
    return np.array(points[::-1])


@dataclass(frozen=True, kw_only=True)
class Layer:
    """One layer of a room's cells, for a vehicle of constant height."""

    grid: Grid
    occupancy: NDArray[np.uint8]


Places = EnvironmentGeometry | Layer


def shortest_path_m(
    environment: Places, start_m: Vec3, goal_m: Vec3, *, clearance_m: float, within_m: float = 0.0
) -> float | None:
    """Return the length [m] of the path of `shortest_path`; None without one."""
    points_m = shortest_path(environment, start_m, goal_m, clearance_m=clearance_m, within_m=within_m)
    return None if points_m is None else _length_m(*points_m)


def shortest_path(
    environment: Places, start_m: Vec3, goal_m: Vec3, *, clearance_m: float, within_m: float = 0.0
) -> NDArray[np.float64] | None:
    """Return the bends of the shortest collision-free path; None without one.

    The path keeps its clearance from solid cells and from the faces of the room. Where the start or the goal itself is
    nearer than that, the path may be too: to solid cells in the neighbourhood of that end, to a face along its whole
    length. So a vehicle can start on the floor and a source can lie beside a shelf.

    A straight path is exact. Others go around cells instead of the true shapes: a cell is too near when its centre is
    nearer to a solid cell than the clearance, so each bend is off by up to about half a cell.

    Args:
        environment: The room.
        start_m: Start, world frame [m].
        goal_m: Goal, world frame [m].
        clearance_m: Distance from all solids [m], >= 0; the radius of a vehicle.
        within_m: The path ends within this distance of the goal [m], >= 0, even behind a wall.

    Returns:
        (n, 3) start, bends and end, world frame [m]; the start alone when it is near enough; None when there is no
        path, or when the start, or a goal to be reached exactly, is outside the room or in a solid cell.
    """
    start, goal = np.asarray(start_m, dtype=np.float64), np.asarray(goal_m, dtype=np.float64)
    if not _is_air(environment, start) or (within_m == 0.0 and not _is_air(environment, goal)):
        return None
    distance_m = norm3(*(goal - start).tolist())
    if distance_m <= within_m:
        return start[np.newaxis]
    straight = np.stack([start, goal - (goal - start) * (within_m / distance_m)])
    if not (environment.occupancy == Cell.SOLID).any():
        return straight
    blocked = _blocked(environment, start, goal, clearance_m)
    origin_m, cell_m = environment.grid.origin_m, environment.grid.cell_m

    def sees(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
        return bool(is_line_of_sight_free(blocked, origin_m, cell_m, a[0], a[1], a[2], b[0], b[1], b[2]))

    if sees(straight[0], straight[1]):
        return straight
    points_m = any_angle_path(blocked, np.asarray(origin_m), cell_m, start, goal, float(within_m))
    if not len(points_m):
        return None
    tightened_m = _tightened(_cut_short(points_m, goal, within_m), cell_m, sees)
    # The last leg turns straight to the goal, where its new end is in sight.
    offset = tightened_m[-2] - goal
    end = goal + offset * (within_m / norm3(*offset.tolist()))
    if sees(tightened_m[-2], end):
        tightened_m = np.concatenate([tightened_m[:-1], [end]])
    return _tightened(tightened_m, cell_m, sees)


def shortest_level_path_m(
    environment: EnvironmentGeometry,
    start_m: Vec3,
    goal_m: Vec3,
    *,
    clearance_m: float,
    within_m: float = 0.0,
) -> float | None:
    """Return the length [m] of the shortest collision-free path at the height of its start, for a vehicle on wheels.

    Args:
        environment: The room.
        start_m: Start, world frame [m].
        goal_m: Goal, world frame [m], at any height.
        clearance_m: Distance from all solids at that height [m], >= 0.
        within_m: The path ends within this distance of the goal, in space [m]; 0: below or above the goal.

    Returns:
        The length; None without a path, or when no path at this height comes near enough to the goal.
    """
    rise_m = goal_m[2] - start_m[2]
    if within_m and abs(rise_m) > within_m:
        return None
    reach_m = math.sqrt(within_m * within_m - rise_m * rise_m) if within_m else 0.0
    layer = layer_at(environment, start_m[2])
    ends_m = ((x_m, y_m, 0.0) for x_m, y_m, _ in (start_m, goal_m))
    return shortest_path_m(layer, *ends_m, clearance_m=clearance_m, within_m=reach_m)


def layer_at(environment: EnvironmentGeometry, height_m: float) -> Layer:
    """Return the cells at a height [m], as a layer around height 0; without cells for a height outside the room."""
    grid = environment.grid
    layer = math.floor((height_m - grid.origin_m[2]) / grid.cell_m)
    occupancy = environment.occupancy[:, :, layer : layer + 1] if layer >= 0 else environment.occupancy[:, :, :0]
    origin_m = (*grid.origin_m[:2], -grid.cell_m / 2)
    return Layer(grid=Grid(origin_m=origin_m, cell_m=grid.cell_m, shape=occupancy.shape), occupancy=occupancy)


def clearance_field_m(is_solid: NDArray[np.bool_], cell_m: float, *, up_to_m: float) -> NDArray[np.float32]:
    """Return the distance of each cell's centre from the nearest solid cell.

    d^2(p) = min over solid cells q of the sum over axes of f(p - q)^2, f(n) = max(|n| - 1/2, 0) * cell_m, computed
    axis by axis because the sum separates.
    [m^2] = [m]^2

    Args:
        is_solid: (nx, ny, nz) bool, index order ij.
        cell_m: Edge of the cubic cells [m].
        up_to_m: Greatest distance of interest [m]; larger ones are infinite.

    Returns:
        (nx, ny, nz) distance from centre to the surface of the nearest solid cell [m]; 0 inside one.

    Source:
        Our derivation; the separation is that of Felzenszwalb and Huttenlocher 2012, Distance transforms of sampled
        functions, doi:10.4086/toc.2012.v008a019, section 2.
    Held by:
        tests/unit/environment/paths/test_scoring_paths.py (against brute force)
    """
    squared_m2 = np.where(is_solid, np.float32(0.0), np.float32(np.inf))
    n_shifts = int(up_to_m / cell_m + 0.5) + 1
    for axis in range(3):
        nearest_m2 = squared_m2.copy()
        for n in range(1, min(n_shifts, is_solid.shape[axis] - 1) + 1):
            away_m2 = np.float32(np.square(max(n - 0.5, 0.0) * cell_m))
            near, far = (slice(None),) * axis + (slice(n, None),), (slice(None),) * axis + (slice(None, -n),)
            np.minimum(nearest_m2[near], squared_m2[far] + away_m2, out=nearest_m2[near])
            np.minimum(nearest_m2[far], squared_m2[near] + away_m2, out=nearest_m2[far])
        squared_m2 = nearest_m2
    distance_m = np.sqrt(squared_m2)
    distance_m[distance_m > up_to_m] = np.inf
    return distance_m


# 1 in cells that are too near to solids or faces, by the rules of `shortest_path`.
def _blocked(
    environment: Places, start: NDArray[np.float64], goal: NDArray[np.float64], clearance_m: float
) -> NDArray[np.uint8]:
    grid = environment.grid
    is_solid = environment.occupancy == Cell.SOLID
    # The small difference leaves cells exactly at the clearance, up to rounding, free.
    is_blocked = clearance_field_m(is_solid, grid.cell_m, up_to_m=clearance_m) < clearance_m - 1e-6
    for end in (start, goal):
        window = _window(grid, end, clearance_m + grid.cell_m)
        is_blocked[window] &= is_solid[window]
    for axis in range(3):
        # Whole layers of cells only, so that a line along a face at the distance of its ends stays free.
        low_m, high_m = grid.origin_m[axis], grid.max_m[axis]
        ends_m = (float(start[axis]), float(goal[axis]))
        n_low = int(max(0.0, min(clearance_m, *(end_m - low_m for end_m in ends_m))) / grid.cell_m + 1e-9)
        n_high = int(max(0.0, min(clearance_m, *(high_m - end_m for end_m in ends_m))) / grid.cell_m + 1e-9)
        layers = np.moveaxis(is_blocked, axis, 0)
        layers[:n_low] = True
        layers[layers.shape[0] - n_high :] = True
    return (is_blocked | is_solid).astype(np.uint8)


def _window(grid: Grid, centre: NDArray[np.float64], reach_m: float) -> tuple[slice, slice, slice]:
    low = np.maximum(grid.cell_of(centre - reach_m), 0)
    high = np.maximum(grid.cell_of(centre + reach_m) + 1, 0)
    x, y, z = (slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    return x, y, z


def _is_air(environment: Places, point: NDArray[np.float64]) -> bool:
    cell = environment.grid.cell_of(point)
    return bool(environment.grid.contains_cell(cell)) and environment.occupancy[tuple(cell)] != Cell.SOLID


# Ends the path at its first point within a distance of the goal.
def _cut_short(points_m: NDArray[np.float64], goal: NDArray[np.float64], within_m: float) -> NDArray[np.float64]:
    for i in range(1, len(points_m)):
        leg, offset = points_m[i] - points_m[i - 1], points_m[i - 1] - goal
        # |offset + t leg| = within_m, the smaller root.
        a, b, c = (
            float((leg * leg).sum()),
            float((offset * leg).sum()),
            float((offset * offset).sum()) - within_m * within_m,
        )
        if a == 0.0 or b * b < a * c:
            continue
        t = (-b - np.sqrt(b * b - a * c)) / a
        if 0.0 <= t <= 1.0:
            return np.concatenate([points_m[:i], [points_m[i - 1] + t * leg]])
    return points_m


# Moves each bend along the axes in ever smaller steps, as long as that shortens the path and both legs stay free, and
# drops unnecessary bends. Along the axes, because solids are cells: a bend then slides along their faces and edges
# instead of sticking to them.
def _tightened(points_m: NDArray[np.float64], cell_m: float, sees: Sees) -> NDArray[np.float64]:
    points = list(points_m)
    step_m = cell_m / 2
    for _ in range(_MAX_TIGHTENING_ROUNDS):
        has_moved = False
        for i in range(len(points) - 2, 0, -1):
            if sees(points[i - 1], points[i + 1]):
                del points[i]
                continue
            better = _better_bend(points[i - 1], points[i], points[i + 1], step_m, sees)
            has_moved |= better is not points[i]
            points[i] = better
        if not has_moved:
            step_m /= 2
        if step_m < _SMALLEST_STEP * cell_m:
            break
    return np.stack(points)


def _better_bend(
    before: NDArray[np.float64], bend: NDArray[np.float64], after: NDArray[np.float64], step_m: float, sees: Sees
) -> NDArray[np.float64]:
    best, best_m = bend, _length_m(before, bend, after)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            candidate = bend.copy()
            candidate[axis] += sign * step_m
            candidate_m = _length_m(before, candidate, after)
            if candidate_m < best_m and sees(before, candidate) and sees(candidate, after):
                best, best_m = candidate, candidate_m
    return best


def _length_m(*points: NDArray[np.float64]) -> float:
    return sum(norm3(*(b - a).tolist()) for a, b in pairwise(points))
