"""Where the source is and how strong, by particles of all that decides a plume: source-term estimation."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.bayes.particle_filter_kernels import systematic_indices
from gslcosim.search.bayes.source_terms_kernels import (
    GAUSSIAN_PLUME,
    ISOTROPIC,
    LOG_NORMAL,
    N_TERMS,
    NORMAL,
    expected_gain_bits,
    log_likelihoods,
)
from gslcosim.search.beliefs import normalised, normalised_from_log
from gslcosim.search.grids import CellGrid

Array = NDArray[np.float64]
# The source terms in the order of the columns.
TERMS = ("x_m", "y_m", "z_m", "rate", "speed", "direction_rad", "diffusivity_m2_s", "lifetime_s")
_POSITIVE = ("rate", "speed", "diffusivity_m2_s", "lifetime_s")
_ROUNDING = 1e-12
_LOG_REJECTED = math.log(0.01)


@dataclass(frozen=True, kw_only=True)
class Spread:
    """What is believed of one term before any reading.

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
            return np.exp(rng.uniform(math.log(self.a), math.log(self.b), n))
        if self.kind == "normal":
            return rng.normal(self.a, self.b, n)
        return rng.gamma(self.a, self.b, n)

    def log_density(self, value: Array) -> Array:
        """Return the logarithm of the density, but for a constant; minus infinity where it is 0."""
        if self.kind == "normal":
            return -0.5 * ((value - self.a) / self.b) ** 2
        safe = np.maximum(value, np.finfo(np.float64).tiny)
        if self.kind == "gamma":
            return np.where(value > 0.0, (self.a - 1.0) * np.log(safe) - safe / self.b, -np.inf)
        inside = (value >= self.a) & (value <= self.b)
        return np.where(inside, 0.0 if self.kind == "uniform" else -np.log(safe), -np.inf)


@dataclass(frozen=True)
class Prior:
    """What is believed of all terms before any reading, each for itself, by the names of `TERMS`.

    Rate, speed, diffusivity and lifetime are positive whatever their distribution says.
    """

    spreads: Mapping[str, Spread]

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
    """Which plume is believed in, and how its amounts are read.

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
    Held by:
        tests/unit/search/bayes/test_source_terms.py
    """
    return (4.0 / (dimensions + 2.0) / n_particles) ** (1.0 / (dimensions + 4.0))


class SourceTermFilter:
    """A sequential Monte Carlo filter of source terms: weigh, resample, move.

    1. A reading multiplies each particle's weight by its likelihood.
    2. When fewer than half of the particles count, N_eff < N / 2, they are drawn anew by their weights and moved:
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
        tests/unit/search/bayes/test_source_terms.py (coverage of the truth on its own model)
    """

    def __init__(
        self, prior: Prior, model: PlumeSensor, n_particles: int, rng: np.random.Generator, *, n_moves: int = 3
    ) -> None:
        """Begin with particles drawn from the prior.

        Args:
            prior: What is believed before any reading.
            model: Plume and sensor.
            n_particles: How many.
            rng: For particles and moves.
            n_moves: How many steps particles propose after they were drawn anew.
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
        """Return how many equal particles would say as much: 1 / sum of w^2."""
        return 1.0 / float((self.weights() ** 2).sum())

    def mean(self) -> dict[str, float]:
        """Return the weighted mean of each term, by name."""
        return dict(zip(TERMS, (self.weights() @ self.terms).tolist(), strict=True))

    def read(self, place_m: Sequence[float], ppm: float, *, speed_m_s: float = 1.0, direction_rad: float = 0.0) -> None:
        """Take a reading, and draw particles anew where too few count.

        Args:
            place_m: Where it was taken, world frame [m].
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
        """Return how many bits a reading at each place is expected to tell; see `expected_gain_bits`.

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
            step = kernel_width(n) * self._rng.standard_normal((n, N_TERMS)) @ root.T
            proposed = self.terms + step
            self._take(proposed, self._prior.log_density(proposed) - self._prior.log_density(self.terms))
        self._take(self._prior.draw(n, self._rng), np.zeros(n))

    # Metropolis and Hastings: the gain of the prior comes with the proposal, that of the readings is added.
    def _take(self, proposed: Array, gain: Array) -> None:
        chance = np.log1p(-self._rng.random(len(proposed)))
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
        total += np.where(np.hypot(terms[:, 0] - x_m, terms[:, 1] - y_m) <= radius_m, _LOG_REJECTED, 0.0)
    return total


def _covariance(terms: Array, weights: Array) -> Array:
    offsets = terms - weights @ terms
    return (offsets * weights[:, None]).T @ offsets


# A root L with L L' = C also of a covariance that has no volume, after too few particles were left.
def _root(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, _ROUNDING * max(float(values.max()), _ROUNDING)))


def warm_up(model: PlumeSensor) -> None:
    """Compile the kernels, or load them from the cache on disk, so that no decision has to wait for it."""
    spread = Spread(kind="log_uniform", a=0.5, b=1.0)
    tiny = SourceTermFilter(Prior(dict.fromkeys(TERMS, spread)), model, 2, np.random.default_rng(0), n_moves=1)
    tiny.read((0.0, 0.0, 0.0), 0.0)
    tiny.gain_bits(np.zeros((1, 3)), n_particles=2, n_truths=1)
    systematic_indices(np.full(2, 0.5), 0.5)
