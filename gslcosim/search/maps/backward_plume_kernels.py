"""The balance of gas that wind and eddies carry between the cells of a plane."""
# pyright: basic

import math

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, inline="always")
def _bernoulli(x):
    # x / (e^x - 1), which is 1 at 0; the series avoids the difference of nearly equal numbers.
    if abs(x) < 1e-4:
        return 1.0 - 0.5 * x + x * x / 12.0
    if x > 500.0:
        return 0.0
    return x / math.expm1(x)


@numba.njit(cache=True, nogil=True)
def transport_band(numbers, n_free, width, wind_m_s, diffusivity_m2_s, loss_per_s, cell_m):
    """Build the matrix of the steady balance of gas in the free cells of a plane, A c = release.

    sum over faces to free neighbours j of D (B(-Pe) c_i - B(Pe) c_j) + lambda h^2 c_i = release_i
    [m2/s] [1/m2] + [1/s] [m2] [1/m2] = [1/s]
    Pe = u h / D, u wind through the face away from i, B(x) = x / (e^x - 1)

    The flux between two cells is that of the steady one-dimensional equation between their centres, so no cell gets
    less than nothing at any wind. It enters both cells: what leaves one arrives in the other. Nothing passes walls and
    the edges of the grid; gas is lost at the rate lambda only.

    Args:
        numbers: (nx, ny) int64, number of each free cell, -1 in solid ones.
        n_free: How many free cells there are.
        width: Half the width of the band: no two neighbours' numbers differ by more.
        wind_m_s: (nx, ny, 2) wind at the cell centres, world frame [m/s].
        diffusivity_m2_s: Eddy diffusivity D [m2/s], > 0.
        loss_per_s: Rate lambda at which gas is lost [1/s], > 0.
        cell_m: Edge of the cells h [m].

    Returns:
        (n_free, 2 width + 1) band, band[i, width + j - i] = A[i, j], for `factorise_lu_inplace`.

    Source:
        Scharfetter and Gummel 1969, doi:10.1109/T-ED.1969.16566 (exponentially fitted fluxes).
    Held by:
        tests/unit/search/maps/test_backward_plume.py
    """
    nx, ny = numbers.shape
    band = np.zeros((n_free, 2 * width + 1))
    per_diffusion = 0.5 * cell_m / diffusivity_m2_s
    for i in range(nx):
        for j in range(ny):
            here = numbers[i, j]
            if here < 0:
                continue
            band[here, width] += loss_per_s * cell_m * cell_m
            for axis in range(2):
                a, b = i + 1 - axis, j + axis
                if a >= nx or b >= ny or numbers[a, b] < 0:
                    continue
                there = numbers[a, b]
                peclet = per_diffusion * (wind_m_s[i, j, axis] + wind_m_s[a, b, axis])
                leaving = diffusivity_m2_s * _bernoulli(-peclet)
                coming = diffusivity_m2_s * _bernoulli(peclet)
                band[here, width] += leaving
                band[here, width + there - here] -= coming
                band[there, width] += coming
                band[there, width + here - there] -= leaving
    return band
