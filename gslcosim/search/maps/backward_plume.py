# pyright: basic
"""Backward plume: the share of each source's gas that reaches a place, for all sources at once."""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.search.maps.banded_solver import factorise_lu_inplace, solve_transposed_lu_inplace
from gslcosim.search.motion.grid_paths import Free


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


Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PlumeModel:
    """A nominal plume in the plane: puffs per second, their eddy diffusivity, and how long they last on average."""

    puffs_per_s: float = 25.0
    diffusivity_m2_s: float = 0.025
    lifetime_s: float = 100.0


class BackwardPlume:
    """Gives the fraction of the time that a puff of a source in any cell is in a given cell, in a steady wind.

    A c = e_s for a source of one puff a second in cell s (A as of `transport_band`); c_m(s) = g_m(s), A^T g_m = e_m
    N = q h^2 g_m(s)        puffs in cell m on average: [1] = [1/s] [m2] [s/m2]
    share = 1 - exp(-N)     of the time at least one, where puffs come independently

    One solution of the transposed equations for each cell that is asked for serves all sources at once.

    State: the factors of A, for the wind it was made with.

    Source:
        The adjoint of the advection-diffusion equation; in place of the simulations of filaments of PMFS (Ojeda,
        Monroy, Gonzalez-Jimenez 2024, arXiv 2304.08879).
    Held by:
        tests/unit/search/maps/test_backward_plume.py
    """

    def __init__(self, free: Free, cell_m: float, wind_m_s: Array, model: PlumeModel) -> None:
        """Factorise the balance of gas.

        Args:
            free: (nx, ny) whether a cell is free.
            cell_m: Edge of the cells [m].
            wind_m_s: (nx, ny, 2) wind at the cell centres, world frame [m/s].
            model: The nominal plume.
        """
        self._free, self._puffs = free, model.puffs_per_s * cell_m**2
        self._numbers = _numbered(free)
        self._factors = transport_band(
            self._numbers,
            int(free.sum()),
            min(free.shape),
            np.ascontiguousarray(wind_m_s, np.float64),
            model.diffusivity_m2_s,
            1.0 / model.lifetime_s,
            cell_m,
        )
        factorise_lu_inplace(self._factors)

    def shares(self, cells: Sequence[Sequence[int]]) -> Array:
        """Return (n_cells, n_free) the share of the time with gas in each of some cells, by source.

        Args:
            cells: Free cells.

        Returns:
            Sources in the order of `array[free]`, C order of the free cells.
        """
        at = [int(self._numbers[tuple(cell)]) for cell in cells]
        values = np.zeros((len(self._factors), len(at)))
        values[at, np.arange(len(at))] = 1.0
        solve_transposed_lu_inplace(self._factors, values)
        return -np.expm1(-self._puffs * values[self._numbers[self._free]].T)


# Along the shorter axis first, so that the band is narrow.
def _numbered(free: Free) -> NDArray[np.int64]:
    if free.shape[0] < free.shape[1]:
        return np.ascontiguousarray(_numbered(free.T).T)
    numbers = np.full(free.shape, -1, np.int64)
    numbers[free] = np.arange(int(free.sum()))
    return numbers
