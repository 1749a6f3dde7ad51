# pyright: basic
"""Source-term estimation: position and strength of the source, by particles of all that decides a plume.

Held by:
    extensions/search/tests/unit/bayes/test_source_terms.py
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary
from gslcosim_search.bayes.particle_filter import systematic_indices
from gslcosim_search.beliefs import CellGrid, normalised, normalised_from_log

# Columns of a set of source terms.
X, Y, Z, RATE, SPEED, DIRECTION, DIFFUSIVITY, LIFETIME = range(8)
N_TERMS = 8
# Plumes and sensors by number.
ISOTROPIC, GAUSSIAN_PLUME = range(2)
NORMAL, LOG_NORMAL = range(2)
LEAST_LOG = -700.0
LEAST_AMOUNT = 1e-300
_LOG_SQRT_2_PI = 0.9189385332046727
Array = NDArray[np.float64]
# The source terms in the order of the columns.
TERMS = ("x_m", "y_m", "z_m", "rate", "speed", "direction_rad", "diffusivity_m2_s", "lifetime_s")
_POSITIVE = ("rate", "speed", "diffusivity_m2_s", "lifetime_s")
_ROUNDING = 1e-12
_LOG_REJECTED = -4.605170185988091  # ln 0.01
_LN_2 = 0.6931471805599453


@numba.njit(cache=True)
def isotropic_plume(terms, place_m, speed_m_s, direction_rad, source_radius_m):
    """Return the mean amount at a place from a source whose gas diffuses, drifts and decays in open space.

    C = Q / (4 pi D d) exp( u (x - s).e / (2 D) - d / lambda ),  lambda = sqrt(D tau / (1 + u^2 tau / (4 D)))
    [ppm] = [ppm m3/s] / ([m2/s] [m]);  e unit vector where the air goes, d = max(|x - s|, a), u = u_k U

    Args:
        terms: (8,) x, y, z of the source s [m], rate Q [ppm m3/s], wind factor U [1], angle added to the wind's
            direction [rad], diffusivity D [m2/s], lifetime tau [s].
        place_m: (3,) place x of the measurement, world frame [m].
        speed_m_s: Wind speed u_k that was measured there [m/s]; 1: U is the speed.
        direction_rad: Direction it goes to, counter-clockwise from +x [rad]; 0: the angle is the direction.
        source_radius_m: Radius a within which the amount is that at its edge [m].

    Source:
        Vergassola, Villermaux, Shraiman 2007, doi:10.1038/nature05464, supplement; as a source-term model: Hutchinson,
        Liu, Chen 2018, Information Fusion 42.
    Held by:
        extensions/search/tests/unit/bayes/test_source_terms.py (the differential equation; near the source)
    """
    speed_m_s *= terms[SPEED]
    angle_rad = direction_rad + terms[DIRECTION]
    dx_m, dy_m, dz_m = place_m[0] - terms[X], place_m[1] - terms[Y], place_m[2] - terms[Z]
    distance_m = max(math.sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m), source_radius_m)
    along_m = dx_m * elementary.cos(angle_rad) + dy_m * elementary.sin(angle_rad)
    d, tau = terms[DIFFUSIVITY], terms[LIFETIME]
    length_m = math.sqrt(d * tau / (1.0 + speed_m_s * speed_m_s * tau / (4.0 * d)))
    exponent = along_m * speed_m_s / (2.0 * d) - distance_m / length_m
    return terms[RATE] / (4.0 * math.pi * d * distance_m) * elementary.exp(max(LEAST_LOG, exponent))


@numba.njit(cache=True)
def gaussian_plume(terms, place_m, speed_m_s, direction_rad, source_radius_m):
    """Return the mean amount downwind of a source above a floor at z = 0 that reflects; upwind there is none.

    C = Q / (2 pi u s^2) exp(-y^2 / (2 s^2)) (exp(-(z - h)^2 / (2 s^2)) + exp(-(z + h)^2 / (2 s^2)))
    s^2 = a^2 + 2 D r / u        r distance downwind, y across, z and h heights of the place and of the source
    [ppm] = [ppm m3/s] / ([m/s] [m2]),  [m2] = [m2] + [m2/s] [m] / [m/s]

    Arguments as in `isotropic_plume`; the lifetime is left out, a is the plume's deviation at the source.

    Source:
        The textbook plume (Sutton 1932) with one deviation s for both axes, from the diffusivity.
    Held by:
        extensions/search/tests/unit/bayes/test_source_terms.py (the flux through any plane downwind is Q)
    """
    speed_m_s *= terms[SPEED]
    angle_rad = direction_rad + terms[DIRECTION]
    dx_m, dy_m = place_m[0] - terms[X], place_m[1] - terms[Y]
    along_m = dx_m * elementary.cos(angle_rad) + dy_m * elementary.sin(angle_rad)
    if along_m <= 0.0 or speed_m_s <= 0.0:
        return 0.0
    across_m = dy_m * elementary.cos(angle_rad) - dx_m * elementary.sin(angle_rad)
    variance_m2 = source_radius_m * source_radius_m + 2.0 * terms[DIFFUSIVITY] * along_m / speed_m_s
    below_m, above_m = place_m[2] - terms[Z], place_m[2] + terms[Z]
    vertical = elementary.exp(-0.5 * below_m * below_m / variance_m2) + elementary.exp(
        -0.5 * above_m * above_m / variance_m2
    )
    horizontal = elementary.exp(-0.5 * across_m * across_m / variance_m2)
    return terms[RATE] / (2.0 * math.pi * speed_m_s * variance_m2) * horizontal * vertical


@numba.njit(cache=True)
def log_likelihood_of_reading(reading, amount, threshold, noise_frac, noise_floor, detection_probability, sensor):
    """Return the logarithm of the likelihood of one reading, given the mean amount.

    NORMAL:      above the threshold  P_d N(z; C, (f C + e)^2)
                 else                 P_d / 2 (1 + erf((thr - C) / (thr sqrt 2))) + 1 - P_d
    LOG_NORMAL:  above the threshold  P_d N(ln z; ln C, f^2) / z
                 else                 P_d / 2 (1 + erf((ln thr - ln C) / (f sqrt 2))) + 1 - P_d
    z, C, thr, e in one unit, f and P_d without one; the density of z has that unit's inverse

    Args:
        reading: z; at most the threshold where nothing was detected.
        amount: C.
        threshold: thr, > 0.
        noise_frac: f, noise per amount.
        noise_floor: e, noise at no amount (NORMAL).
        detection_probability: P_d: 1 - P_d is the chance to miss what is there.
        sensor: NORMAL or LOG_NORMAL.

    Source:
        NORMAL: Hutchinson, Liu, Chen 2018 as in AutoSTE [C]. LOG_NORMAL: zero-inflated, ours.
    Deviation:
        P_d is a factor of detections, too: it does not depend on the source and changes nothing.
    """
    if sensor == NORMAL:
        if reading <= threshold:
            chance = 0.5 * elementary.erfc((amount - threshold) / (threshold * math.sqrt(2.0)))
            return elementary.log(max(LEAST_AMOUNT, detection_probability * chance + 1.0 - detection_probability))
        sigma = noise_frac * amount + noise_floor
        off = (reading - amount) / sigma
        return elementary.log(detection_probability / sigma) - 0.5 * off * off - _LOG_SQRT_2_PI
    amount = max(LEAST_AMOUNT, amount)
    if reading <= threshold:
        chance = 0.5 * elementary.erfc(elementary.log(amount / threshold) / (noise_frac * math.sqrt(2.0)))
        return elementary.log(max(LEAST_AMOUNT, detection_probability * chance + 1.0 - detection_probability))
    off = (elementary.log(reading) - elementary.log(amount)) / noise_frac
    return _log_peak(reading, noise_frac, detection_probability) - 0.5 * off * off


@numba.njit(cache=True)
def _log_peak(reading, noise_frac, detection_probability):
    return elementary.log(detection_probability / (noise_frac * reading)) - _LOG_SQRT_2_PI


@numba.njit(cache=True)
def mean_amount(terms, place_m, speed_m_s, direction_rad, source_radius_m, plume):
    """Return the mean amount by the plume of that number, ISOTROPIC or GAUSSIAN_PLUME; see there."""
    if plume == ISOTROPIC:
        return isotropic_plume(terms, place_m, speed_m_s, direction_rad, source_radius_m)
    return gaussian_plume(terms, place_m, speed_m_s, direction_rad, source_radius_m)


@numba.njit(cache=True)
def log_likelihoods(terms, place_m, wind, reading, plume, sensor, figures):
    """Return the logarithm of the likelihood of all readings together, for each set of terms.

    Args:
        terms: (n, 8) sets of source terms; see `isotropic_plume`.
        place_m: (k, 3) places of the readings, world frame [m].
        wind: (k, 2) speed [m/s] and direction it goes to [rad] at each reading.
        reading: (k,) what was read [ppm].
        plume: ISOTROPIC or GAUSSIAN_PLUME.
        sensor: NORMAL or LOG_NORMAL.
        figures: (5,) threshold [ppm], noise per amount, noise at none [ppm], detection probability, source radius [m].

    Returns:
        (n,).
    """
    n, k = terms.shape[0], reading.shape[0]
    total = np.zeros(n)
    for i in range(n):
        for j in range(k):
            amount = mean_amount(terms[i], place_m[j], wind[j, 0], wind[j, 1], figures[4], plume)
            total[i] += log_likelihood_of_reading(
                reading[j], amount, figures[0], figures[1], figures[2], figures[3], sensor
            )
    return total


@numba.njit(cache=True)
def sampled_reading(amount, uniform, normal, threshold, noise_frac, noise_floor, detection_probability, sensor):
    """Return a reading as the sensor of `log_likelihood_of_reading` gives it; 0 where nothing is detected.

    Args:
        amount: The mean amount.
        uniform: A number uniform in [0, 1): below P_d the sensor works.
        normal: A standard normal number.
        threshold: What is detected.
        noise_frac: Noise per amount.
        noise_floor: Noise at no amount (NORMAL).
        detection_probability: P_d.
        sensor: NORMAL or LOG_NORMAL.
    """
    if uniform >= detection_probability:
        return 0.0
    if sensor == NORMAL:
        reading = amount + (noise_frac * amount + noise_floor) * normal
    else:
        reading = max(LEAST_AMOUNT, amount) * elementary.exp(noise_frac * normal)
    return reading if reading > threshold else 0.0


@numba.njit(cache=True)
def expected_gain_bits(terms, place_m, wind, truth, uniform, normal, plume, sensor, figures):
    """Return the expected information of a reading at each of several positions about the source terms [bit].

    gain(x) = mean over t of KL(w | z_t),  z_t a reading at x if terms t were true,  w_i ~ p(z_t | terms i)
    KL = sum over i of w_i log2(n w_i)        [bit]

    Args:
        terms: (n, 8) equally likely sets of terms.
        place_m: (k, 3) candidate places, world frame [m].
        wind: (2,) speed [m/s] and direction it goes to [rad], taken for all of them.
        truth: (m,) indices t of the sets that are taken for true in turn.
        uniform: (m,) numbers in [0, 1) for their readings.
        normal: (m,) standard normal numbers for their readings.
        plume: ISOTROPIC or GAUSSIAN_PLUME.
        sensor: NORMAL or LOG_NORMAL.
        figures: As in `log_likelihoods`.

    Returns:
        (k,), none negative.

    Source:
        The reward of AutoSTE: Kullback-Leibler divergence, one draw each from 25 particles [C].
    """
    n, k, m = terms.shape[0], place_m.shape[0], truth.shape[0]
    gain = np.zeros(k)
    amount, log_amount, log_missed = np.empty(n), np.empty(n), np.empty(n)
    log_weight = np.empty(n)
    for a in range(k):
        for i in range(n):
            amount[i] = mean_amount(terms[i], place_m[a], wind[0], wind[1], figures[4], plume)
            log_amount[i] = elementary.log(max(LEAST_AMOUNT, amount[i]))
            log_missed[i] = log_likelihood_of_reading(
                0.0, amount[i], figures[0], figures[1], figures[2], figures[3], sensor
            )
        for t in range(m):
            reading = sampled_reading(
                amount[truth[t]], uniform[t], normal[t], figures[0], figures[1], figures[2], figures[3], sensor
            )
            log_peak = _log_peak(max(reading, figures[0]), figures[1], figures[3])
            log_reading = elementary.log(max(reading, figures[0]))
            for i in range(n):
                if reading <= figures[0]:
                    log_weight[i] = log_missed[i]
                elif sensor == NORMAL:
                    log_weight[i] = log_likelihood_of_reading(
                        reading, amount[i], figures[0], figures[1], figures[2], figures[3], sensor
                    )
                else:
                    off = (log_reading - log_amount[i]) / figures[1]
                    log_weight[i] = log_peak - 0.5 * off * off
            gain[a] += _divergence_bits(log_weight) / m
    return gain


@numba.njit(cache=True)
def _divergence_bits(log_weight):
    n, highest = log_weight.shape[0], log_weight.max()
    total, mean = 0.0, 0.0
    for i in range(n):
        weight = elementary.exp(log_weight[i] - highest)
        total += weight
        mean += weight * (log_weight[i] - highest)
    return max(0.0, (mean / total - elementary.log(total) + elementary.log(float(n))) / _LN_2)


@dataclass(frozen=True, kw_only=True)
class TermPrior:
    """Prior of one source term before any reading.

    `uniform` from a to b; `log_uniform` from a to b; `normal` with mean a and deviation b; `gamma` with shape a and
    scale b.
    """

    kind: Literal["uniform", "log_uniform", "normal", "gamma"]
    a: float
    b: float

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Return n numbers of this distribution."""
        if self.kind == "uniform":
            return rng.uniform(self.a, self.b, n)
        if self.kind == "log_uniform":
            return elementary.exp_each(rng.uniform(elementary.log(self.a), elementary.log(self.b), n))
        if self.kind == "normal":
            return self.a + self.b * rng.standard_normal(n)
        return rng.gamma(self.a, self.b, n)

    def log_density(self, value: Array) -> Array:
        """Return the logarithm of the density, but for a constant; minus infinity where it is 0."""
        if self.kind == "normal":
            return -0.5 * np.square((value - self.a) / self.b)
        safe = np.maximum(value, np.finfo(np.float64).tiny)
        if self.kind == "gamma":
            return np.where(value > 0.0, (self.a - 1.0) * elementary.log_each(safe) - safe / self.b, -np.inf)
        inside = (value >= self.a) & (value <= self.b)
        return np.where(inside, 0.0 if self.kind == "uniform" else -elementary.log_each(safe), -np.inf)


