# pyright: basic
"""The source of a straight plume, as a probability over the floor, from readings with gas and without."""

# ruff: noqa: ANN001, ANN202 - kernels have no types

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.scalar_kernels import norm2
from gslcosim.contract.messages import Bounds
from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid

Array = NDArray[np.float64]
# Peak of the density of Student's t with three degrees of freedom.
_T3_PEAK = 2.0 / (math.pi * math.sqrt(3.0))
# Emission rates in units of the threshold, a factor 2.2 apart.
_LOG_RATES = -1.0 + 0.8 * np.arange(14)
# The last bits of an exponential decide nothing: places that are equally good tie on every machine.
_DIGITS = 9
# A larger room gets larger cells.
_CELL_M, _MAX_CELLS = 0.5, 4000
# Around the estimate, for its share [m].
_RADIUS_M = 1.0
# Width of the plume at its source w0 [m], how much wider it gets in a metre b, and how far gas reaches upwind l [m].
_WIDTH_M, _GROWTH, _UPWIND_M = 0.4, 0.15, 0.3
# Spread s of the logarithm of levels, chance m of no gas in the middle of the plume, density f of gas from elsewhere,
# and weight k of a reading.
_LOG_SPREAD, _MISS_CHANCE, _STRAY_DENSITY, _WEIGHT = 1.0, 0.5, 1e-3, 0.2
# The steepness of the chance that a level is below the threshold.
_STEEPNESS = 1.6 / _LOG_SPREAD
# A share of e to the power of this counts as none.
_LEAST_LOG = -40.0


@numba.njit(cache=True, nogil=True)
def _weigh_level(log_shape, log_rates, log_level, log_likelihood):
    for i in range(log_shape.size):
        for k in range(log_rates.size):
            ratio = (log_level - log_shape[i] - log_rates[k]) / _LOG_SPREAD
            tail = 1.0 + ratio * ratio / 3.0
            density = (1.0 - _MISS_CHANCE) * _T3_PEAK / (_LOG_SPREAD * tail * tail) + _STRAY_DENSITY
            log_likelihood[i, k] += elementary.log(density)


@numba.njit(cache=True, nogil=True)
def _weigh_clean_air(log_shape, log_rates, log_likelihood):
    factors = np.empty(log_rates.size)
    for k in range(log_rates.size):
        factors[k] = elementary.exp(_STEEPNESS * log_rates[k])
    for i in range(log_shape.size):
        shape = elementary.exp(_STEEPNESS * log_shape[i])
        for k in range(log_rates.size):
            below = 1.0 / (1.0 + shape * factors[k])
            log_likelihood[i, k] += elementary.log(_MISS_CHANCE + (1.0 - _MISS_CHANCE) * below)


@numba.njit(cache=True, nogil=True)
def _sum_over_rates(log_likelihood, top):
    total = np.zeros(log_likelihood.shape[0])
    for i in range(log_likelihood.shape[0]):
        for k in range(log_likelihood.shape[1]):
            exponent = _WEIGHT * (log_likelihood[i, k] - top)
            if exponent > _LEAST_LOG:
                total[i] += elementary.exp(exponent)
    return total


@dataclass(frozen=True, kw_only=True)
class FittedSource:
    """The most probable place of a source in the plan, world frame [m], and how far it is to be trusted.

    `share` is the probability within `radius_m` of it. `advantage_nats` is how much better the plume explains the
    readings than gas that may be met anywhere, per reading with gas: negative where there is no such plume.
    """

    position_m: tuple[float, float]
    share: float
    advantage_nats: float
    n_gas: int


