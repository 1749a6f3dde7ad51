"""Gas distribution maps: the mean and the variance of the gas at every place, from readings along a way."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.grids import CellGrid
from gslcosim.search.maps.kernel_dm_kernels import spread_readings

Array = NDArray[np.float64]


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
    Held by:
        tests/unit/search/maps/test_kernel_dm.py
    """

    def __init__(self, grid: CellGrid, widths: KernelWidths | None = None, *, max_readings: int | None = None) -> None:
        """Begin without readings, on a grid in the plane or in space; `max_readings` are kept, the last ones."""
        self.grid, self.widths = grid, widths or KernelWidths()
        self._rows: deque[tuple[float, float, float, float, float, float, float]] = deque(maxlen=max_readings)

    @property
    def n_readings(self) -> int:
        """How many readings there are."""
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
        share = np.exp(-self.widths.decay_per_s * (table[-1, 4] - table[:, 4]))
        omega, weighted = self._spread(place_m, values, wind_m_s, share)
        confidence = -np.expm1(-((omega / self.widths.confidence_scale) ** 2))
        mean = _blended(confidence, weighted, omega, float(values.mean()))
        squares = (values - mean[self._cells(place_m)]) ** 2
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
