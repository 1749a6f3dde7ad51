# pyright: basic
"""Kernels on cubic cells for the planners of vehicles, of the referee and of agents.

Each planner has its own search, because a run reproduces its results to the bit: vehicles need one path between two
points (A*), agents the paths from one cell to all (Dial's buckets), and the referee the shortest way with bends
anywhere (Lazy Theta*). Their common parts are here: permitted steps, connected cells, bends to keep.
"""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, inline="always")
def is_step_free(cells, blocked, i, j, k, di, dj, dk):
    """Return whether a step to a neighbour cuts no corner: all cells of the block that it spans are free.

    Args:
        cells: (nx, ny, nz) array; index order ij. Outside of it nothing is free.
        blocked: Value of a cell that may not be crossed.
        i: Index of the cell to step from; so are `j` and `k`.
        j: See `i`.
        k: See `i`.
        di: Step along the first axis, -1, 0 or 1; so are `dj` and `dk`.
        dj: See `di`.
        dk: See `di`.

    Held by:
        tests/unit/base/test_cell_kernels.py
    """
    nx, ny, nz = cells.shape
    if i + di < 0 or j + dj < 0 or k + dk < 0 or i + di >= nx or j + dj >= ny or k + dk >= nz:
        return False
    for a in range(abs(di) + 1):
        for b in range(abs(dj) + 1):
            for c in range(abs(dk) + 1):
                if cells[i + a * di, j + b * dj, k + c * dk] == blocked:
                    return False
    return True


@numba.njit(cache=True, nogil=True, inline="always")
def keep_bends(points, is_leg_free, space):
    """Straighten a path: from each point that stays, go straight to the last one in sight and drop those between.

    Args:
        points: (n, d) path of at least one point.
        is_leg_free: Compiled function of `space` and two points: True if the straight line between them is free. It is
            bound when the caller is compiled, so no function is passed at run time.
        space: First argument of `is_leg_free`.

    Returns:
        (m, d) first point, bends, last point.

    Held by:
        tests/unit/base/test_cell_kernels.py
    """
    n = points.shape[0]
    kept = np.empty_like(points)
    kept[0] = points[0]
    n_kept, here = 1, 0
    while here < n - 1:
        point, ahead = points[here], n - 1
        while ahead > here + 1:
            if is_leg_free(space, point, points[ahead]):
                break
            ahead -= 1
        kept[n_kept] = points[ahead]
        n_kept += 1
        here = ahead
    return kept[:n_kept].copy()


@numba.njit(cache=True, nogil=True)
def label_parts(cells, blocked):
    """Label the connected parts of the free cells: cells of one part reach each other through faces.

    A step that cuts no corner passes faces of free cells, so no path leads from one part to another.

    Args:
        cells: (nx, ny, nz) array; index order ij.
        blocked: Value of a cell that is not free.

    Returns:
        (nx, ny, nz) int32, 0 where blocked, otherwise the label of the part, from 1 in the order of first cells.

    Held by:
        tests/unit/base/test_cell_kernels.py
    """
    nx, ny, nz = cells.shape
    parts = np.zeros((nx, ny, nz), np.int32)
    stack = np.empty(cells.size, np.int64)
    n_parts = 0
    for seed in range(cells.size):
        i, j, k = seed // (ny * nz), (seed // nz) % ny, seed % nz
        if cells[i, j, k] == blocked or parts[i, j, k] != 0:
            continue
        n_parts += 1
        parts[i, j, k] = n_parts
        stack[0], n_waiting = seed, 1
        while n_waiting > 0:
            n_waiting -= 1
            node = stack[n_waiting]
            i, j, k = node // (ny * nz), (node // nz) % ny, node % nz
            for side in range(6):
                a = i + (1 if side == 0 else (-1 if side == 1 else 0))
                b = j + (1 if side == 2 else (-1 if side == 3 else 0))
                c = k + (1 if side == 4 else (-1 if side == 5 else 0))
                if a < 0 or b < 0 or c < 0 or a >= nx or b >= ny or c >= nz:
                    continue
                if cells[a, b, c] != blocked and parts[a, b, c] == 0:
                    parts[a, b, c] = n_parts
                    stack[n_waiting] = (a * ny + b) * nz + c
                    n_waiting += 1
    return parts
