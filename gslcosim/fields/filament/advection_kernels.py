"""Wind at many filaments in single precision: twice as fast as in double, and as precise as the stored wind."""
# pyright: basic

import numba
import numpy as np

from gslcosim.environment.wind_kernels import trilinear_wind
from gslcosim.fields.filament.batch_kernels import Y, Z

_ONE = np.float32(1.0)
_1, _2, _3, _4, _5 = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4), np.uint64(5)


@numba.njit(cache=True, nogil=True)
def places_in_cells(position_m, origin_m, cell_m, place):
    """Tell where filaments are in units of cells, counted from the corner of the grid.

    Args:
        position_m: (3 n,) centres, world frame, x y z of one filament after the other [m].
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        place: (3 BATCH,) receives the places, axis after axis [1].
    """
    per_cell_m = 1.0 / cell_m
    for p in range(position_m.size // 3):
        place[p] = (position_m[3 * p] - origin_m[0]) * per_cell_m
        place[Y + p] = (position_m[3 * p + 1] - origin_m[1]) * per_cell_m
        place[Z + p] = (position_m[3 * p + 2] - origin_m[2]) * per_cell_m


@numba.njit(cache=True, nogil=True)
def _find_corners(place, n, nx, ny, nz, corner, weight):
    # The lowest of the eight cells whose centres are around each place, as an index into the flat wind, and the
    # upper cells' weights.
    last_x, last_y, last_z = nx - 1.0, ny - 1.0, nz - 1.0
    for p in range(n):
        x = min(max(place[p] - 0.5, 0.0), last_x)
        y = min(max(place[Y + p] - 0.5, 0.0), last_y)
        z = min(max(place[Z + p] - 0.5, 0.0), last_z)
        i, j, k = min(np.int64(x), nx - 2), min(np.int64(y), ny - 2), min(np.int64(z), nz - 2)
        weight[p], weight[Y + p], weight[Z + p] = np.float32(x - i), np.float32(y - j), np.float32(z - k)
        corner[p] = ((i * ny + j) * nz + k) * 3


@numba.njit(cache=True, nogil=True)
def _wind_between_corners(velocity_m_s, n, step_x, step_y, corner, weight, wind_m_s):
    # Unsigned offsets spare the test for negative indices.
    f = velocity_m_s
    for p in range(n):
        a, b, c = weight[p], weight[Y + p], weight[Z + p]
        w00, w10, w01, w11 = (_ONE - a) * (_ONE - b), a * (_ONE - b), (_ONE - a) * b, a * b
        q00 = np.uint64(corner[p])
        q10, q01, q11 = q00 + step_x, q00 + step_y, q00 + step_x + step_y
        low_u = w00 * f[q00] + w10 * f[q10] + w01 * f[q01] + w11 * f[q11]
        low_v = w00 * f[q00 + _1] + w10 * f[q10 + _1] + w01 * f[q01 + _1] + w11 * f[q11 + _1]
        low_w = w00 * f[q00 + _2] + w10 * f[q10 + _2] + w01 * f[q01 + _2] + w11 * f[q11 + _2]
        high_u = w00 * f[q00 + _3] + w10 * f[q10 + _3] + w01 * f[q01 + _3] + w11 * f[q11 + _3]
        high_v = w00 * f[q00 + _4] + w10 * f[q10 + _4] + w01 * f[q01 + _4] + w11 * f[q11 + _4]
        high_w = w00 * f[q00 + _5] + w10 * f[q10 + _5] + w01 * f[q01 + _5] + w11 * f[q11 + _5]
        wind_m_s[p] = (_ONE - c) * low_u + c * high_u
        wind_m_s[Y + p] = (_ONE - c) * low_v + c * high_v
        wind_m_s[Z + p] = (_ONE - c) * low_w + c * high_w


@numba.njit(cache=True, nogil=True)
def wind_at_filaments(velocity_m_s, place, n, corner, weight, wind_m_s):
    """Interpolate the wind at a batch of filaments from the eight cell centres around each.

    Outside the outermost centres the border value holds (no extrapolation).

    Args:
        velocity_m_s: (nx, ny, nz, 3) float32 wind at cell centres, C order, world frame [m/s]; index order ij; at
            least two cells along each axis (see `wind_at_filaments_in_flat_grid`).
        place: (3 BATCH,) where the filaments are, in cells from the corner of the grid, axis after axis [1].
        n: How many filaments, at most BATCH.
        corner: (BATCH,) int64 working memory.
        weight: (3 BATCH,) float32 working memory.
        wind_m_s: (3 BATCH,) float32, receives the wind, world frame, axis after axis [m/s].

    Deviation:
        The same interpolation as `environment.wind_kernels.trilinear_wind` with single-precision weights: the
        difference is about 1e-7 of the wind, the rounding of the stored values.
    Held by:
        tests/unit/fields/filament/test_advection_kernels.py (equals the double-precision one)
    """
    nx, ny, nz, _ = velocity_m_s.shape
    _find_corners(place, n, nx, ny, nz, corner, weight)
    step_x, step_y = np.uint64(ny * nz * 3), np.uint64(nz * 3)
    _wind_between_corners(velocity_m_s.reshape(-1), n, step_x, step_y, corner, weight, wind_m_s)


@numba.njit(cache=True, nogil=True)
def wind_at_filaments_in_flat_grid(velocity_m_s, origin_m, cell_m, position_m, wind_m_s):
    """Interpolate the wind at a batch of filaments in a grid that may be one cell thick.

    There is no upper neighbour in such a grid; they are rare, so they go the plain way.

    Args:
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s]; index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        position_m: (3 n,) centres, world frame, x y z of one filament after the other [m].
        wind_m_s: (3 BATCH,) float32, receives the wind, world frame, axis after axis [m/s].

    Held by:
        tests/unit/fields/filament/test_advection_kernels.py
    """
    for p in range(position_m.size // 3):
        x, y, z = position_m[3 * p], position_m[3 * p + 1], position_m[3 * p + 2]
        wind_m_s[p], wind_m_s[Y + p], wind_m_s[Z + p] = trilinear_wind(velocity_m_s, origin_m, cell_m, x, y, z)
