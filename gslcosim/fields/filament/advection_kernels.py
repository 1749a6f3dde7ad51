"""Wind at many filaments in single precision: twice as fast as in double, and as precise as the stored wind."""
# pyright: basic

import numba
import numpy as np

from gslcosim.environment.wind_kernels import trilinear_wind

_ONE = np.float32(1.0)
_THREE = np.uint64(3)


@numba.njit(cache=True, nogil=True)
def _wind_in_flat_grid(velocity_m_s, origin_m, cell_m, position_world_m, first, n, wind_m_s):
    # Grids that are one cell thick have no upper neighbour; they are rare, so they go the plain way.
    for p in range(n):
        x, y, z = position_world_m[first + p, 0], position_world_m[first + p, 1], position_world_m[first + p, 2]
        u, v, w = trilinear_wind(velocity_m_s, origin_m, cell_m, x, y, z)
        wind_m_s[p, 0] = u
        wind_m_s[p, 1] = v
        wind_m_s[p, 2] = w


@numba.njit(cache=True, nogil=True)
def wind_at_filaments(velocity_m_s, origin_m, cell_m, position_world_m, first, n, wind_m_s):
    """Interpolate the wind at filaments `first` to `first + n - 1` from the eight cell centres around each.

    Outside the outermost centres the border value holds (no extrapolation).

    Args:
        velocity_m_s: (nx, ny, nz, 3) float32 wind at cell centres, C order, world frame [m/s]; index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        position_world_m: (>= first + n, 3) filament centres, world frame, xyz [m].
        first: Index of the first filament.
        n: How many filaments.
        wind_m_s: (>= n, 3) float32, receives the wind, world frame [m/s].

    Deviation:
        The same interpolation as `environment.wind_kernels.trilinear_wind` with single-precision weights: the
        difference is about 1e-7 of the wind, the rounding of the stored values.
    Held by:
        tests/unit/fields/filament/test_advection_kernels.py (equals the double-precision one; grids one cell thick)
    """
    nx, ny, nz, _ = velocity_m_s.shape
    if min(nx, ny, nz) < 2:
        _wind_in_flat_grid(velocity_m_s, origin_m, cell_m, position_world_m, first, n, wind_m_s)
        return
    flat = velocity_m_s.reshape(-1)
    per_cell_m = 1.0 / cell_m
    # Unsigned offsets spare the compiler the test for negative indices; that and the short inner loop over the
    # three components are what lets it use vector instructions (13 ns a point instead of 21 ns written out).
    step_x, step_y = np.uint64(ny * nz * 3), np.uint64(nz * 3)
    for p in range(n):
        sx = min(max((position_world_m[first + p, 0] - origin_m[0]) * per_cell_m - 0.5, 0.0), nx - 1.0)
        sy = min(max((position_world_m[first + p, 1] - origin_m[1]) * per_cell_m - 0.5, 0.0), ny - 1.0)
        sz = min(max((position_world_m[first + p, 2] - origin_m[2]) * per_cell_m - 0.5, 0.0), nz - 1.0)
        i, j, k = min(np.int64(sx), nx - 2), min(np.int64(sy), ny - 2), min(np.int64(sz), nz - 2)
        a, b, c = np.float32(sx - i), np.float32(sy - j), np.float32(sz - k)
        q00 = np.uint64(i) * step_x + np.uint64(j) * step_y + np.uint64(k) * _THREE
        q10, q01, q11 = q00 + step_x, q00 + step_y, q00 + step_x + step_y
        w00, w10, w01, w11 = (_ONE - a) * (_ONE - b), a * (_ONE - b), (_ONE - a) * b, a * b
        for axis in range(3):
            m = np.uint64(axis)
            low = w00 * flat[q00 + m] + w10 * flat[q10 + m] + w01 * flat[q01 + m] + w11 * flat[q11 + m]
            m = np.uint64(axis + 3)
            high = w00 * flat[q00 + m] + w10 * flat[q10 + m] + w01 * flat[q01 + m] + w11 * flat[q11 + m]
            wind_m_s[p, axis] = (_ONE - c) * low + c * high
