# pyright: basic
"""Particle filter of source positions, after Li, Meng, Wang and Zeng.

Held by:
    extensions/search/tests/unit/bayes/test_particle_filter.py
"""

# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations

import math
from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Bounds
from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid, normalised, normalised_from_log

# Beyond this exponent, 2e-9, a puff changes no weight that matters.
FARTHEST_EXPONENT = 20.0
LEAST_PRODUCT = 1e-300
Array = NDArray[np.float64]
# A detection that no particle explains keeps them all: ln of a share that is as good as none.
_LEAST_LOG = -700.0


@numba.njit(cache=True)
def log_miss_of_particles(place_m, sensor_m, displacement_m, variance_m2, detection_probability, sensed_m2):
    """Return the logarithm of the chance to detect nothing, for a source at each particle.

    ln gamma(s) = sum over l of ln(1 - min(1, mu S N(x - s; V(l), diag(v_x(l), v_y(l)))))
    [1] = [m2] [1/m2]; x sensor, V(l) and v(l) displacement and variance of the puff released at time l

    Args:
        place_m: (n, 2) places s of particles, world frame [m].
        sensor_m: (2,) place x of the measurement, world frame [m].
        displacement_m: (n_puffs, 2) how far the wind has carried each puff, world frame [m].
        variance_m2: (n_puffs, 2) variance of each puff's random displacement, by axis [m2], > 0.
        detection_probability: mu, from 0 to 1.
        sensed_m2: Area S in which the sensor meets a puff [m2].

    Returns:
        (n,) logarithms; that of a detection is ln(1 - exp(ln gamma)), see `log_hit`.

    Source:
        Li, Meng, Wang, Zeng 2011, Odor source localization using a mobile robot in outdoor airflow environments with
        a particle filter algorithm, Autonomous Robots 30, 281 (weights as in the MAPIR group's public code [C]).
    Deviation:
        mu S N is kept below 1, which small puffs would exceed.
    """
    n, n_puffs = place_m.shape[0], displacement_m.shape[0]
    log_miss = np.empty(n)
    centre_m = np.empty((n_puffs, 2))
    half_per_m2 = np.empty((n_puffs, 2))
    height = np.empty(n_puffs)
    for k in range(n_puffs):
        area_m2 = math.sqrt(variance_m2[k, 0] * variance_m2[k, 1])
        height[k] = detection_probability * sensed_m2 / (2.0 * math.pi * area_m2)
        for axis in range(2):
            centre_m[k, axis] = sensor_m[axis] - displacement_m[k, axis]
            half_per_m2[k, axis] = 0.5 / variance_m2[k, axis]
    for p in range(n):
        product = 1.0
        for k in range(n_puffs):
            dx_m, dy_m = place_m[p, 0] - centre_m[k, 0], place_m[p, 1] - centre_m[k, 1]
            exponent = dx_m * dx_m * half_per_m2[k, 0] + dy_m * dy_m * half_per_m2[k, 1]
            if exponent < FARTHEST_EXPONENT:
                product = max(LEAST_PRODUCT, product * (1.0 - min(1.0, height[k] * elementary.exp(-exponent))))
        log_miss[p] = elementary.log(product)
    return log_miss


@numba.njit(cache=True)
def systematic_indices(weight, offset):
    """Return which particles go on, each about as often as its weight says.

    Particle i is taken for each k with  sum of w up to i - 1  <=  (k + u) / n  <  sum of w up to i        u offset
    Each is taken floor(n w) or ceil(n w) times.

    Args:
        weight: (n,) weights, none negative, sum 1.
        offset: u, uniform in [0, 1).

    Returns:
        (n,) int64 indices, ascending.

    Source:
        Kitagawa 1996, Monte Carlo filter and smoother, doi:10.1080/10618600.1996.10474692.
    """
    n = weight.shape[0]
    index = np.empty(n, np.int64)
    i, total = 0, weight[0]
    for k in range(n):
        while total <= (k + offset) / n and i < n - 1:
            i += 1
            total += weight[i]
        index[k] = i
    return index


def wind_spread_m_sqrt_s(winds_m_s: Array, step_s: float, least_m_sqrt_s: float) -> Array:
    """Return the spread of puffs per square root of time, by axis, in a wind with independent random steps.

    s^2 = max(var(W) dt, least^2)        [m2/s] = [m2/s2] [s]

    Steps that vary independently with variance var(W) displace by m steps with variance m var(W) dt^2 = s^2 (m dt).

    Args:
        winds_m_s: (n, 2) winds of equal steps [m/s].
        step_s: Their length dt [s].
        least_m_sqrt_s: What eddies do that no anemometer sees [m / sqrt(s)].

    Source:
        The weights of Li, Meng et al. 2011 have the wind's standard deviation per axis, for steps of 1 s.
    """
    if len(winds_m_s) < 2:
        return np.full(2, least_m_sqrt_s)
    return np.maximum(winds_m_s.std(axis=0) * math.sqrt(step_s), least_m_sqrt_s)


