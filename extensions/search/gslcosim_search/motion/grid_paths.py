# pyright: basic
"""Paths over the free cells of a grid: shortest paths, reach, line of sight, and clearance of obstacles.

Free cells are arrays of truth values of the grid's shape, in two dimensions (nx, ny) or three (nx, ny, nz).

Held by:
    extensions/search/tests/unit/motion/test_grid_paths.py
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.cell_kernels import is_step_free, keep_bends
from gslcosim_search.beliefs import CellGrid

# Steps along one, two and three axes in whole numbers, so that equal paths are equal: 408 to the edge of a cell.
# 577/408 is the root of 2 to 2e-6, 707/408 that of 3 to 5e-4.
STEP_UNITS = (0, 408, 577, 707)
UNITS_PER_CELL = 408
NOT_REACHED = -1
_BLOCKED = False
_RING = 708  # more than the longest step, so that no two lengths that wait at one time share a bucket
_TOGETHER = 1e-9
Free = NDArray[np.bool_]
Point = Sequence[float] | NDArray[np.floating[Any]]


@numba.njit(cache=True, nogil=True)
def path_tree(free, first):
    """Find the shortest paths from one cell to all that can be reached by steps to neighbours which cut no corners.

    L(c) = min over neighbours n of L(n) + step(n, c)        [units] = [units] + [units], 408 units to a cell's edge

    Dijkstra's algorithm with buckets of equal length. A step along two axes is 577 units, along three 707; all cells
    of the block that it spans must be free. In a grid of one layer a cell has 8 neighbours, else 26.

    Args:
        free: (nx, ny, nz) bool, whether a cell is free; index order ij.
        first: Flat index of the cell to start from, a free one.

    Returns:
        length: (n_cells,) int64 length of the shortest path [units]; -1 where there is none.
        before: (n_cells,) int32 flat index of the cell before this one on it; the first cell's is its own, else -1.
        order: (n_reached,) int32 the cells that were reached, nearest first, so each stands after the one before it.

    Source:
        Dial 1969, Algorithm 360: shortest-path forest with topological ordering, doi:10.1145/363269.363610.
    Held by:
        extensions/search/tests/unit/motion/test_grid_paths.py (lengths of Dijkstra's algorithm in scipy on random
        grids)
    """
    _, ny, nz = free.shape
    n_cells = free.size
    length = np.full(n_cells, NOT_REACHED, np.int64)
    before = np.full(n_cells, -1, np.int32)
    order = np.empty(n_cells, np.int32)
    is_done = np.zeros(n_cells, np.bool_)
    bucket = np.full(_RING, -1, np.int32)
    left = np.full(n_cells, -1, np.int32)
    right = np.full(n_cells, -1, np.int32)
    length[first], before[first], bucket[0] = 0, first, first
    n_waiting, n_done, now = 1, 0, 0
    while n_waiting > 0:
        slot = now % _RING
        node = bucket[slot]
        if node < 0:
            now += 1
            continue
        bucket[slot] = right[node]
        if right[node] >= 0:
            left[right[node]] = -1
        n_waiting -= 1
        is_done[node] = True
        order[n_done] = node
        n_done += 1
        i, j, k = node // (ny * nz), (node // nz) % ny, node % nz
        for step in range(27):
            di, dj, dk = step // 9 - 1, (step // 3) % 3 - 1, step % 3 - 1
            if step == 13 or not is_step_free(free, _BLOCKED, i, j, k, di, dj, dk):
                continue
            other = ((i + di) * ny + j + dj) * nz + k + dk
            if is_done[other]:
                continue
            through = now + STEP_UNITS[abs(di) + abs(dj) + abs(dk)]
            if length[other] >= 0:
                if through >= length[other]:
                    continue
                if left[other] >= 0:
                    right[left[other]] = right[other]
                else:
                    bucket[length[other] % _RING] = right[other]
                if right[other] >= 0:
                    left[right[other]] = left[other]
                n_waiting -= 1
            length[other], before[other] = through, node
            slot = through % _RING
            left[other], right[other] = -1, bucket[slot]
            if bucket[slot] >= 0:
                left[bucket[slot]] = other
            bucket[slot] = other
            n_waiting += 1
    return length, before, order[:n_done].copy()


@numba.njit(cache=True, nogil=True, inline="always")
def _first_border(start, i, direction):
    # Share of the line up to the first border across one axis, and between two of them.
    if direction > 0.0:
        return (i + 1.0 - start) / direction, 1.0 / direction
    if direction < 0.0:
        return (i - start) / direction, -1.0 / direction
    return np.inf, np.inf


@numba.njit(cache=True, nogil=True, inline="always")
def _is_free_at(free, i, j, k):
    nx, ny, nz = free.shape
    return 0 <= i < nx and 0 <= j < ny and 0 <= k < nz and free[i, j, k]


@numba.njit(cache=True, nogil=True)
def is_line_free(free, ax, ay, az, bx, by, bz):
    """Return True if a straight line passes through free cells only; where it meets an edge, all beside it count.

    Args:
        free: (nx, ny, nz) bool, whether a cell is free; outside the grid nothing is.
        ax: First point, in cells from the grid's lower corner; so are the others.
        ay: Its second coordinate.
        az: Its third coordinate.
        bx: Last point.
        by: Its second coordinate.
        bz: Its third coordinate.

    Returns:
        True when no cell on the line is blocked, those of both ends among them.

    Source:
        Amanatides and Woo 1987, A fast voxel traversal algorithm for ray tracing.
    Held by:
        extensions/search/tests/unit/motion/test_grid_paths.py (against points densely along lines)
    """
    i, j, k = math.floor(ax), math.floor(ay), math.floor(az)
    dx, dy, dz = bx - ax, by - ay, bz - az
    tx, step_x = _first_border(ax, i, dx)
    ty, step_y = _first_border(ay, j, dy)
    tz, step_z = _first_border(az, k, dz)
    si, sj, sk = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1, 1 if dz > 0.0 else -1
    while _is_free_at(free, i, j, k):
        t = min(tx, ty, tz)
        if t >= 1.0 - _TOGETHER:
            return True
        di = si if tx - t < _TOGETHER else 0
        dj = sj if ty - t < _TOGETHER else 0
        dk = sk if tz - t < _TOGETHER else 0
        if not is_step_free(free, _BLOCKED, i, j, k, di, dj, dk):
            return False
        if di != 0:
            i, tx = i + di, tx + step_x
        if dj != 0:
            j, ty = j + dj, ty + step_y
        if dk != 0:
            k, tz = k + dk, tz + step_z
    return False


@numba.njit(cache=True, nogil=True)
def mark_visible_cells(free, first, reach_cells):
    """Mark the free cells whose centres are in plain sight of a cell's centre, and no farther than the reach.

    Args:
        free: (nx, ny, nz) bool, whether a cell is free; index order ij.
        first: Flat index of the cell that looks.
        reach_cells: Greatest distance between the centres [cells].

    Returns:
        (nx, ny, nz) bool, the looking cell among them when it is free.
    """
    nx, ny, nz = free.shape
    seen = np.zeros((nx, ny, nz), np.bool_)
    i0, j0, k0 = first // (ny * nz), (first // nz) % ny, first % nz
    reach = math.floor(min(reach_cells, 1e6))
    for i in range(max(0, i0 - reach), min(nx, i0 + reach + 1)):
        for j in range(max(0, j0 - reach), min(ny, j0 + reach + 1)):
            for k in range(max(0, k0 - reach), min(nz, k0 + reach + 1)):
                if not free[i, j, k] or (i - i0) ** 2 + (j - j0) ** 2 + (k - k0) ** 2 > reach_cells * reach_cells:
                    continue
                seen[i, j, k] = is_line_free(free, i0 + 0.5, j0 + 0.5, k0 + 0.5, i + 0.5, j + 0.5, k + 0.5)
    return seen


@numba.njit(cache=True, nogil=True)
def mark_clear_cells(free, clearance_cells):
    """Mark the free cells all of whose points keep a distance from every blocked cell.

    gap_a = max(|i_a - b_a| - 1, 0) on each axis a; kept when |gap| >= clearance        [cells] = [cells]

    Args:
        free: (nx, ny, nz) bool, whether a cell is free; index order ij. What lies outside the grid is no obstacle.

    Returns:
        (nx, ny, nz) bool.
    """
    nx, ny, nz = free.shape
    kept = free.copy()
    reach = math.ceil(clearance_cells) + 1
    least = clearance_cells * clearance_cells - _TOGETHER
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if free[i, j, k]:
                    continue
                for a in range(max(0, i - reach), min(nx, i + reach + 1)):
                    for b in range(max(0, j - reach), min(ny, j + reach + 1)):
                        for c in range(max(0, k - reach), min(nz, k + reach + 1)):
                            gi, gj, gk = max(abs(a - i) - 1, 0), max(abs(b - j) - 1, 0), max(abs(c - k) - 1, 0)
                            if gi * gi + gj * gj + gk * gk < least:
                                kept[a, b, c] = False
    return kept


@numba.njit(cache=True, nogil=True, inline="always")
def _is_leg_free(free, a, b):
    return is_line_free(free, a[0], a[1], a[2], b[0], b[1], b[2])


@numba.njit(cache=True, nogil=True)
def shorten_path(points, free):
    """Leave out the points of a path that it can pass by: from each point on straight to the last one that it sees.

    Args:
        points: (n, 3) path of at least one point, in cells from the grid's lower corner.
        free: (nx, ny, nz) bool, whether a cell is free; index order ij.

    Returns:
        (m, 3) first point, bends, last point [cells].
    """
    return keep_bends(points, _is_leg_free, free)


@dataclass(frozen=True, kw_only=True, eq=False)
class PathField:
    """The shortest paths from one cell to all others, as `path_tree` finds them.

    `length_m` is infinite where no path leads; `before` holds the flat index of the cell before each one, -1 where
    there is none and the first cell's own at the first cell; `order` the cells reached, nearest first.
    """

    first: int
    length_m: NDArray[np.float64]
    before: NDArray[np.int32]
    order: NDArray[np.int32]

    @property
    def is_reached(self) -> Free:
        """Cells that a path leads to, as flags."""
        return np.isfinite(self.length_m)

    def cells_to(self, cell: Sequence[int]) -> NDArray[np.int64]:
        """Return the cells of the path to a cell, (n, d), from the first to it; (0, d) when there is none."""
        node = int(np.ravel_multi_index(tuple(cell), self.length_m.shape))
        nodes: list[int] = []
        while self.before[node] >= 0:
            nodes.append(node)
            if node == self.first:
                break
            node = int(self.before[node])
        return np.stack(np.unravel_index(np.array(nodes[::-1], np.int64), self.length_m.shape), axis=-1)


def path_field(free: Free, grid: CellGrid, point_m: Point) -> PathField | None:
    """Return the shortest paths from the free cell nearest to a point; None when no cell is free.

    Lengths are those of steps between the centres of neighbouring cells, which cut no corners: up to 8 % longer in the
    plane than the shortest way, 13 % in space.
    """
    first = nearest_free(free, grid, point_m)
    return None if first is None else path_field_from(free, grid.cell_m, first)


def path_field_from(free: Free, cell_m: float, cell: Sequence[int]) -> PathField:
    """Return the shortest paths from one cell, a free one."""
    first = int(np.ravel_multi_index(tuple(cell), free.shape))
    length, before, order = path_tree(_in_3d(free), first)
    length_m = np.where(length == NOT_REACHED, np.inf, length * (cell_m / UNITS_PER_CELL)).reshape(free.shape)
    return PathField(first=first, length_m=length_m, before=before, order=order)


def reachable_cells(free: Free, grid: CellGrid, point_m: Point) -> Free:
    """Return the free cells that a path leads to from the free cell nearest to a point."""
    field = path_field(free, grid, point_m)
    return np.zeros_like(free) if field is None else field.is_reached


def nearest_free(free: Free, grid: CellGrid, point_m: Point) -> tuple[int, ...] | None:
    """Return the free cell whose centre is nearest to a point, of equally near ones the first; None without any."""
    cells = np.argwhere(free)
    if len(cells) == 0:
        return None
    centres_m = _origin_m(grid) + (cells + 0.5) * grid.cell_m
    away_m2 = np.square(centres_m - np.asarray(point_m)[: free.ndim]).sum(axis=1)
    return tuple(int(i) for i in cells[int(away_m2.argmin())])


def shortest_path(free: Free, grid: CellGrid, start_m: Point, goal_m: Point) -> NDArray[np.float64] | None:
    """Return the bends of a short way between two points, (n, d), both ends among them; None when there is none.

    The way is a shortest path over neighbouring cells, pulled straight wherever all cells on the straight line are
    free. An end that lies in no free cell is joined to the free cell nearest to it; a goal that does is left out, so
    the way then ends at that cell's centre.

    Args:
        free: Cells that the way may pass, of the grid's shape; see `inflate_obstacles`.
        start_m: Where the way begins, world frame [m].
    """
    field = path_field(free, grid, start_m)
    last = nearest_free(free, grid, goal_m)
    if field is None or last is None or not field.is_reached[last]:
        return None
    points_m: NDArray[np.float64] = _origin_m(grid) + (field.cells_to(last) + 0.5) * grid.cell_m
    ends_m = np.array([list(start_m)[: free.ndim], list(goal_m)[: free.ndim]], np.float64)
    if is_free_at(free, grid, goal_m):
        points_m = np.concatenate([points_m, ends_m[1:]])
    if is_free_at(free, grid, start_m):
        return _shortened(np.concatenate([ends_m[:1], points_m]), free, grid)
    return np.concatenate([ends_m[:1], _shortened(points_m, free, grid)])


def path_length_m(points_m: NDArray[np.float64]) -> float:
    """Return the length [m] of a way given by its points, (n, d)."""
    return float(np.linalg.norm(np.diff(points_m, axis=0), axis=1).sum())


def point_along(points_m: NDArray[np.float64], distance_m: float) -> NDArray[np.float64]:
    """Return the point of a way, (n, d), that is this far from its start; its end when the way is shorter."""
    for a, b in pairwise(points_m):
        piece_m = float(np.linalg.norm(b - a, axis=0))
        if piece_m > distance_m:
            return a + (b - a) * (distance_m / piece_m)
        distance_m -= piece_m
    return points_m[-1].copy()


def is_free_at(free: Free, grid: CellGrid, point_m: Point) -> bool:
    """Return True if a point lies in a free cell of the grid."""
    index = np.floor((np.asarray(point_m)[: free.ndim] - _origin_m(grid)) / grid.cell_m).astype(int)
    return bool((index >= 0).all() and (index < free.shape).all() and free[tuple(index)])


def is_visible(free: Free, grid: CellGrid, a_m: Point, b_m: Point) -> bool:
    """Return True if the straight line between two points passes through free cells only."""
    ends = _in_cells(np.array([list(a_m), list(b_m)], np.float64)[:, : free.ndim], grid)
    return bool(is_line_free(_in_3d(free), *ends[0], *ends[1]))


def visible_cells(free: Free, cell: Sequence[int], reach_cells: float = 1e6) -> Free:
    """Return the free cells whose centres are in plain sight of a cell's centre, within the reach [cells]."""
    first = int(np.ravel_multi_index(tuple(cell), free.shape))
    return mark_visible_cells(_in_3d(free), first, float(reach_cells)).reshape(free.shape)


def inflate_obstacles(free: Free, grid: CellGrid, clearance_m: float) -> Free:
    """Return the free cells all of whose points keep a distance from every blocked cell of the grid."""
    return mark_clear_cells(_in_3d(free), clearance_m / grid.cell_m).reshape(free.shape)


def _origin_m(grid: CellGrid) -> NDArray[np.float64]:
    return np.array(grid.origin_m, np.float64)


def _in_3d(free: Free) -> Free:
    return np.ascontiguousarray(free if free.ndim == 3 else free[:, :, None])


def _in_cells(points_m: NDArray[np.float64], grid: CellGrid) -> NDArray[np.float64]:
    cells = (points_m - _origin_m(grid)) / grid.cell_m
    if cells.shape[1] == 2:
        cells = np.concatenate([cells, np.full((len(cells), 1), 0.5)], axis=1)
    return cells


def _shortened(points_m: NDArray[np.float64], free: Free, grid: CellGrid) -> NDArray[np.float64]:
    cells = shorten_path(_in_cells(points_m, grid), _in_3d(free))
    return _origin_m(grid) + cells[:, : free.ndim] * grid.cell_m