class PlumeFit:
    """Probability of each cell of the floor to hold the source of a plume that goes straight with the wind.

    c(x, y) = (Q / w) exp(-y^2 / (2 w^2)) exp(min(x, 0) / l),  w = w0 + b max(x, 0)        a reading's mean level
    gas:    (1 - m) t3((ln c_read - ln c) / s) / s + f
    no gas: m + (1 - m) / (1 + exp(-1.6 (ln c_threshold - ln c) / s))
    p(cell) ~ sum over Q of (product over readings of these)^k

    x downwind and y across the wind of that reading from the cell [m]; Q unknown rate, w width, l upwind reach [m];
    t3 density of Student's t with three degrees of freedom, s spread of ln c, m chance to miss a plume that passes,
    f chance density of gas from elsewhere, k weight of a reading among others like it.

    In a room where air turns, gas comes from everywhere and no straight plume explains it: `advantage_nats` of the fit
    compares with readings that are independent of the place, gas with the share that was met, of levels around their
    median.

    State: the logarithm of the product for each cell and rate, and the levels of the readings with gas.

    Source:
        Bayesian estimation of a source's terms from a Gaussian plume: Keats, Yee, Lien 2007,
        doi:10.1016/j.atmosenv.2006.08.044; review by Hutchinson, Oh, Chen 2017, doi:10.1016/j.inffus.2016.11.010
        (both remembered, unverified). Robust terms and their numbers are ours, chosen on training flights of
        `open_2026_quick`.
    Held by:
        extensions/search/tests/unit/test_plume_fit.py
    """

    def __init__(
        self,
        bounds: Bounds,
        *,
        threshold: float,
    ) -> None:
        """Begin without readings.

        Args:
            bounds: Of the room; the source is in them.
            threshold: The least level that is gas, in the unit in which levels are added.
        """
        grid = CellGrid.covering(bounds, _CELL_M, max_cells=_MAX_CELLS)
        self._shape = grid.shape
        centres_m = grid.centres_m()
        self._x_m, self._y_m = centres_m[:, 0], centres_m[:, 1]
        reach = int(_RADIUS_M / grid.cell_m)
        offsets = [(i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)]
        self._disc = [(i, j) for i, j in offsets if norm2(i, j) * grid.cell_m <= _RADIUS_M]
        self._reach, self._threshold = reach, threshold
        self._log_likelihood = np.zeros((len(centres_m), len(_LOG_RATES)))
        self._log_levels: list[float] = []
        self._n_readings = 0

    def add(self, position_m: Sequence[float], level: float, downwind_rad: float) -> None:
        """Take note of a reading: its place, its level, and where the wind goes [rad]; at most a reading a second."""
        log_shape = self._log_shape(position_m, downwind_rad)
        self._n_readings += 1
        if level > self._threshold:
            log_level = elementary.log(level / self._threshold)
            self._log_levels.append(log_level)
            _weigh_level(log_shape, _LOG_RATES, log_level, self._log_likelihood)
        else:
            _weigh_clean_air(log_shape, _LOG_RATES, self._log_likelihood)

    def best(self) -> FittedSource | None:
        """Return the place with the most probability around it; absent before there was gas."""
        n_gas = len(self._log_levels)
        if not n_gas:
            return None
        top = float(self._log_likelihood.max())
        p = _sum_over_rates(self._log_likelihood, top)
        p = (p / p.sum()).reshape(self._shape)
        shares = np.round(self._sum_around(p), _DIGITS)
        i, j = np.unravel_index(int(shares.argmax()), self._shape)
        x_m, y_m = self._x_m.reshape(self._shape)[i, j], self._y_m.reshape(self._shape)[i, j]
        near = np.square(self._x_m - x_m) + np.square(self._y_m - y_m) <= _RADIUS_M * _RADIUS_M
        weights = np.where(near, p.ravel(), 0.0)
        place_m = (float(np.average(self._x_m, weights=weights)), float(np.average(self._y_m, weights=weights)))
        return FittedSource(
            position_m=place_m,
            share=min(1.0, float(shares[i, j])),
            advantage_nats=(top - self._log_likelihood_anywhere()) / n_gas,
            n_gas=n_gas,
        )

    # Logarithm of the mean level that a rate of one threshold gives at a place, for each cell of the source.
    def _log_shape(self, position_m: Sequence[float], downwind_rad: float) -> Array:
        cos, sin = elementary.cos(downwind_rad), elementary.sin(downwind_rad)
        dx_m, dy_m = position_m[0] - self._x_m, position_m[1] - self._y_m
        along_m, across_m = dx_m * cos + dy_m * sin, dy_m * cos - dx_m * sin
        width_m = _WIDTH_M + _GROWTH * np.maximum(along_m, 0.0)
        return (
            -0.5 * np.square(across_m / width_m) - elementary.log_each(width_m) + np.minimum(along_m, 0.0) / _UPWIND_M
        )

    def _log_likelihood_anywhere(self) -> float:
        levels, n_gas = np.array(self._log_levels), len(self._log_levels)
        share, n_clean = n_gas / self._n_readings, self._n_readings - n_gas
        ratio = levels - np.median(levels)
        gas = elementary.log_each(share * _T3_PEAK / np.square(1.0 + np.square(ratio) / 3.0)).sum()
        return float(gas) + (n_clean * elementary.log1p(-share) if n_clean else 0.0)

    def _sum_around(self, p: Array) -> Array:
        r, (nx, ny) = self._reach, self._shape
        padded = np.pad(p, r)
        total = np.zeros_like(p)
        for i, j in self._disc:
            total += padded[r + i : r + i + nx, r + j : r + j + ny]
        return total