def puff_variances_m2(n: int, step_s: float, spread_m_sqrt_s: Array, first_sigma_m: float) -> Array:
    """Return (n, 2) variances of puffs of age 0, 1, 2, ... steps: v(m) = first^2 + s^2 m dt, by axis [m2]."""
    ages_s = np.arange(n, dtype=np.float64) * step_s
    return first_sigma_m * first_sigma_m + ages_s[:, None] * np.square(spread_m_sqrt_s)


def newborn_area_m2(first_sigma_m: float) -> float:
    """Return the area that a puff covers when it is released: S = 2 pi s0^2 [m2].

    The integral of exp(-r^2 / (2 s0^2)) over the plane: an even disc of it has the middle and the amount of the puff.
    In `log_miss_of_particles` a puff that was released at the sensor is then detected with the probability mu.
    """
    return 2.0 * math.pi * first_sigma_m * first_sigma_m


class ParticleCloud:
    """Places where the source may be, with weights; none before the first detection.

    State: places and the logarithms of weights, and the generator of its random numbers.

    Source:
        Li, Meng, Wang, Zeng 2011, Autonomous Robots 30, 281; figures of the MAPIR group's code [C].
    """

    def __init__(self, n_particles: int, bounds: Bounds, rng: np.random.Generator) -> None:
        """Begin without particles; they will lie within the bounds."""
        self.places_m: Array = np.zeros((0, 2))
        self._log_weights: Array = np.zeros(0)
        self._n, self._rng = n_particles, rng
        self._min_m, self._max_m = np.array(bounds.min_m[:2]), np.array(bounds.max_m[:2])

    @property
    def is_born(self) -> bool:
        """True if there are particles."""
        return len(self.places_m) > 0

    def weights(self) -> Array:
        """Return the weights; their sum is 1."""
        return normalised_from_log(self._log_weights)

    def n_effective(self) -> float:
        """Return the effective number of particles: 1 / sum of w^2."""
        return 1.0 / float(np.square(self.weights()).sum())

    def mean_m(self) -> tuple[float, float]:
        """Return the weighted mean place, world frame [m]."""
        x_m, y_m = elementary.product(self.weights(), self.places_m)
        return float(x_m), float(y_m)

    def clear(self) -> None:
        """Forget all particles: they were in the wrong place."""
        self._put(np.zeros((0, 2)))

    def scatter(self) -> None:
        """Put all particles anywhere within the bounds, with equal weights."""
        self._put(self._rng.uniform(self._min_m, self._max_m, (self._n, 2)))

    def bear(self, sensor_m: Sequence[float], travelled_m: Array, variance_m2: Array, *, share: float = 1.0) -> None:
        """Bear particles where the wind may have brought the gas from that was detected.

        Each picks one of the puffs by chance and lies V(m) upwind of the sensor, give or take the puff's deviation.

        Args:
            travelled_m: (n_puffs, 2) displacements V(m), world frame [m].
            variance_m2: (n_puffs, 2) their variances, by axis [m2].
            share: With 1 all particles; with less so many of the living are replaced, drawn by chance, and the newborn
                get the mean weight.
        """
        n_born = self._n if not self.is_born else round(share * self._n)
        if n_born == 0:
            return
        puff = self._rng.integers(len(travelled_m), size=n_born)
        noise_m = self._rng.standard_normal((n_born, 2)) * np.sqrt(variance_m2[puff])
        born_m = np.asarray(sensor_m[:2]) - travelled_m[puff] + noise_m
        if n_born == self._n:
            self._put(born_m)
            return
        replaced = self._rng.choice(self._n, size=n_born, replace=False)
        highest = self._log_weights.max()
        mean = float(elementary.exp_each(self._log_weights - highest).mean())
        self._log_weights[replaced] = highest + elementary.log(mean)
        self.places_m[replaced] = np.clip(born_m, self._min_m, self._max_m)

    def weigh(self, log_miss: Array, *, is_hit: bool, floor_frac: float = 0.0, weight: float = 1.0) -> None:
        """Multiply the weights by the chance of what was found.

        detection: 1 - exp(ln gamma);  none: exp(ln gamma);  both are raised to (1 - f) p + f by a floor f

        Args:
            log_miss: (n,) ln gamma as `log_miss_of_particles` gives it.
            is_hit: Whether gas was detected.
            floor_frac: The floor f: no single finding takes more away.
            weight: What the finding counts among others like it: the power of its likelihood, from 0 to 1.
        """
        chance = -elementary.expm1_each(log_miss) if is_hit else elementary.exp_each(log_miss)
        floored = (1.0 - floor_frac) * chance + floor_frac
        self._log_weights += weight * elementary.log_each(np.maximum(floored, elementary.exp(_LEAST_LOG)))
        self._log_weights -= self._log_weights.max()

    def resample(self, *, jitter_m: float | None = None) -> None:
        """Draw particles again by their weights, and jitter them; all weights are then equal.

        h = (4 / (d + 2))^(1 / (d + 4)) N^(-1 / (d + 4)) = N^(-1/6) for d = 2; jitter N(0, h^2 cov)

        Args:
            jitter_m: Standard deviation on each axis [m]; absent: by the rule, from the particles' covariance.

        Source:
            Silverman 1986, Density Estimation, equation 4.14 (the kernel of AutoSTE, too [C]).
        Deviation:
            Li, Meng et al. copy good particles and let the others survive by chance (`resample_by_copies`), which
            changes what the weights say; this does not, but for the jitter.
        """
        weights = self.weights()
        mean_m = elementary.product(weights, self.places_m)
        offsets_m = self.places_m - mean_m
        sigma_m = np.sqrt(elementary.product(weights, np.square(offsets_m))) / math.sqrt(
            elementary.cbrt(float(self._n))
        )
        scale_m = sigma_m if jitter_m is None else np.full(2, jitter_m)
        kept_m = self.places_m[systematic_indices(weights, float(self._rng.random()))]
        self._put(kept_m + scale_m * self._rng.standard_normal(kept_m.shape))

    def resample_by_copies(self, *, jitter_m: float = 1.0, most_copies: int = 5, survival: float = 1.0 / 3.0) -> None:
        """Resample as in the paper's public port: good particles have children, the others die by chance.

        A particle with w n >= 1 is replaced by min(most_copies, floor(w n)) children about it; one with less survives
        with the chance `survival`. Too many are thinned out by chance, too few filled up with children of the good.

        Args:
            jitter_m: Standard deviation of children about their parent on each axis [m].
            most_copies: How many children one particle has at most.
            survival: Chance that a particle of little weight survives.

        Source:
            The MAPIR group's particle filter [C].
        Deviation:
            The number of particles is kept.
        """
        shares = self.weights() * self._n
        is_good = shares >= 1.0 - 1e-9
        n_children = np.minimum(most_copies, np.floor(shares[is_good] + 1e-9)).astype(np.int64)
        children_m = np.repeat(self.places_m[is_good], n_children, axis=0)
        children_m = children_m + jitter_m * self._rng.standard_normal(children_m.shape)
        survivors_m = self.places_m[~is_good][self._rng.random(int((~is_good).sum())) < survival]
        pool_m = np.concatenate([children_m, survivors_m])
        if len(pool_m) >= self._n:
            self._put(pool_m[np.sort(self._rng.choice(len(pool_m), size=self._n, replace=False))])
            return
        parents_m = self.places_m[self._rng.choice(self._n, size=self._n - len(pool_m), p=self.weights())]
        more_m = parents_m + jitter_m * self._rng.standard_normal(parents_m.shape)
        self._put(np.concatenate([pool_m, more_m]))

    def probability(self, grid: CellGrid) -> Array:
        """Return the weight in each cell of a grid in the plane; particles beyond count for the nearest cell."""
        cells = np.floor((self.places_m - np.array(grid.origin_m[:2])) / grid.cell_m).astype(np.int64)
        cells = np.clip(cells, 0, np.array(grid.shape) - 1)
        mass = np.bincount(cells[:, 0] * grid.shape[1] + cells[:, 1], self.weights(), minlength=grid.n_cells)
        return normalised(mass.astype(np.float64).reshape(grid.shape))

    def _put(self, places_m: Array) -> None:
        self.places_m = np.clip(places_m, self._min_m, self._max_m)
        self._log_weights = np.zeros(len(places_m))


