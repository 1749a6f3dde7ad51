"""Flood fill of an occupancy grid."""

# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
# pyright: basic

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def reachable_cells(is_open, seed_cells):
    """Return the open cells that are connected to seed cells through faces.

    Args:
        is_open: (nx, ny, nz) bool, cells that can be entered; index order ij.
        seed_cells: (n, 3) int64 cell indices inside the grid; seeds that are not open are passed over.

    Returns:
        (nx, ny, nz) bool, True where a seed's air reaches.

    Held by:
        tests/unit/environment/test_occupancy.py
    """
    nx, ny, nz = is_open.shape
    is_reached = np.zeros((nx, ny, nz), dtype=np.bool_)
    stack = np.empty((is_open.size, 3), dtype=np.int32)
    n_waiting = 0
    for s in range(seed_cells.shape[0]):
        i, j, k = seed_cells[s, 0], seed_cells[s, 1], seed_cells[s, 2]
        if is_open[i, j, k] and not is_reached[i, j, k]:
            is_reached[i, j, k] = True
            stack[n_waiting, 0], stack[n_waiting, 1], stack[n_waiting, 2] = i, j, k
            n_waiting += 1
    while n_waiting > 0:
        n_waiting -= 1
        i, j, k = stack[n_waiting, 0], stack[n_waiting, 1], stack[n_waiting, 2]
        for side in range(6):
            a = i + (1 if side == 0 else (-1 if side == 1 else 0))
            b = j + (1 if side == 2 else (-1 if side == 3 else 0))
            c = k + (1 if side == 4 else (-1 if side == 5 else 0))
            if a < 0 or b < 0 or c < 0 or a >= nx or b >= ny or c >= nz:
                continue
            if is_open[a, b, c] and not is_reached[a, b, c]:
                is_reached[a, b, c] = True
                stack[n_waiting, 0], stack[n_waiting, 1], stack[n_waiting, 2] = a, b, c
                n_waiting += 1
    return is_reached
