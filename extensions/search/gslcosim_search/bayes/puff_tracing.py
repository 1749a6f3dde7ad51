# pyright: basic
"""Puff tracing: a source map from puffs of gas traced back with the wind, after Pang and Farrell.

Held by:
    extensions/search/tests/unit/bayes/test_puff_tracing.py
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid, distances_m, normalised_from_log
from gslcosim_search.senses.wind_field import WindField, WindRecord

# Beyond this many standard deviations a share is below 1e-15: such cells are left out.
REACH_SIGMAS = 8.0
# A product of many small factors must stay a number whose logarithm there is.
LEAST_PRODUCT = 1e-300
Array = NDArray[np.float64]


@numba.njit(cache=True)
def _normal_below(x):
    return 0.5 * elementary.erfc(-x * 0.7071067811865476)


@numba.njit(cache=True)
def _shares_on_axis(low_m, cell_m, n, centre_m, sigma_m, share):
    # Fills share[i] with the normal distribution's mass in cell i; returns the range of cells that it reaches.
    reach_m = REACH_SIGMAS * sigma_m
    first = min(n, max(0, math.floor((centre_m - reach_m - low_m) / cell_m)))
    last = min(n, max(0, math.floor((centre_m + reach_m - low_m) / cell_m) + 1))
    below = _normal_below((low_m + first * cell_m - centre_m) / sigma_m)
    for i in range(first, last):
        above = _normal_below((low_m + (i + 1) * cell_m - centre_m) / sigma_m)
        share[i] = above - below
        below = above
    return first, last


@numba.njit(cache=True)
def trace_puffs(low_m, cell_m, n_x, n_y, sensor_m, displacement_m, variance_m2, detection_probability, sensed_m2):
    """Return the likelihoods of a detection and of its absence for a source in each cell.

    S_i(l) = integral over cell i of N(s; x - V(l), diag(v_x(l), v_y(l))) ds
    detection: beta_i = (1 / n) sum over l of S_i(l)
    none: ln gamma_i = sum over l of ln(1 - mu min(1, a S_i(l) / A))
    [1] = [m2] [1/m2]; x sensor, V(l) displacement and v(l) variance of the puff released at time l, mu its chance to
    be detected where it is met, A area of a cell, a the area in which the sensor meets a puff.

    Args:
        low_m: (2,) lower corner of cell (0, 0), world frame, xy [m].
        n_x: Number of cells along x.
        n_y: Number of cells along y.
        sensor_m: (2,) place x of the measurement, world frame [m].
        displacement_m: (n_puffs, 2) how far the wind has carried each puff, world frame [m].
        variance_m2: (n_puffs, 2) variance of each puff's random displacement, by axis [m2], > 0.
        detection_probability: mu, from 0 to 1.
        sensed_m2: a, area in which a puff is met [m2].

    Returns:
        beta, (n_x, n_y), and ln gamma, (n_x, n_y); index order (x, y), values belong to whole cells.

    Source:
        Pang and Farrell 2006, Chemical plume source localization, IEEE Trans. SMC-B 36, 1068.
    Deviation:
        The paper takes the density at the cell's centre times its area. That exceeds 1 for a puff smaller than a cell,
        and 1 - mu S is then negative; the integral over the cell does not, and tends to the same in small cells.
        The paper meets a puff where it is in the sensor's cell, a = A; here cells may be smaller than what is met.
    Held by:
        extensions/search/tests/unit/bayes/test_puff_tracing.py (against a plain double loop)
    """
    mean_share = np.zeros((n_x, n_y))
    product = np.ones((n_x, n_y))
    share_x = np.empty(n_x)
    share_y = np.empty(n_y)
    n_puffs = displacement_m.shape[0]
    met = sensed_m2 / (cell_m * cell_m)
    for k in range(n_puffs):
        x_m, y_m = sensor_m[0] - displacement_m[k, 0], sensor_m[1] - displacement_m[k, 1]
        i_0, i_1 = _shares_on_axis(low_m[0], cell_m, n_x, x_m, math.sqrt(variance_m2[k, 0]), share_x)
        j_0, j_1 = _shares_on_axis(low_m[1], cell_m, n_y, y_m, math.sqrt(variance_m2[k, 1]), share_y)
        for i in range(i_0, i_1):
            for j in range(j_0, j_1):
                share = share_x[i] * share_y[j]
                mean_share[i, j] += share
                product[i, j] = max(
                    LEAST_PRODUCT, product[i, j] * (1.0 - detection_probability * min(1.0, met * share))
                )
    if n_puffs > 0:
        mean_share /= n_puffs
    for i in range(n_x):
        for j in range(n_y):
            product[i, j] = elementary.log(product[i, j])
    return mean_share, product


@numba.njit(cache=True)
def trace_back(sensor_m, n_steps, step_s, low_m, cell_m, wind_m_s):
    """Return the displacements of puffs that arrive at a position, through a steady wind that varies in space.

    p(m + 1) = p(m) - W(p(m)) dt,  V(m) = x - p(m)
    [m] = [m/s] [s]

    W is linear between the centres of cells, and beyond the outer ones as at the border; with one wind everywhere
    V(m) = m W dt. Walls are no obstacle.

    Args:
        sensor_m: (2,) place x of the measurement, world frame [m].
        step_s: Length of a step dt [s].
        low_m: (2,) lower corner of cell (0, 0), world frame, xy [m].
        wind_m_s: (n_x, n_y, 2) wind at the centres of the cells, world frame [m/s].

    Returns:
        (n_steps + 1, 2) displacements V(0) = 0, V(1), ..., world frame [m].

    Source:
        Ours: displacements along the path in place of one wind for the whole room.
    Accuracy:
        First order in dt (Euler).
    Held by:
        extensions/search/tests/unit/bayes/test_puff_tracing.py (a wind of two halves; between centres)
    """
    displacement_m = np.zeros((n_steps + 1, 2))
    n_x, n_y = wind_m_s.shape[0], wind_m_s.shape[1]
    x_m, y_m = sensor_m[0], sensor_m[1]
    for step in range(n_steps):
        a = min(max((x_m - low_m[0]) / cell_m - 0.5, 0.0), n_x - 1.0)
        b = min(max((y_m - low_m[1]) / cell_m - 0.5, 0.0), n_y - 1.0)
        i, j = min(int(a), max(n_x - 2, 0)), min(int(b), max(n_y - 2, 0))
        i_1, j_1 = min(i + 1, n_x - 1), min(j + 1, n_y - 1)
        a, b = a - i, b - j
        for axis in range(2):
            near = (1.0 - b) * wind_m_s[i, j, axis] + b * wind_m_s[i, j_1, axis]
            far = (1.0 - b) * wind_m_s[i_1, j, axis] + b * wind_m_s[i_1, j_1, axis]
            displacement_m[step + 1, axis] = displacement_m[step, axis] + ((1.0 - a) * near + a * far) * step_s
        x_m = sensor_m[0] - displacement_m[step + 1, 0]
        y_m = sensor_m[1] - displacement_m[step + 1, 1]
    return displacement_m


@dataclass(frozen=True, kw_only=True)
class PuffModel:
    """Model of travelling puffs: `step_s` between releases that are distinguished, over the last `window_s`.

    A puff is `initial_sigma_m` wide at birth and wanders by `spread_m_sqrt_s` times the root of its age, on each axis;
    where it is met, within `sensed_m2` of its place (absent: one cell), it is detected with `detection_probability`.
    With an initial size of 0 the puff that is released just now is left out: it has no extent.

    `hits` says what a detection tells of a cell: `chance`, the chance to detect gas of a source there, 1 - gamma, or
    `share`, beta of the paper. With `chance` a detection and its absence are outcomes of one model; beta is the greater
    the nearer a cell is, without a limit, and takes any gas for a source nearby.
    """

    step_s: float = 0.5
    window_s: float = 120.0
    initial_sigma_m: float = 0.0
    spread_m_sqrt_s: float = 0.2
    detection_probability: float = 0.9
    sensed_m2: float | None = None
    hits: str = "chance"

    @property
    def n_steps(self) -> int:
        """Number of steps in the window, at least one."""
        return max(1, round(self.window_s / self.step_s))

    @property
    def first_age(self) -> int:
        """From which age on puffs count [steps]: 0 with an initial size, else 1."""
        return 0 if self.initial_sigma_m > 0.0 else 1

    def variances_m2(self, n_displacements: int) -> Array:
        """Return (n, 2) variances of puffs of age 0, 1, 2, ... steps, by axis [m2].

        v(m) = s0^2 + s^2 m dt        [m2] = [m2] + [m2/s] [s]
        """
        ages_s = np.arange(n_displacements, dtype=np.float64) * self.step_s
        variance_m2 = self.initial_sigma_m * self.initial_sigma_m + self.spread_m_sqrt_s * self.spread_m_sqrt_s * ages_s
        return np.stack([variance_m2, variance_m2], axis=1)


def partial_sums_m(wind_m_s: Array, step_s: float) -> Array:
    """Return the displacement of puffs of each age by a wind that is uniform in space.

    V(0) = 0;  V(m) = sum of the last m winds dt        [m] = [m/s] [s]

    Args:
        wind_m_s: (n, 2) winds of the steps past, the oldest first, world frame [m/s].
        step_s: Length of a step dt [s].

    Returns:
        (n + 1, 2) displacements of puffs of age 0 to n steps, world frame [m].

    Source:
        Pang and Farrell 2006, IEEE Trans. SMC-B 36, 1068.
    """
    newest_first = wind_m_s[::-1] * step_s
    return np.concatenate([np.zeros((1, 2)), np.cumsum(newest_first, axis=0)])


def displacements_m(
    record: WindRecord, model: PuffModel, sensor_m: Sequence[float], *, field: WindField | None = None
) -> Array:
    """Return the displacements of puffs of age 0, 1, 2, ... steps that are at the sensor now, (n_steps + 1, 2) [m].

    Args:
        record: The wind so far, over at least the window, in steps of the model's length.
        model: Gives step and window.
        field: Without it the wind is the same everywhere, as in the paper, and was the mean one before it is known.
            With it puffs are traced back through this field.
    """
    if field is None:
        return partial_sums_m(record.window_m_s()[-model.n_steps :], model.step_s)
    grid, sensor = field.grid, np.array(sensor_m[:2], dtype=np.float64)
    return trace_back(sensor, model.n_steps, model.step_s, np.array(grid.origin_m), grid.cell_m, field.winds_m_s())


class SourceMap:
    """The probability of each cell to hold the source, kept as logarithms.

    A detection multiplies by (1 - f) beta / max(beta) + f, its absence by (1 - f) gamma + f, where f is a floor: no
    single measurement lowers a cell by more than that, for a wrong model must not rule out the true cell for good.
    With f 0 these are the rules of the paper.

    State: the logarithms, unnormalised, of the grid's shape; cells that cannot hold the source are minus infinity.

    Source:
        Pang and Farrell 2006, IEEE Trans. SMC-B 36, 1068; the floor is ours.
    Held by:
        extensions/search/tests/unit/bayes/test_puff_tracing.py (a map against brute force)
    """

    def __init__(self, grid: CellGrid, *, free: NDArray[np.bool_] | None = None, floor_frac: float = 0.0) -> None:
        """Begin with equal probabilities.

        Args:
            free: Which cells may hold the source; without it all of them.
            floor_frac: The floor f.
        """
        self.grid = grid
        self.log_p: Array = np.zeros(grid.shape)
        if free is not None and free.any():
            self.log_p[~free] = -np.inf
        self._floor_frac = floor_frac

    def probability(self) -> Array:
        """Return the probability of each cell, of the grid's shape."""
        return normalised_from_log(self.log_p)

    def detect(self, share: Array, *, weight: float = 1.0) -> None:
        """Take note of a detection; `share` is beta, or 1 - gamma. A detection that no cell explains says nothing."""
        highest = float(share[np.isfinite(self.log_p)].max(initial=0.0))
        if highest > 0.0:
            self.multiply(np.minimum(1.0, share / highest), weight=weight)

    def miss(self, log_share: Array, *, weight: float = 1.0) -> None:
        """Take note that nothing was detected; `log_share` is ln gamma."""
        self.multiply(elementary.exp_each(log_share), weight=weight)

    def reject(self, place_m: Sequence[float], radius_m: float, *, left_frac: float = 0.01) -> None:
        """Take note that the source is not within a radius of a place: so little of the probability is left there."""
        is_near = distances_m(self.grid, place_m) <= radius_m
        updated = self.log_p + np.where(is_near, elementary.log(left_frac), 0.0)
        self.log_p = updated - float(updated.max())

    def multiply(self, likelihood: Array, *, weight: float = 1.0) -> None:
        """Multiply by a likelihood between 0 and 1, raised to the floor, and then to the power of a weight."""
        floored = (1.0 - self._floor_frac) * likelihood + self._floor_frac
        updated = self.log_p + weight * elementary.log_each(floored)
        highest = float(updated.max())
        # Measurements that together rule out every cell are a wrong model, not a proof: the map stays as it was.
        if math.isfinite(highest):
            self.log_p = updated - highest


