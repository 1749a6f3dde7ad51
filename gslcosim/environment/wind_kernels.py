"""Wind at a point by trilinear interpolation between cell centres; called by other kernels."""
# pyright: basic

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, inline="always")
def _bracket(coordinate_m, origin_m, cell_m, n):
    # Index of the lower cell centre and the weight of the upper one, clamped so that outside is as at the border.
    s = (coordinate_m - origin_m) / cell_m - 0.5
    if s <= 0.0:
        return 0, 0.0
    if s >= n - 1:
        return max(n - 2, 0), 1.0 if n > 1 else 0.0
    i = int(s)
    return i, s - i


@numba.njit(cache=True, nogil=True)
def trilinear_wind(velocity_m_s, origin_m, cell_m, x_m, y_m, z_m):
    """Interpolate the wind at one point from the eight cell centres around it.

    Outside the outermost centres the border value holds (no extrapolation).

    Args:
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s], float32; index order ij.
        origin_m: (3,) or tuple, corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        x_m: Point, world frame [m].
        y_m: Point, world frame [m].
        z_m: Point, world frame [m].

    Returns:
        (u, v, w) wind, world frame [m/s], float64.

    Held by:
        tests/unit/environment/test_wind_kernels.py (exact for linear fields, box of three side lengths)
    """
    nx, ny, nz, _ = velocity_m_s.shape
    i, a = _bracket(x_m, origin_m[0], cell_m, nx)
    j, b = _bracket(y_m, origin_m[1], cell_m, ny)
    k, c = _bracket(z_m, origin_m[2], cell_m, nz)
    i1 = min(i + 1, nx - 1)
    j1 = min(j + 1, ny - 1)
    k1 = min(k + 1, nz - 1)
    w000 = (1.0 - a) * (1.0 - b) * (1.0 - c)
    w100 = a * (1.0 - b) * (1.0 - c)
    w010 = (1.0 - a) * b * (1.0 - c)
    w110 = a * b * (1.0 - c)
    w001 = (1.0 - a) * (1.0 - b) * c
    w101 = a * (1.0 - b) * c
    w011 = (1.0 - a) * b * c
    w111 = a * b * c
    f = velocity_m_s
    u = (
        w000 * f[i, j, k, 0] + w100 * f[i1, j, k, 0] + w010 * f[i, j1, k, 0] + w110 * f[i1, j1, k, 0]
        + w001 * f[i, j, k1, 0] + w101 * f[i1, j, k1, 0] + w011 * f[i, j1, k1, 0] + w111 * f[i1, j1, k1, 0]
    )  # fmt: skip
    v = (
        w000 * f[i, j, k, 1] + w100 * f[i1, j, k, 1] + w010 * f[i, j1, k, 1] + w110 * f[i1, j1, k, 1]
        + w001 * f[i, j, k1, 1] + w101 * f[i1, j, k1, 1] + w011 * f[i, j1, k1, 1] + w111 * f[i1, j1, k1, 1]
    )  # fmt: skip
    w = (
        w000 * f[i, j, k, 2] + w100 * f[i1, j, k, 2] + w010 * f[i, j1, k, 2] + w110 * f[i1, j1, k, 2]
        + w001 * f[i, j, k1, 2] + w101 * f[i1, j, k1, 2] + w011 * f[i, j1, k1, 2] + w111 * f[i1, j1, k1, 2]
    )  # fmt: skip
    return u, v, w


@numba.njit(cache=True, nogil=True)
def trilinear_wind_at_points(velocity_m_s, origin_m, cell_m, points_world_m):
    """Interpolate the wind at many points; see `trilinear_wind`.

    Args:
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s].
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        points_world_m: (n, 3) points, world frame, xyz [m].

    Returns:
        (n, 3) wind, world frame [m/s], float64.
    """
    wind = np.empty((points_world_m.shape[0], 3))
    for p in range(points_world_m.shape[0]):
        u, v, w = trilinear_wind(
            velocity_m_s, origin_m, cell_m, points_world_m[p, 0], points_world_m[p, 1], points_world_m[p, 2]
        )
        wind[p, 0] = u
        wind[p, 1] = v
        wind[p, 2] = w
    return wind
