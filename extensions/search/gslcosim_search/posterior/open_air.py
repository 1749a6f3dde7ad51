"""Air that goes everywhere with the wind of the moment, and the plume's levels that follow for each place of a source.

Held by:
    extensions/search/tests/unit/posterior/test_trajectories.py
"""

import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.rng import stream
from gslcosim.contract.messages import Bounds
from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.elementary import norm2
from gslcosim_search.posterior import trajectory_kernels

Array = NDArray[np.float64]
# Edge of the cells of the source's place [m]; a larger room gets larger ones.
_CELL_M, _MAX_CELLS = 0.5, 12_000
# Step of the trajectories [s], how many, and the standard deviation of their places around the nose [m].
_STEP_S, _N_STEPS, _SPREAD_M = 0.5, 180, 0.3
# Fluctuation of the air as a share of its wind and at least [m/s], and how long it lasts [s].
_INTENSITY, _LEAST_FLUCTUATION_M_S, _MEMORY_S = 0.1, 0.05, 2.0
# Share of a cell's time that goes to each neighbour: a particle stands for air as wide as a cell.
_SMOOTHING = 0.2
# Numbers in the ring of random numbers, and from a reading's first to the next reading's; prime to each other.
_N_NORMALS, _STRIDE = 1 << 16, 7919


class OpenAir:
    """Backward trajectories in the wind of the moment, of which its whole past is kept.

    c(s) = T(s) / V        mean level at a place for a source of rate 1 in the cell s of volume V

    T(s) is the mean time that the air has spent in the cell (`trajectory_kernels.add_residence_inplace`): the adjoint
    of the plume from s. Turbulence is a share of the wind, and a little where there is none.

    State: the wind of each step of time, and how many levels were asked for, which choose the random numbers.

    Source:
        Adjoint plumes: Keats, Yee, Lien 2007, doi:10.1016/j.atmosenv.2006.08.044 (remembered, unverified). Numbers are
        ours, chosen on the published tracks of seeds A and B of `open_2026`.
    """

    def __init__(self, bounds: Bounds) -> None:
        """Begin without wind, in the box of a room."""
        self.grid = CellGrid.covering(bounds, _CELL_M, 3, max_cells=_MAX_CELLS)
        self._low_m, self._high_m = np.array(bounds.min_m), np.array(bounds.max_m)
        self._residence_s, self._spare = np.zeros(self.grid.shape), np.zeros(self.grid.shape)
        self._winds_m_s: list[tuple[float, float, float]] = []
        self._begin_s = 0.0
        self._n_asked = 0

    @property
    def is_known(self) -> bool:
        """True once there was a wind."""
        return bool(self._winds_m_s)

    def note_wind(self, time_s: float, wind_m_s: Sequence[float]) -> None:
        """Take note of the wind from this time on, in the plane [m/s]; gaps before are filled with it."""
        if not self._winds_m_s:
            self._begin_s = time_s
        wind = (wind_m_s[0], wind_m_s[1], 0.0)
        n = max(1, math.floor((time_s - self._begin_s) / _STEP_S) + 1)
        self._winds_m_s.extend([wind] * (n - len(self._winds_m_s)))
        self._winds_m_s[-1] = wind

    def levels_1_m3_s(self, time_s: float, place_m: Sequence[float], *, n_particles: int) -> Array:
        """Return the mean level at a place and time for a source of rate 1 in each cell, (n_cells,); wind is known."""
        newest = min(max(math.floor((time_s - self._begin_s) / _STEP_S), 0), len(self._winds_m_s) - 1)
        winds_m_s = np.array(self._winds_m_s[max(0, newest - _N_STEPS + 1) : newest + 1])[::-1]
        # Before the first wind it was as it was then.
        earlier = np.broadcast_to(winds_m_s[-1], (_N_STEPS - len(winds_m_s), 3))
        speed_m_s = norm2(float(winds_m_s[0, 0]), float(winds_m_s[0, 1]))
        self._n_asked += 1
        self._residence_s[:] = 0.0
        trajectory_kernels.add_residence_inplace(
            np.clip(place_m, self._low_m, np.nextafter(self._high_m, self._low_m)), _SPREAD_M,
            np.concatenate([winds_m_s, earlier]), _STEP_S, self._low_m, self._high_m,
            _LEAST_FLUCTUATION_M_S + _INTENSITY * speed_m_s, elementary.exp(-_STEP_S / _MEMORY_S), _normals(),
            self._n_asked * _STRIDE, n_particles, self.grid.cell_m, self._residence_s,
        )  # fmt: skip
        trajectory_kernels.smooth_inplace(self._residence_s, _SMOOTHING, self._spare)
        return self._residence_s.reshape(-1) / (self.grid.cell_m * self.grid.cell_m * self.grid.cell_m)


@functools.cache
def _normals() -> Array:
    return stream(0, "posterior.trajectories").standard_normal(_N_NORMALS)
