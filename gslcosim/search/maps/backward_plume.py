"""How much gas of a source anywhere reaches a place, for all sources at once: the plume calculated backwards."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.maps.backward_plume_kernels import transport_band
from gslcosim.search.maps.banded_kernels import factorise_lu_inplace, solve_transposed_lu_inplace
from gslcosim.search.moving.grid_paths import Free

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PlumeModel:
    """A nominal plume in the plane: puffs per second, their eddy diffusivity, and how long they last on average."""

    puffs_per_s: float = 25.0
    diffusivity_m2_s: float = 0.025
    lifetime_s: float = 100.0


class BackwardPlume:
    """Tells what share of the time a puff of a source in any cell is in a given cell, in a steady wind.

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