def update_particles(
    cloud: ParticleCloud,
    sensor_m: Sequence[float],
    travelled_m: Array,
    variance_m2: Array,
    *,
    is_hit: bool,
    detection_probability: float = 0.9,
    sensed_m2: float = 0.01,
    floor_frac: float = 0.0,
    weight: float = 1.0,
) -> None:
    """Update a cloud by one finding; a cloud without particles stays without.

    Args:
        travelled_m: (n_puffs, 2) displacements of puffs, world frame [m].
        variance_m2: (n_puffs, 2) their variances, by axis [m2].
        is_hit: Whether gas was detected.
        detection_probability: Chance mu to detect a puff that is met.
        sensed_m2: Area in which the sensor meets a puff [m2].
        floor_frac: No single finding takes more away from a particle than this leaves.
        weight: What the finding counts among others like it.
    """
    if not cloud.is_born:
        return
    sensor = np.array(sensor_m[:2], dtype=np.float64)
    log_miss = log_miss_of_particles(cloud.places_m, sensor, travelled_m, variance_m2, detection_probability, sensed_m2)
    cloud.weigh(log_miss, is_hit=is_hit, floor_frac=floor_frac, weight=weight)


def warm_up() -> None:
    """Compile the kernels, or load them from the cache on disk, so that no decision has to wait for it."""
    log_miss_of_particles(np.zeros((2, 2)), np.zeros(2), np.zeros((2, 2)), np.ones((2, 2)), 0.9, 0.01)
    systematic_indices(np.full(2, 0.5), 0.5)