@dataclass(frozen=True)
class SourcePrior:
    """Prior of all source terms, independent of each other, by the names of `TERMS`.

    Rate, speed, diffusivity and lifetime are positive whatever their distribution says.
    """

    spreads: Mapping[str, TermPrior]

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Return n sets of terms, (n, 8)."""
        columns = [self._positive_draw(name, n, rng) for name in TERMS]
        return np.stack(columns, axis=1)

    def log_density(self, terms: Array) -> Array:
        """Return the logarithm of the density of (n, 8) sets, but for a constant."""
        total = np.zeros(len(terms))
        for column, name in enumerate(TERMS):
            total += self.spreads[name].log_density(terms[:, column])
            if name in _POSITIVE:
                total[terms[:, column] <= 0.0] = -np.inf
        return total

    # Draws again what is not positive, until all are.
    def _positive_draw(self, name: str, n: int, rng: np.random.Generator) -> Array:
        values = self.spreads[name].draw(n, rng)
        while name in _POSITIVE and (n_wrong := int((values <= 0.0).sum())):
            values[values <= 0.0] = self.spreads[name].draw(n_wrong, rng)
        return values


@dataclass(frozen=True, kw_only=True)
class PlumeSensor:
    """Plume model that is assumed, and the sensor that reads it.

    `threshold_ppm` is the least that is detected, with `detection_probability`; the noise of a reading is
    `noise_frac` of the amount and `noise_floor_ppm` (of a `normal` sensor; of a `log_normal` one `noise_frac` is the
    deviation of the logarithm). Within `source_radius_m` of the source the amount is that at its edge.
    """

    plume: Literal["isotropic", "gaussian"] = "isotropic"
    sensor: Literal["normal", "log_normal"] = "normal"
    threshold_ppm: float = 5e-3
    noise_frac: float = 0.5
    noise_floor_ppm: float = 1e-4
    detection_probability: float = 0.7
    source_radius_m: float = 0.1

    @property
    def numbers(self) -> tuple[int, int, Array]:
        """Plume, sensor and figures as the kernels take them."""
        plume = ISOTROPIC if self.plume == "isotropic" else GAUSSIAN_PLUME
        sensor = NORMAL if self.sensor == "normal" else LOG_NORMAL
        figures = (
            self.threshold_ppm, self.noise_frac, self.noise_floor_ppm, self.detection_probability, self.source_radius_m
        )  # fmt: skip
        return plume, sensor, np.array(figures)


def kernel_width(n_particles: int, dimensions: int = N_TERMS) -> float:
    """Return the width of the kernel that moves particles, in standard deviations.

    h = (4 / (d + 2))^(1 / (d + 4)) N^(-1 / (d + 4))

    Source:
        Silverman 1986, Density Estimation, equation 4.14; Hutchinson, Liu, Chen 2018.
    """
    return elementary.pow(4.0 / (dimensions + 2.0) / n_particles, 1.0 / (dimensions + 4.0))


class SourceTermFilter:
    """A sequential Monte Carlo filter of source terms: weigh, resample, move.

    1. A reading multiplies each particle's weight by its likelihood.
    2. When fewer than half of the particles count, N_eff < N / 2, they are drawn again by their weights and moved:
       each proposes a step of the kernel, h L xi with the weighted covariance L L' of before and xi standard normal,
       and takes it with the chance min(1, p(new) / p(old)) of all that is known: prior and every reading so far.
       Then each proposes a draw from the prior, taken with the chance min(1, L(new) / L(old)) of the readings: a way
       out of a wrong place that small steps do not find.

    All weights and chances are logarithms.

    State: particles, logarithms of their weights and of their likelihoods, all readings, a generator.

    Source:
        Hutchinson, Liu, Chen 2018, Information Fusion 42; AutoSTE [C]; the move: Gilks and Berzuini 2001,
        doi:10.1111/1467-9868.00280.
    Deviation:
        A step is judged by all readings, not by the last one: only then do moves leave the posterior as it is. Draws
        from the prior are ours; they leave it as it is, too.
    Held by:
        extensions/search/tests/unit/bayes/test_source_terms.py (coverage of the truth on its own model)
    """

    def __init__(
        self, prior: SourcePrior, model: PlumeSensor, n_particles: int, rng: np.random.Generator, *, n_moves: int = 3
    ) -> None:
        """Begin with particles drawn from the prior.

        Args:
            prior: What is believed before any reading.
            n_moves: How many steps particles propose after they were drawn again.
        """
        self.model = model
        self.terms: Array = prior.draw(n_particles, rng)
        self._prior, self._rng, self._n_moves = prior, rng, n_moves
        self._log_weights: Array = np.zeros(n_particles)
        self._log_likelihoods: Array = np.zeros(n_particles)
        self._rejected: list[tuple[float, float, float]] = []
        self._places_m: list[Sequence[float]] = []
        self._winds: list[tuple[float, float]] = []
        self._readings: list[float] = []

    def weights(self) -> Array:
        """Return the weights; their sum is 1."""
        return normalised_from_log(self._log_weights)

    def n_effective(self) -> float:
        """Return the effective number of particles: 1 / sum of w^2."""
        return 1.0 / float(np.square(self.weights()).sum())

    def mean(self) -> dict[str, float]:
        """Return the weighted mean of each term, by name."""
        return dict(zip(TERMS, elementary.product(self.weights(), self.terms).tolist(), strict=True))

    def read(self, place_m: Sequence[float], ppm: float, *, speed_m_s: float = 1.0, direction_rad: float = 0.0) -> None:
        """Take a reading, and draw particles again where too few count.

        Args:
            ppm: The reading; at most the threshold where nothing was detected.
            speed_m_s: Wind speed there; 1: the term `speed` is the speed itself.
            direction_rad: Direction the wind goes to there; 0: the term `direction_rad` is the direction itself.
        """
        self._places_m.append(tuple(place_m))
        self._winds.append((speed_m_s, direction_rad))
        self._readings.append(ppm)
        latest = self._likelihoods(self.terms, since=len(self._readings) - 1)
        self._log_likelihoods += latest
        self._log_weights += latest
        self._log_weights -= self._log_weights.max()
        if self.n_effective() < 0.5 * len(self.terms):
            self._renew()

    def reject(self, place_m: Sequence[float], radius_m: float) -> None:
        """Take note that the source is not near a place in the plane: it is there a hundred times less likely."""
        self._rejected.append((place_m[0], place_m[1], radius_m))
        latest = _log_rejection(self.terms, self._rejected[-1:])
        self._log_likelihoods += latest
        self._log_weights += latest
        self._log_weights -= self._log_weights.max()
        if self.n_effective() < 0.5 * len(self.terms):
            self._renew()

    def gain_bits(
        self,
        places_m: Array,
        *,
        speed_m_s: float = 1.0,
        direction_rad: float = 0.0,
        n_particles: int = 200,
        n_truths: int = 25,
    ) -> Array:
        """Return the expected information of a reading at each position [bit]; see `expected_gain_bits`.

        Args:
            places_m: (k, 3) candidate places, world frame [m].
            speed_m_s: As in `read`.
            direction_rad: As in `read`.
            n_particles: How many particles, drawn by their weights, stand for the belief.
            n_truths: How many of them are taken for true in turn.
        """
        few = self.terms[self._rng.choice(len(self.terms), size=n_particles, p=self.weights())]
        truth = self._rng.integers(n_particles, size=n_truths)
        uniform, normal = self._rng.random(n_truths), self._rng.standard_normal(n_truths)
        plume, sensor, figures = self.model.numbers
        wind = np.array([speed_m_s, direction_rad])
        return expected_gain_bits(few, places_m, wind, truth, uniform, normal, plume, sensor, figures)

    def probability(self, grid: CellGrid) -> Array:
        """Return the weight in each cell of a grid, in the plane or in space; beyond it the nearest cell's."""
        cells = np.floor((self.terms[:, : grid.dimensions] - np.array(grid.origin_m)) / grid.cell_m).astype(np.int64)
        cells = np.clip(cells, 0, np.array(grid.shape) - 1)
        mass = np.zeros(grid.shape)
        np.add.at(mass, tuple(cells.T), self.weights())
        return normalised(mass)

    def _renew(self) -> None:
        weights = self.weights()
        root = _root(_covariance(self.terms, weights))
        index = systematic_indices(weights, float(self._rng.random()))
        self.terms, self._log_likelihoods = self.terms[index], self._log_likelihoods[index]
        self._log_weights = np.zeros(len(self.terms))
        n = len(self.terms)
        for _ in range(self._n_moves):
            step = elementary.product(kernel_width(n) * self._rng.standard_normal((n, N_TERMS)), root.T)
            proposed = self.terms + step
            self._take(proposed, self._prior.log_density(proposed) - self._prior.log_density(self.terms))
        self._take(self._prior.draw(n, self._rng), np.zeros(n))

    # Metropolis and Hastings: the gain of the prior comes with the proposal, that of the readings is added.
    def _take(self, proposed: Array, gain: Array) -> None:
        chance = elementary.log1p_each(-self._rng.random(len(proposed)))
        possible = np.flatnonzero(np.isfinite(gain))
        log_likelihoods_there = self._all_likelihoods(proposed[possible])
        gain_there = gain[possible] + log_likelihoods_there - self._log_likelihoods[possible]
        taken = gain_there > chance[possible]
        self.terms[possible[taken]] = proposed[possible[taken]]
        self._log_likelihoods[possible[taken]] = log_likelihoods_there[taken]

    def _all_likelihoods(self, terms: Array) -> Array:
        return self._likelihoods(terms) + _log_rejection(terms, self._rejected)

    def _likelihoods(self, terms: Array, *, since: int = 0) -> Array:
        plume, sensor, figures = self.model.numbers
        places_m = np.array(self._places_m[since:], dtype=np.float64).reshape(-1, 3)
        winds = np.array(self._winds[since:], dtype=np.float64).reshape(-1, 2)
        return log_likelihoods(
            terms, places_m, winds, np.array(self._readings[since:], dtype=np.float64), plume, sensor, figures
        )


