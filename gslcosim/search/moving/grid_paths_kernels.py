"""Shortest paths from one cell over the free cells of a grid, what is seen from it, and room round obstacles."""
# pyright: basic

import math

import numba
import numpy as np

# Steps along one, two and three axes in whole numbers, so that equal paths are equal: 408 to the edge of a cell.
# 577/408 is the root of 2 to 2e-6, 707/408 that of 3 to 5e-4.
STEP_UNITS = (0, 408, 577, 707)
UNITS_PER_CELL = 408
NOT_REACHED = -1
_RING = 708  # more than the longest step, so that no two lengths that wait at one time share a bucket
_TOGETHER = 1e-9


@numba.njit(cache=True, nogil=True, inline="always")
def _is_step_free(free, i, j, k, di, dj, dk):
    nx, ny, nz = free.shape
    if i + di < 0 or j + dj < 0 or k + dk < 0 or i + di >= nx or j + dj >= ny or k + dk >= nz:
        return False
    for a in range(abs(di) + 1):
        for b in range(abs(dj) + 1):
            for c in range(abs(dk) + 1):
                if not free[i + a * di, j + b * dj, k + c * dk]:
                    return False
    return True


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
        tests/unit/search/moving/test_grid_paths.py (lengths of Dijkstra's algorithm in scipy on random grids)
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
            if step == 13 or not _is_step_free(free, i, j, k, di, dj, dk):
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
    """Tell whether a straight line passes through free cells only; where it meets an edge, all beside it count.

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
        tests/unit/search/moving/test_grid_paths.py (against points densely along lines)
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
        if not _is_step_free(free, i, j, k, di, dj, dk):
            return False
        if di != 0:
            i, tx = i + di, tx + step_x
        if dj != 0:
            j, ty = j + dj, ty + step_y
        if dk != 0:
            k, tz = k + dk, tz + step_z
    return False


@numba.njit(cache=True, nogil=True)
def seen_cells(free, first, reach_cells):
    """Mark the free cells whose centres are in plain sight of a cell's centre, and no farther than the reach.

    Args:
        free: (nx, ny, nz) bool, whether a cell is free; index order ij.
        first: Flat index of the cell that looks.
        reach_cells: Greatest distance between the centres [cells].

    Returns:
        (nx, ny, nz) bool, the looking cell among them when it is free.

    Held by:
        tests/unit/search/moving/test_grid_paths.py
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
def cells_with_room(free, clearance_cells):
    """Mark the free cells all of whose points keep a distance from every blocked cell.

    gap_a = max(|i_a - b_a| - 1, 0) on each axis a; kept when |gap| >= clearance        [cells] = [cells]

    Args:
        free: (nx, ny, nz) bool, whether a cell is free; index order ij. What lies outside the grid is no obstacle.
        clearance_cells: What is to be kept [cells].

    Returns:
        (nx, ny, nz) bool.

    Held by:
        tests/unit/search/moving/test_grid_paths.py
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


@numba.njit(cache=True, nogil=True)
def shortened(points, free):
    """Leave out the points of a path that it can pass by: from each point on straight to the last one that it sees.

    Args:
        points: (n, 3) path of at least one point, in cells from the grid's lower corner.
        free: (nx, ny, nz) bool, whether a cell is free; index order ij.

    Returns:
        (m, 3) first point, bends, last point [cells].

    Held by:
        tests/unit/search/moving/test_grid_paths.py
    """
    n = points.shape[0]
    kept = np.empty_like(points)
    kept[0], n_kept, here = points[0], 1, 0
    while here < n - 1:
        a = points[here]
        ahead = n - 1
        while ahead > here + 1:
            b = points[ahead]
            if is_line_free(free, a[0], a[1], a[2], b[0], b[1], b[2]):
                break
            ahead -= 1
        kept[n_kept] = points[ahead]
        n_kept += 1
        here = ahead
    return kept[:n_kept].copy()
