"""Gas maps of mean and variance, from readings spread by Gaussian kernels: Kernel DM+V and DM+V/W, in 2-D and 3-D."""
# pyright: basic

import math

import numba
import numpy as np

# Farther than so many standard deviations a kernel counts as 0: its weight is below 1e-12.
_REACH = 7.5


@numba.njit(cache=True, nogil=True)
def spread_readings(shape, origin_m, cell_m, place_m, values, wind_m_s, share, sigma_m, stretch_s):
    """Sum the kernels of readings over the cells of a grid, and the readings weighted by them.

    w_i(k) = share_i exp(-(p^2 / a^2 + q^2 / b^2) / 2)       pure number, 1 at a fresh reading's own place
    a = sigma + g |W_i|,  b = sigma (sigma / a)^(1 / (d - 1))       [m] = [m] + [s] [m/s], d dimensions: same volume
    Omega(k) = sum over i of w_i(k),  R(k) = sum over i of w_i(k) values_i
    p, q: parts of the offset of cell k from reading i along the wind and across it [m].

    Args:
        shape: (3,) number of cells (nx, ny, nz); nz = 1 in the plane, where heights do not count.
        origin_m: (3,) lower corner of the grid, world frame [m].
        cell_m: Edge of the cells [m].
        place_m: (n, 3) where the readings were made, world frame [m].
        values: (n,) readings, in any unit.
        wind_m_s: (n, 2) horizontal wind there, world frame [m/s]; zero for kernels that are round.
        share: (n,) what is left of each reading, 1 for fresh ones.
        sigma_m: Width of the round kernel sigma [m].
        stretch_s: g [s]; 0 for Kernel DM+V.

    Returns:
        (nx, ny, nz) Omega and R.

    Source:
        Lilienthal et al. 2009, IROS (Kernel DM+V); Reggente and Lilienthal 2009, IEEE Sensors (DM+V/W).
    Deviation:
        Kernels have the height 1, not the volume 1: the factor between drops out of all maps. In space the kernel is
        round across the wind.
    Held by:
        tests/unit/search/maps/test_kernel_dm.py (against the definition, cell by cell and reading by reading)
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    omega, weighted = np.zeros((nx, ny, nz)), np.zeros((nx, ny, nz))
    for n in range(place_m.shape[0]):
        speed = math.hypot(wind_m_s[n, 0], wind_m_s[n, 1])
        ux, uy = (wind_m_s[n, 0] / speed, wind_m_s[n, 1] / speed) if speed > 0.0 else (1.0, 0.0)
        along = sigma_m + stretch_s * speed
        across = sigma_m * sigma_m / along if nz == 1 else sigma_m * math.sqrt(sigma_m / along)
        reach = _REACH * max(along, across) / cell_m
        x = (place_m[n, 0] - origin_m[0]) / cell_m - 0.5
        y = (place_m[n, 1] - origin_m[1]) / cell_m - 0.5
        z = (place_m[n, 2] - origin_m[2]) / cell_m - 0.5 if nz > 1 else 0.0
        for i in range(max(0, math.ceil(x - reach)), min(nx, math.floor(x + reach) + 1)):
            dx = (i - x) * cell_m
            for j in range(max(0, math.ceil(y - reach)), min(ny, math.floor(y + reach) + 1)):
                dy = (j - y) * cell_m
                p, q = (dx * ux + dy * uy) / along, (dy * ux - dx * uy) / across
                plane = p * p + q * q
                for k in range(max(0, math.ceil(z - reach)), min(nz, math.floor(z + reach) + 1)):
                    r = (k - z) * cell_m / across
                    weight = share[n] * math.exp(-0.5 * (plane + r * r))
                    omega[i, j, k] += weight
                    weighted[i, j, k] += weight * values[n]
    return omega, weighted
