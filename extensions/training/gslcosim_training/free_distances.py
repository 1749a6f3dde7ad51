# pyright: basic
"""Distances along free paths: how far every cell of a room is from a place for who goes around what is solid."""

# ruff: noqa: ANN001, ANN201 - kernels have no types

import heapq
import math

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.cell_kernels import is_step_free
from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid_kernels import is_line_of_sight_free
from gslcosim.environment.model import Cell
from gslcosim.environment.paths.scoring_paths import Places

_BLOCKED = 1


@numba.njit(cache=True, nogil=True)
def spread_distances(blocked, origin_m, cell_m, root_m, root_node, root_length_m):
    """Return the length of a short path from each cell's centre to a root, by straight legs through free cells.

    Theta* without a goal: Dijkstra's algorithm over the 26 neighbours, where a path may come straight from the last
    bend that the cell sees. So in an empty room lengths are straight distances; bends lie at cell centres.
    Cells that no path reaches, solid ones among them, lie as far as the nearest that one reaches, and the way there.

    Args:
        blocked: (nx, ny, nz) uint8, 1 where a path may not go, else 0; index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        root_m: (3,) where paths end, world frame [m].
        root_node: Flat index of the cell that holds it, which is free.
        root_length_m: What is added to all lengths [m].

    Returns:
        (nx, ny, nz) float32 lengths [m].

    Source:
        Daniel, Nash, Koenig and Felner 2010, Theta*: any-angle path planning on grids, JAIR 39, 533-579, fig. 2.
    Held by:
        extensions/training/tests/unit/test_free_distances.py
    """
    nx, ny, nz = blocked.shape
    length_m = np.full(blocked.size, np.inf)
    is_closed = np.zeros(blocked.size, dtype=np.bool_)
    # The last bend of each cell's path: the root where it is -1.
    bend = np.full(blocked.size, -1, dtype=np.int64)
    i, j, k = root_node // (ny * nz), (root_node // nz) % ny, root_node % nz
    dx_m = origin_m[0] + (i + 0.5) * cell_m - root_m[0]
    dy_m = origin_m[1] + (j + 0.5) * cell_m - root_m[1]
    dz_m = origin_m[2] + (k + 0.5) * cell_m - root_m[2]
    length_m[root_node] = root_length_m + math.sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m)
    queue = [(length_m[root_node], root_node)]
    while len(queue) > 0:
        _, node = heapq.heappop(queue)
        if is_closed[node]:
            continue
        is_closed[node] = True
        i, j, k = node // (ny * nz), (node // nz) % ny, node % nz
        last = bend[node]
        ax_m, ay_m, az_m, to_last_m = root_m[0], root_m[1], root_m[2], root_length_m
        if last >= 0:
            ax_m = origin_m[0] + (last // (ny * nz) + 0.5) * cell_m
            ay_m = origin_m[1] + ((last // nz) % ny + 0.5) * cell_m
            az_m = origin_m[2] + (last % nz + 0.5) * cell_m
            to_last_m = length_m[last]
        for di in range(-1, 2):
            for dj in range(-1, 2):
                for dk in range(-1, 2):
                    if not is_step_free(blocked, _BLOCKED, i, j, k, di, dj, dk):
                        continue
                    other = node + (di * ny + dj) * nz + dk
                    if is_closed[other]:
                        continue
                    bx_m = origin_m[0] + (i + di + 0.5) * cell_m
                    by_m = origin_m[1] + (j + dj + 0.5) * cell_m
                    bz_m = origin_m[2] + (k + dk + 0.5) * cell_m
                    if is_line_of_sight_free(blocked, origin_m, cell_m, ax_m, ay_m, az_m, bx_m, by_m, bz_m):
                        through_m = to_last_m + math.sqrt((bx_m - ax_m) ** 2 + (by_m - ay_m) ** 2 + (bz_m - az_m) ** 2)
                        by_bend = last
                    else:
                        through_m = length_m[node] + cell_m * math.sqrt(float(di * di + dj * dj + dk * dk))
                        by_bend = node
                    if through_m < length_m[other]:
                        length_m[other], bend[other] = through_m, by_bend
                        heapq.heappush(queue, (through_m, other))
    # What is left is reached from the cells that a path reaches, whose lengths stand.
    for node in range(blocked.size):
        if is_closed[node]:
            heapq.heappush(queue, (length_m[node], node))
    while len(queue) > 0:
        through_m, node = heapq.heappop(queue)
        if through_m > length_m[node]:
            continue
        is_closed[node] = True
        i, j, k = node // (ny * nz), (node // nz) % ny, node % nz
        for di in range(-1, 2):
            for dj in range(-1, 2):
                for dk in range(-1, 2):
                    if not (0 <= i + di < nx and 0 <= j + dj < ny and 0 <= k + dk < nz):
                        continue
                    other = node + (di * ny + dj) * nz + dk
                    through_m = length_m[node] + cell_m * math.sqrt(float(di * di + dj * dj + dk * dk))
                    if not is_closed[other] and through_m < length_m[other]:
                        length_m[other] = through_m
                        heapq.heappush(queue, (through_m, other))
    return length_m.reshape(blocked.shape).astype(np.float32)


def compute_free_distances_m(environment: Places, place_m: Vec3) -> NDArray[np.float32] | None:
    """Return how far each cell's centre is from a place, along free cells; nothing where no cell is free.

    A place in a solid cell, or outside, is reached from the nearest free one.

    Args:
        environment: A room, or a layer of its cells.
        place_m: The place, world frame [m].

    Returns:
        (nx, ny, nz) lengths [m]; see `spread_distances`.
    """
    grid, blocked = environment.grid, (environment.occupancy == Cell.SOLID).astype(np.uint8)
    free = np.flatnonzero(blocked.ravel() == 0)
    if not len(free):
        return None
    origin_m, root_m, length_m = np.asarray(grid.origin_m), np.asarray(place_m, np.float64), 0.0
    cell = np.floor((root_m - origin_m) / grid.cell_m).astype(np.int64)
    is_inside = bool(((cell >= 0) & (cell < blocked.shape)).all())
    if is_inside and blocked[tuple(cell)] == 0:
        node = int(np.ravel_multi_index(tuple(cell), blocked.shape))
    else:
        centres_m = origin_m + (np.stack(np.unravel_index(free, blocked.shape), axis=1) + 0.5) * grid.cell_m
        aways_m = np.sqrt(((centres_m - root_m) ** 2).sum(axis=1))
        nearest = int(np.argmin(aways_m))
        node, root_m, length_m = int(free[nearest]), centres_m[nearest], float(aways_m[nearest])
    return spread_distances(blocked, origin_m, grid.cell_m, root_m, node, length_m)