def _log_rejection(terms: Array, rejected: Sequence[tuple[float, float, float]]) -> Array:
    total = np.zeros(len(terms))
    for x_m, y_m, radius_m in rejected:
        total += np.where(np.linalg.norm(terms[:, :2] - (x_m, y_m), axis=1) <= radius_m, _LOG_REJECTED, 0.0)
    return total


def _covariance(terms: Array, weights: Array) -> Array:
    offsets = terms - elementary.product(weights, terms)
    return elementary.product((offsets * weights[:, None]).T, offsets)


# Cholesky's root L with L L' = C, also of a covariance that has no volume, after too few particles were left.
def _root(covariance: Array) -> Array:
    least = _ROUNDING * max(float(covariance.diagonal().max()), _ROUNDING)
    root = np.zeros_like(covariance)
    for j in range(len(covariance)):
        column = covariance[j:, j] - (root[j:, :j] * root[j, :j]).sum(axis=1)
        column[0] = max(column[0], least)
        root[j:, j] = column / math.sqrt(column[0])
    return root


def warm_up(model: PlumeSensor) -> None:
    """Compile the kernels, or load them from the cache on disk, so that no decision has to wait for it."""
    spread = TermPrior(kind="log_uniform", a=0.5, b=1.0)
    tiny = SourceTermFilter(SourcePrior(dict.fromkeys(TERMS, spread)), model, 2, np.random.default_rng(0), n_moves=1)
    tiny.read((0.0, 0.0, 0.0), 0.0)
    tiny.gain_bits(np.zeros((1, 3)), n_particles=2, n_truths=1)
    systematic_indices(np.full(2, 0.5), 0.5)
