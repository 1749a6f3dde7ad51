# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Kernel DM+V gas distribution maps: mean and variance of the gas everywhere, from readings on the way.

Held by:
    extensions/search/tests/unit/maps/test_kernel_dm.py
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Observation
from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.motion.grid_paths import Free
from gslcosim_search.senses.instruments import Nose, Vane

# Farther than so many standard deviations a kernel counts as 0: its weight is below 1e-12.
_REACH = 7.5
Array = NDArray[np.float64]
_ROUNDING_S = 1e-6


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
        extensions/search/tests/unit/maps/test_kernel_dm.py (against the definition, cell by cell and reading by
        reading)
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    omega, weighted = np.zeros((nx, ny, nz)), np.zeros((nx, ny, nz))
    for n in range(place_m.shape[0]):
        speed = math.sqrt(wind_m_s[n, 0] ** 2 + wind_m_s[n, 1] ** 2)
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
                    weight = share[n] * elementary.exp(-0.5 * (plane + r * r))
                    omega[i, j, k] += weight
                    weighted[i, j, k] += weight * values[n]
    return omega, weighted


@dataclass(frozen=True, kw_only=True)
class KernelWidths:
    """`sigma_m` is the width of a reading's kernel, `stretch_s` how much longer the wind makes it [m for each m/s].

    `confidence_scale` is how many fresh readings at a place make it known; `decay_per_s` how fast readings fade.
    """

    sigma_m: float = 0.38
    stretch_s: float = 0.0
    confidence_scale: float = 1.0
    decay_per_s: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class GasMaps:
    """Maps in the grid's shape: `mean` in the unit of the readings, `variance` in its square, `confidence` 0 to 1."""

    mean: Array
    variance: Array
    confidence: Array

    def peak(self, *, least_confidence: float = 0.5) -> tuple[int, ...] | None:
        """Return the cell with the largest variance among the known ones; None when the gas varies in none of them."""
        known = np.where(self.confidence > least_confidence, self.variance, 0.0)
        if not known.max() > 0.0:
            return None
        return tuple(int(i) for i in np.unravel_index(int(known.argmax()), known.shape))


class KernelMap:
    """Collects readings and maps their mean and variance.

    w_i(k), Omega, R as of `spread_readings`, with what is left of reading i, exp(-beta age)
    alpha = 1 - exp(-(Omega / scale)^2)                               confidence
    r = alpha R / Omega + (1 - alpha) r0,     r0 the mean of all readings
    v = alpha V / Omega + (1 - alpha) v0,     V = sum w_i (c_i - r(cell of i))^2, v0 the mean of these squares
    [u], [u2] for readings in u

    State: all readings, with place, wind and time.

    Source:
        Lilienthal, Reggente, Trincavelli, Blanco, Gonzalez 2009, A statistical approach to gas distribution modelling
        with mobile robots, IROS; Reggente and Lilienthal 2009, Using local wind information for gas distribution
        mapping, IEEE Sensors; Asadi et al. 2011 for the decay. Widths as in a public package [C].
    Deviation:
        The exponent of the confidence differs between public ports; this is the square of Omega over its scale, in
        units of the kernel's height.
    """

    def __init__(self, grid: CellGrid, widths: KernelWidths | None = None, *, max_readings: int | None = None) -> None:
        """Begin without readings, on a grid in the plane or in space; `max_readings` are kept, the last ones."""
        self.grid, self.widths = grid, widths or KernelWidths()
        self._rows: deque[tuple[float, float, float, float, float, float, float]] = deque(maxlen=max_readings)

    @property
    def n_readings(self) -> int:
        """Number of readings."""
        return len(self._rows)

    def add(
        self, place_m: Sequence[float], value: float, *, time_s: float = 0.0, wind_m_s: Sequence[float] = (0.0, 0.0)
    ) -> None:
        """Take note of a reading at a place, world frame [m], with the wind there [m/s]; broken ones are ignored."""
        if math.isfinite(value):
            x_m, y_m, z_m = (*place_m, 0.0)[:3]
            self._rows.append((x_m, y_m, z_m, value, time_s, wind_m_s[0], wind_m_s[1]))

    def maps(self) -> GasMaps:
        """Return the maps at the time of the last reading; zero everywhere without one."""
        shape = self.grid.shape
        if not self._rows:
            return GasMaps(mean=np.zeros(shape), variance=np.zeros(shape), confidence=np.zeros(shape))
        table = np.array(self._rows)
        place_m, values, wind_m_s = table[:, :3].copy(), table[:, 3].copy(), table[:, 5:].copy()
        share = elementary.exp_each(-self.widths.decay_per_s * (table[-1, 4] - table[:, 4]))
        omega, weighted = self._spread(place_m, values, wind_m_s, share)
        confidence = -elementary.expm1_each(-np.square(omega / self.widths.confidence_scale))
        mean = _blended(confidence, weighted, omega, float(values.mean()))
        squares = np.square(values - mean[self._cells(place_m)])
        _, spread = self._spread(place_m, squares, wind_m_s, share)
        variance = _blended(confidence, spread, omega, float(squares.mean()))
        return GasMaps(mean=mean.reshape(shape), variance=variance.reshape(shape), confidence=confidence.reshape(shape))

    def _spread(self, place_m: Array, values: Array, wind_m_s: Array, share: Array) -> tuple[Array, Array]:
        widths = self.widths
        return spread_readings(
            np.array((*self.grid.shape, 1)[:3]),
            np.array((*self.grid.origin_m, 0.0)[:3]),
            self.grid.cell_m,
            place_m,
            values,
            wind_m_s,
            share,
            widths.sigma_m,
            widths.stretch_s,
        )

    # Of readings outside of the grid the nearest cell.
    def _cells(self, place_m: Array) -> tuple[NDArray[np.int64], ...]:
        shape, origin_m = (*self.grid.shape, 1)[:3], (*self.grid.origin_m, 0.0)[:3]
        index = np.floor((place_m - np.array(origin_m)) / self.grid.cell_m)
        return tuple(np.clip(index, 0, np.array(shape) - 1).astype(np.int64).T)