def footprint(model: PuffModel, travelled_m: Array, cell_m: float, shape: Sequence[int]) -> Array:
    """Return the chance to detect gas of a source at each offset from the sensor, by what the wind has been like.

    F(o) = 1 - gamma(o)        gamma as in `trace_puffs`, for a source in the cell at the offset o

    Args:
        model: How puffs spread, and how surely they are detected.
        travelled_m: (n, 2) displacements of puffs of age 0, 1, ... steps [m].
        shape: (nx, ny) of the grid in which the sensor may be anywhere.

    Returns:
        (2 nx - 1, 2 ny - 1), the sensor's own cell in the middle.
    """
    n_x, n_y = 2 * shape[0] - 1, 2 * shape[1] - 1
    low_m = np.array([-0.5 * n_x * cell_m, -0.5 * n_y * cell_m])
    variance_m2, first = model.variances_m2(len(travelled_m)), model.first_age
    sensed_m2 = cell_m * cell_m if model.sensed_m2 is None else model.sensed_m2
    _, log_share = trace_puffs(
        low_m, cell_m, n_x, n_y, np.zeros(2), travelled_m[first:], variance_m2[first:],
        model.detection_probability, sensed_m2,
    )  # fmt: skip
    return -elementary.expm1_each(log_share)


def update(
    source_map: SourceMap,
    model: PuffModel,
    sensor_m: Sequence[float],
    travelled_m: Array,
    *,
    is_hit: bool,
    weight: float = 1.0,
) -> None:
    """Update a map by one measurement.

    Args:
        model: How puffs spread, and how surely they are detected.
        travelled_m: (n, 2) displacements of puffs of age 0, 1, ... steps; see `displacements_m`.
        is_hit: Whether gas was detected.
        weight: What the measurement counts among others like it, from 0 to 1.
    """
    grid, first = source_map.grid, model.first_age
    variance_m2 = model.variances_m2(len(travelled_m))
    low_m, sensor = np.array(grid.origin_m[:2]), np.array(sensor_m[:2], dtype=np.float64)
    n_x, n_y = grid.shape
    sensed_m2 = grid.cell_m * grid.cell_m if model.sensed_m2 is None else model.sensed_m2
    mean_share, log_share = trace_puffs(
        low_m, grid.cell_m, n_x, n_y, sensor, travelled_m[first:], variance_m2[first:],
        model.detection_probability, sensed_m2,
    )  # fmt: skip
    if is_hit:
        share = -elementary.expm1_each(log_share) if model.hits == "chance" else mean_share
        source_map.detect(share, weight=weight)
    else:
        source_map.miss(log_share, weight=weight)


def warm_up() -> None:
    """Compile the kernels, or load them from the cache on disk, so that no decision has to wait for it."""
    tiny = SourceMap(CellGrid((0.0, 0.0), 1.0, (2, 2)))
    update(tiny, PuffModel(), (1.0, 1.0), np.zeros((2, 2)), is_hit=True)
    trace_back(np.zeros(2), 1, 1.0, np.array(tiny.grid.origin_m), 1.0, np.zeros((2, 2, 2)))
