"""How near points are to solid cells."""
# pyright: basic

import math

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def least_distance(points_m, is_solid, origin_m, cell_m, up_to_m):
    """Return the smallest distance of any of the points to the faces of any solid cell [m].

    d = min over points p and solid cells q of sqrt(sum over axes of max(low_q - p, p - high_q, 0)^2)

    Args:
        points_m: (n, 3) points, world frame [m].
        is_solid: (nx, ny, nz) bool, index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        up_to_m: Cells farther away are not looked at [m].

    Returns:
        The distance, at most `up_to_m`; 0 inside a solid cell.

    Held by:
        tests/unit/benchmark/metrics/test_ways.py (against brute force)
    """
    least_m2 = up_to_m * up_to_m
    away_m2 = np.empty(3)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for p in range(points_m.shape[0]):
        reach_m = math.sqrt(least_m2)
        for a in range(3):
            low[a] = max(0, math.floor((points_m[p, a] - reach_m - origin_m[a]) / cell_m))
            high[a] = min(is_solid.shape[a], math.floor((points_m[p, a] + reach_m - origin_m[a]) / cell_m) + 1)
        for i in range(low[0], high[0]):
            away_m2[0] = _gap_m(points_m[p, 0], origin_m[0] + i * cell_m, cell_m) ** 2
            for j in range(low[1], high[1]):
                away_m2[1] = _gap_m(points_m[p, 1], origin_m[1] + j * cell_m, cell_m) ** 2
                for k in range(low[2], high[2]):
                    if is_solid[i, j, k]:
                        away_m2[2] = _gap_m(points_m[p, 2], origin_m[2] + k * cell_m, cell_m) ** 2
                        least_m2 = min(least_m2, away_m2.sum())
    return math.sqrt(least_m2)


@numba.njit(cache=True, nogil=True, inline="always")
def _gap_m(value_m, low_m, cell_m):
    return max(low_m - value_m, value_m - low_m - cell_m, 0.0)