def _blended(confidence: Array, sums: Array, omega: Array, elsewhere: float) -> Array:
    known = np.divide(sums, omega, out=np.zeros_like(sums), where=omega > 0.0)
    return confidence * known + (1.0 - confidence) * elsewhere


def warm_up() -> None:
    """Load or compile what a map runs, on a few cells, so that nothing is compiled in flight."""
    gas = KernelMap(CellGrid((0.0, 0.0), 1.0, (2, 2)))
    gas.add((1.0, 1.0), 1.0)
    gas.maps()


@dataclass(frozen=True, kw_only=True)
class PlacedReading:
    """Reading of a nose, placed where the vehicle was a lag before; the wind is that of the air there [m/s]."""

    place_m: Vec3
    value: float
    time_s: float
    wind_m_s: tuple[float, float]


class ReadingCollector:
    """Takes a reading every so often, at rest and on the way, and puts it where the gas was met.

    A sensor that lags shows what it met `lag_s` ago. A MOX sensor's reading is the mixing ratio that it suggests, or
    its conductance where the run offers no such estimate. The wind is what the anemometer feels and the vehicle's own
    velocity. Readings of a sensor that warms up are left out.

    State: where the vehicle was and what wind there was over the lag, and when the last reading was taken.

    Source:
        Shifting readings back by the lag: 2 to 3 s for MOX sensors, remembered, unverified [M].
    """

    def __init__(self, nose: Nose, vane: Vane | None = None, *, every_s: float, lag_s: float) -> None:
        """Begin without readings; without a vane the wind is zero."""
        self._nose, self._vane, self._every_s, self._lag_s = nose, vane, every_s, lag_s
        self._track: deque[tuple[float, Vec3, tuple[float, float]]] = deque()
        self._next_s = -np.inf
        self._last_tick: int | None = None

    def add(self, observation: Observation) -> PlacedReading | None:
        """Take note of an observation; return the reading, if one is due. A tick counts once."""
        if observation.tick == self._last_tick:
            return None
        self._last_tick = observation.tick
        self._track.append((observation.time_s, observation.position_world_m, self._wind(observation)))
        while len(self._track) > 1 and self._track[1][0] <= observation.time_s - self._lag_s + _ROUNDING_S:
            self._track.popleft()
        if observation.time_s < self._next_s - _ROUNDING_S or not self._nose.is_ready(observation):
            return None
        self._next_s = observation.time_s + self._every_s
        _, place_m, wind_m_s = self._track[0]
        return PlacedReading(
            place_m=place_m, value=self._nose.ppm(observation), time_s=observation.time_s, wind_m_s=wind_m_s
        )

    def _wind(self, observation: Observation) -> tuple[float, float]:
        if self._vane is None or not self._vane.is_ready(observation):
            return 0.0, 0.0
        x_m_s, y_m_s = self._vane.wind_world_m_s(observation)
        return x_m_s + observation.velocity_world_m_s[0], y_m_s + observation.velocity_world_m_s[1]


def choose_next_cell(
    maps: GasMaps, flyable: Free, lengths_m: NDArray[np.float64], *, curiosity: float, travel_per_m: float
) -> tuple[int, int] | None:
    """Return the cell to go to next: much gas, or not known, and not far; None where nothing can be flown to.

    worth(k) = r(k) + (curiosity (1 - alpha(k)) - travel L(k)) (max r - min r)
    [u] = [u] + (1 - [1/m] [m]) [u] for readings in u; where all r are equal their difference counts as 1

    Args:
        maps: Mean r and confidence alpha, (nx, ny).
        flyable: (nx, ny) cells that the vehicle can be sent to.
        way_m: (nx, ny) length L of the way there [m], infinite where there is none.
        curiosity: kappa: at 1 or more all cells are visited before the peak.
        travel_per_m: What a metre of way costs, as a share of the range of the map [1/m].

    Source:
        Sum of predicted gas and ignorance, common in informative path planning; the price of the way is ours.
    """
    possible = flyable & np.isfinite(lengths_m)
    if not possible.any():
        return None
    spread = float(maps.mean.max() - maps.mean.min()) or 1.0
    cost = np.where(possible, travel_per_m * lengths_m, 0.0)
    worth = maps.mean + (curiosity * (1.0 - maps.confidence) - cost) * spread
    i, j = np.unravel_index(int(np.where(possible, worth, -np.inf).argmax()), worth.shape)
    return int(i), int(j)
