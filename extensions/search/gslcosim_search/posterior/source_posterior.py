"""Posterior over the places of a source, from readings with gas and without.

Held by:
    extensions/search/tests/unit/posterior/test_source_posterior.py
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim_search import beliefs, elementary
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.posterior import likelihood_kernels
from gslcosim_search.posterior.open_air import OpenAir

Array = NDArray[np.float64]
# Around the estimate, for its share [m].
_RADIUS_M = 1.0
# Rates: ln(rate) of the least in thresholds, and how far apart; and how finely a mean level is tabulated.
_LEAST_LOG_RATE, _RATE_STEP, _N_RATES, _ENTRIES_PER_RATE = -2.0, 0.8, 16, 16
# Mean level [1/m3 s] of a source of rate 1 that counts as none, and the largest that differs from larger ones, as a
# power of e above it.
_LEAST_LEVEL, _LARGEST_LOG = 3e-4, 16.0
# Spread s of the logarithm of levels, chance m to miss a plume that passes, density f of gas from elsewhere, and
# weight w of a reading among others like it; the steepness g of the chance that a level is below the threshold.
_LOG_SPREAD, _MISS_CHANCE, _STRAY_DENSITY, _WEIGHT = 1.0, 0.4, 1e-4, 0.15
_STEEPNESS = 1.6 / _LOG_SPREAD
# A share of e to the power of this counts as none.
_LEAST_LOG = -40.0
# The last bits of an exponential decide nothing: places that are equally good tie on every machine.
_DIGITS = 9
# Particles of a reading that was made, and of one that may be made.
_N_PARTICLES, _N_EXPECTED = 96, 48
_ENTRY_STEP = _RATE_STEP / _ENTRIES_PER_RATE


@dataclass(frozen=True, kw_only=True)
class SourceEstimate:
    """The most probable place of a source, world frame [m], and how far it is to be trusted.

    `share` is the probability within a metre of it in the plan. `advantage_nats` is how much better a source at one
    place explains the readings than gas that may be met anywhere, per reading with gas: negative where nothing does.
    """

    position_m: tuple[float, float, float]
    share: float
    advantage_nats: float
    n_gas: int


class SourcePosterior:
    """Probability of each cell to hold the source, given how air goes.

    gas:    (1 - m) t3(ln(level / Q c) / s) / s + f
    no gas: 1 - (1 - m) (1 - 1 / (1 + (Q c / threshold)^g))
    p(s) ~ sum over Q of (product over readings of these)^w

    c is the mean level at the reading for a source of rate 1 in the cell s (`OpenAir`), and the rate Q is unknown. t3
    is the density of Student's t with three degrees of freedom, s the spread of ln(level), m the chance to miss a plume
    that passes, f the density of gas from elsewhere, and w the weight of a reading among others like it.

    `advantage_nats` of the estimate compares with readings that are independent of the place: gas with the share that
    was met, of levels around their median.

    State: the logarithm of the product for each cell and rate, the air, and the levels of the readings with gas.

    Source:
        Bayesian estimation of a source's terms: Keats, Yee, Lien 2007, doi:10.1016/j.atmosenv.2006.08.044 (remembered,
        unverified). Robust terms and numbers are ours, chosen on the published tracks of seeds A and B of `open_2026`.
    """

    def __init__(self, air: OpenAir, *, threshold: float) -> None:
        """Begin without readings.

        Args:
            air: How air goes; its cells are the source's places.
            threshold: The least level that is gas, in the unit in which levels are added.
        """
        self.air, self._threshold = air, threshold
        n_cells = air.grid.n_cells
        self._log_likelihood, self._probability = np.zeros((n_cells, _N_RATES)), np.zeros((n_cells, _N_RATES))
        self._entries = np.zeros(n_cells, np.int64)
        self._table = np.zeros(int((_LARGEST_LOG + _RATE_STEP * _N_RATES) / _ENTRY_STEP))
        self._first_log = elementary.log(_LEAST_LEVEL) + _LEAST_LOG_RATE
        self._log_levels: list[float] = []
        self._n_readings = 0

    def add(self, time_s: float, position_m: Sequence[float], level: float) -> None:
        """Take note of a reading: when its air was at the nose [s], where that was [m], and its level."""
        self._find_entries(time_s, position_m, _N_PARTICLES)
        self._n_readings += 1
        if level > self._threshold:
            log_level = elementary.log(level / self._threshold)
            self._log_levels.append(log_level)
            likelihood_kernels.tabulate_gas_inplace(
                log_level - self._first_log, _ENTRY_STEP, _LOG_SPREAD, _MISS_CHANCE, _STRAY_DENSITY, self._table
            )
        else:
            self._tabulate_detection()
            self._table[:] = elementary.log_each(1.0 - self._table)
        likelihood_kernels.add_log_likelihood_inplace(
            self._entries, self._table, _ENTRIES_PER_RATE, self._log_likelihood
        )

    def best(self) -> SourceEstimate | None:
        """Return the place with the most probability around it; absent before there was gas."""
        n_gas = len(self._log_levels)
        if not n_gas:
            return None
        p, grid = self.p(), self.air.grid
        x_m, y_m, z_m = (grid.axis_m(axis) for axis in range(3))
        plan = CellGrid(grid.origin_m[:2], grid.cell_m, grid.shape[:2])
        shares = np.round(beliefs.ball_masses(p.sum(axis=2), plan, _RADIUS_M), _DIGITS)
        i, j = np.unravel_index(int(shares.argmax()), shares.shape)
        is_near = np.square(x_m - x_m[i])[:, None] + np.square(y_m - y_m[j])[None, :] <= _RADIUS_M * _RADIUS_M
        near = np.where(is_near[..., None], p, 0.0)
        near /= near.sum()
        place_m = tuple(
            float((near.sum(axis=others) * along_m).sum())
            for others, along_m in (((1, 2), x_m), ((0, 2), y_m), ((0, 1), z_m))
        )
        return SourceEstimate(
            position_m=(place_m[0], place_m[1], place_m[2]),
            share=min(1.0, float(shares[i, j])),
            advantage_nats=(float(self._log_likelihood.max()) - self._log_likelihood_anywhere()) / n_gas,
            n_gas=n_gas,
        )

    def p(self) -> Array:
        """Return the probability of each cell, (nx, ny, nz)."""
        self._weigh()
        return self._probability.sum(axis=1).reshape(self.air.grid.shape)

    def information_nats(self, time_s: float, places_m: Sequence[Sequence[float]]) -> Array:
        """Return what a reading at each of some places would tell of the source, by mutual information, (n,) [nat]."""
        self._weigh()
        self._tabulate_detection()
        gains_nats = np.zeros(len(places_m))
        for i, place_m in enumerate(places_m):
            self._find_entries(time_s, place_m, _N_EXPECTED)
            gains_nats[i] = likelihood_kernels.expected_information_nats(
                self._entries, self._table, _ENTRIES_PER_RATE, self._probability
            )
        return gains_nats

    def _find_entries(self, time_s: float, place_m: Sequence[float], n_particles: int) -> None:
        levels = self.air.levels_1_m3_s(time_s, place_m, n_particles=n_particles)
        likelihood_kernels.find_entries_inplace(levels, _LEAST_LEVEL, 1.0 / _ENTRY_STEP, self._entries)

    def _tabulate_detection(self) -> None:
        likelihood_kernels.tabulate_detection_inplace(
            -self._first_log, _ENTRY_STEP, _STEEPNESS, _MISS_CHANCE, self._table
        )

    def _weigh(self) -> None:
        likelihood_kernels.weigh_inplace(self._log_likelihood, _WEIGHT, _LEAST_LOG, self._probability)

    def _log_likelihood_anywhere(self) -> float:
        levels, n_gas = np.array(self._log_levels), len(self._log_levels)
        share, n_clean = n_gas / self._n_readings, self._n_readings - n_gas
        ratio = (levels - np.median(levels)) / _LOG_SPREAD
        density = share * likelihood_kernels.T3_PEAK / _LOG_SPREAD / np.square(1.0 + np.square(ratio) / 3.0)
        clean = n_clean * elementary.log1p(-share) if n_clean else 0.0
        return float(elementary.log_each(density).sum()) + clean
