"""Shortest any-angle paths through free cells."""
# pyright: basic

import heapq
import math

import numba
import numpy as np

from gslcosim.environment.sight_kernels import is_line_of_sight_free


@numba.njit(cache=True, nogil=True, inline="always")
def _point_of(node, shape, origin_m, cell_m, start_node, start_m, goal_node, goal_m):
    # Cell centres, except that the path begins and ends at the very points.
    if node == start_node:
        return start_m[0], start_m[1], start_m[2]
    if node == goal_node:
        return goal_m[0], goal_m[1], goal_m[2]
    i, j, k = node // (shape[1] * shape[2]), (node // shape[2]) % shape[1], node % shape[2]
    return origin_m[0] + (i + 0.5) * cell_m, origin_m[1] + (j + 0.5) * cell_m, origin_m[2] + (k + 0.5) * cell_m


@numba.njit(cache=True, nogil=True, inline="always")
def _distance(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@numba.njit(cache=True, nogil=True)
def _is_step_free(blocked, i, j, k, di, dj, dk):
    # All cells of the block that a step to one of the 26 neighbours crosses: no corner is cut.
    nx, ny, nz = blocked.shape
    if not (0 <= i + di < nx and 0 <= j + dj < ny and 0 <= k + dk < nz):
        return False
    for a in range(2 if di != 0 else 1):
        for b in range(2 if dj != 0 else 1):
            for c in range(2 if dk != 0 else 1):
                if blocked[i + a * di, j + b * dj, k + c * dk] != 0:
                    return False
    return True


@numba.njit(cache=True, nogil=True)
def _points_back_to_start(end_node, parent, shape, origin_m, cell_m, start_node, start_m, goal_node, goal_m):
    n = 1
    node = end_node
    while node != start_node:
        node = parent[node]
        n += 1
    points_m = np.empty((n, 3))
    node = end_node
    for p in range(n - 1, -1, -1):
        point = _point_of(node, shape, origin_m, cell_m, start_node, start_m, goal_node, goal_m)
        points_m[p, 0], points_m[p, 1], points_m[p, 2] = point
        node = parent[node]
    return points_m


@numba.njit(cache=True, nogil=True)
def any_angle_path(blocked, origin_m, cell_m, start_m, goal_m, within_m):
    """Return a short way between two points through free cells, by straight legs of any direction.

    Lazy Theta*: A* over the 26 neighbours of each cell, where a cell's way may come straight from any earlier point
    that it sees. Bends lie at cell centres, so the way is longer than the shortest by about half a cell at each bend.

    Args:
        blocked: (nx, ny, nz) uint8, 1 where the way may not go, else 0; index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        start_m: (3,) where the way begins, world frame [m], in a free cell.
        goal_m: (3,) where it is to end, world frame [m].
        within_m: The way may end anywhere this near to the goal [m], >= 0.

    Returns:
        (n, 3) points of the way, world frame [m], the start first; (0, 3) when there is none.

    Source:
        Nash, Koenig and Tovey 2010, Lazy Theta*: any-angle path planning and path length analysis in 3D, AAAI, fig. 4.
    Held by:
        tests/unit/environment/paths/test_shortest.py (closed forms around one box)
    """
    nx, ny, nz = blocked.shape
    shape = (nx, ny, nz)
    si, sj, sk = (
        math.floor((start_m[0] - origin_m[0]) / cell_m),
        math.floor((start_m[1] - origin_m[1]) / cell_m),
        math.floor((start_m[2] - origin_m[2]) / cell_m),
    )
    gi, gj, gk = (
        math.floor((goal_m[0] - origin_m[0]) / cell_m),
        math.floor((goal_m[1] - origin_m[1]) / cell_m),
        math.floor((goal_m[2] - origin_m[2]) / cell_m),
    )
    start_node = (si * ny + sj) * nz + sk
    is_goal_inside = 0 <= gi < nx and 0 <= gj < ny and 0 <= gk < nz
    goal_node = (gi * ny + gj) * nz + gk if is_goal_inside else -1
    length_m = np.full(blocked.size, np.inf)
    parent = np.full(blocked.size, -1, dtype=np.int64)
    is_closed = np.zeros(blocked.size, dtype=np.bool_)
    goal = (goal_m[0], goal_m[1], goal_m[2])
    length_m[start_node] = 0.0
    parent[start_node] = start_node
    queue = [(0.0, start_node)]
    end_node = -1
    while len(queue) > 0:
        _, node = heapq.heappop(queue)
        if is_closed[node]:
            continue
        is_closed[node] = True
        here = _point_of(node, shape, origin_m, cell_m, start_node, start_m, goal_node, goal_m)
        i, j, k = node // (ny * nz), (node // nz) % ny, node % nz
        before = _point_of(parent[node], shape, origin_m, cell_m, start_node, start_m, goal_node, goal_m)
        if not is_line_of_sight_free(
            blocked, origin_m, cell_m, before[0], before[1], before[2], here[0], here[1], here[2]
        ):
            # The straight way that was hoped for is not there: come from the best neighbour instead.
            length_m[node] = np.inf
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    for dk in range(-1, 2):
                        if not _is_step_free(blocked, i, j, k, di, dj, dk):
                            continue
                        other = node + (di * ny + dj) * nz + dk
                        if not is_closed[other] or other == node:
                            continue
                        there = _point_of(other, shape, origin_m, cell_m, start_node, start_m, goal_node, goal_m)
                        through_m = length_m[other] + _distance(there, here)
                        if through_m < length_m[node]:
                            length_m[node] = through_m
                            parent[node] = other
        if _distance(here, goal) <= within_m or node == goal_node:
            end_node = node
            break
        origin_node = parent[node]
        corner = _point_of(origin_node, shape, origin_m, cell_m, start_node, start_m, goal_node, goal_m)
        for di in range(-1, 2):
            for dj in range(-1, 2):
                for dk in range(-1, 2):
                    if not _is_step_free(blocked, i, j, k, di, dj, dk):
                        continue
                    other = node + (di * ny + dj) * nz + dk
                    if is_closed[other]:
                        continue
                    there = _point_of(other, shape, origin_m, cell_m, start_node, start_m, goal_node, goal_m)
                    through_m = length_m[origin_node] + _distance(corner, there)
                    if through_m < length_m[other]:
                        length_m[other] = through_m
                        parent[other] = origin_node
                        left_m = max(0.0, _distance(there, goal) - within_m)
                        heapq.heappush(queue, (float(through_m + left_m), other))
    if end_node < 0:
        return np.empty((0, 3))
    return _points_back_to_start(end_node, parent, shape, origin_m, cell_m, start_node, start_m, goal_node, goal_m)
