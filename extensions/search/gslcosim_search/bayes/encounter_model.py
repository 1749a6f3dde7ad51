# pyright: basic
"""Encounter models: the rate at which a searcher meets gas of a source elsewhere, and likelihoods of counts.

Held by:
    extensions/search/tests/unit/bayes/test_encounter_model.py
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from dataclasses import dataclass
from typing import Literal, Self

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.scalar_kernels import norm2
from gslcosim.contract.messages import NominalPlume
from gslcosim_search import elementary

EULER_GAMMA = 0.5772156649015329
# Terms of the power series at arguments up to 2: the next one is below 1e-17.
_N_SERIES = 12
# Logarithm of a mean so small that one minus it is one.
_NEVER = -40.0
# Terms of a tail of Poisson's law below a mean of 1: the next one is below 1e-19.
_N_TAIL = 20
Array = NDArray[np.float64]
# The mean in the plane divides by ln(lambda / a): kept away from zero where particles reach no farther than the nose.
_LEAST_RATIO = 2.0
# Slower air counts as moving by this much where something is divided by its speed.
_LEAST_SPEED_M_S = 0.02
# Puffs that do not grow never fade; nor does gas live longer than a long search.
_LONGEST_LIFE_S = 1000.0
# An emission is stated by what it causes at this distance, straight downwind.
REFERENCE_M = 1.0


@numba.njit(cache=True, nogil=True)
def log_k0(x):
    """Return the logarithm of the modified Bessel function of the second kind and order 0.

    x <= 2: K0(x) = sum over k >= 0 of (psi(k + 1) - ln(x / 2)) q^k / (k!)^2        q = (x / 2)^2
    x > 2:  K0(x) = x^(-1/2) exp(-x) sum over k <= 6 of c_k (2 / x)^k
    [1] = [1]

    The exponential is never evaluated: arguments of hundreds, as in large rooms, neither overflow nor vanish.

    Args:
        x: Argument, > 0.

    Returns:
        ln K0(x).

    Source:
        Abramowitz and Stegun 1964, 9.6.13 (series, psi the digamma function) and 9.8.6 (polynomial).
    Accuracy:
        Rounding alone up to 2, above it 2e-7 (that of the polynomial).
    Held by:
        extensions/search/tests/unit/bayes/test_encounter_model.py (scipy's scaled function, from 1e-12 to 1e5)
    """
    half = 0.5 * x
    if x <= 2.0:
        q = half * half
        log_half = elementary.log(half)
        psi = -EULER_GAMMA
        term = 1.0
        total = psi - log_half
        for k in range(1, _N_SERIES + 1):
            term *= q / (k * k)
            psi += 1.0 / k
            total += term * (psi - log_half)
        return elementary.log(total)
    t = 2.0 / x
    scaled = 0.00053208
    scaled = scaled * t - 0.00251540
    scaled = scaled * t + 0.00587872
    scaled = scaled * t - 0.01062446
    scaled = scaled * t + 0.02189568
    scaled = scaled * t - 0.07832358
    scaled = scaled * t + 1.25331414
    return elementary.log(scaled) - 0.5 * elementary.log(x) - x


@numba.njit(cache=True, nogil=True)
def log_mean_hits_2d_into(cells_m, places_m, drift_x, drift_y, length_m, nearest_m, log_strength, log_mean):
    """Write how many hits a searcher expects in one stop, for each place of it and of the source, in the plane.

    ln mu = ln k + g . (x - s) + ln K0(d / lambda)        d = max(|x - s|, a)
    [1] = [1] + [1/m] [m] + [1]

    Args:
        cells_m: (n, 2) places s of the source, world frame, xy [m].
        places_m: (m, 2) places x of the searcher [m].
        drift_x: x of g = V e / (2 D), V e the wind (where the air goes), D the diffusivity [1/m].
        drift_y: y of g [1/m].
        length_m: How far particles reach before they are gone, lambda [m].
        nearest_m: Size of the detector a; nearer than that the mean does not grow [m].
        log_strength: ln k, k = R dt / ln(lambda / a) [1].
        log_mean: (m, n) ln mu; overwritten.

    Source:
        Vergassola, Villermaux, Shraiman 2007, supplement, doi:10.1038/nature05464.
    """
    per_length = 1.0 / length_m
    for i in range(places_m.shape[0]):
        for j in range(cells_m.shape[0]):
            dx = places_m[i, 0] - cells_m[j, 0]
            dy = places_m[i, 1] - cells_m[j, 1]
            d = max(math.sqrt(dx * dx + dy * dy), nearest_m)
            log_mean[i, j] = log_strength + (drift_x * dx + drift_y * dy) + log_k0(d * per_length)


@numba.njit(cache=True, nogil=True)
def log_mean_hits_3d_into(cells_m, places_m, drift_x, drift_y, length_m, nearest_m, log_strength, log_mean):
    """Write how many hits a searcher expects in one stop, for each place of it and of the source, in space.

    ln mu = ln k - ln d + g . (x - s) - d / lambda        d = max(|x - s|, a)
    [1] = [m] / [m] + [1/m] [m] + [1]

    Args:
        cells_m: (n, 3) places s of the source, world frame, xyz [m].
        places_m: (m, 3) places x of the searcher [m].
        drift_x: x of g = V e / (2 D); the wind is level [1/m].
        drift_y: y of g [1/m].
        length_m: How far particles reach before they are gone, lambda [m].
        nearest_m: Size of the detector a; nearer than that the mean does not grow [m].
        log_strength: ln k, k = R a dt [m].
        log_mean: (m, n) ln mu; overwritten.

    Source:
        Vergassola, Villermaux, Shraiman 2007, supplement, doi:10.1038/nature05464.
    """
    per_length = 1.0 / length_m
    for i in range(places_m.shape[0]):
        for j in range(cells_m.shape[0]):
            dx = places_m[i, 0] - cells_m[j, 0]
            dy = places_m[i, 1] - cells_m[j, 1]
            dz = places_m[i, 2] - cells_m[j, 2]
            d = max(math.sqrt(dx * dx + dy * dy + dz * dz), nearest_m)
            log_mean[i, j] = log_strength - elementary.log(d) + (drift_x * dx + drift_y * dy) - d * per_length


@numba.njit(cache=True, nogil=True)
def hit_probability(log_mean, hits, n_outcomes):
    """Return the probability of an outcome of a stop: 0, 1, ... hits; the last outcome includes all higher counts.

    P(h) = exp(h ln mu - mu) / h!  for h < n - 1,    P(n - 1) = 1 - sum of the others
    [1] = [1]

    With two outcomes it is the law of "hit or not": P(1) = 1 - exp(-mu).

    Args:
        log_mean: Logarithm of the expected number of hits mu.
        hits: Outcome h, from 0 to n_outcomes - 1.
        n_outcomes: Number of outcomes n, at least 2.

    Source:
        Vergassola, Villermaux, Shraiman 2007 (hits are Poisson); the last outcome as in Loisy and Eloy 2022,
        doi:10.1098/rspa.2022.0118.
    Held by:
        extensions/search/tests/unit/bayes/test_encounter_model.py (sums to 1; scipy's survival function for the tail)
    """
    mean = elementary.exp(min(log_mean, 50.0))
    if n_outcomes == 2:
        return elementary.exp(-mean) if hits == 0 else -elementary.expm1(-mean)
    is_tail = hits == n_outcomes - 1
    if is_tail and mean < 1.0:
        # Summed from its own first term: one minus the others would lose all digits of a rare outcome.
        term = elementary.exp(hits * log_mean - mean - elementary.lgamma(hits + 1.0))
        total = term
        for h in range(hits + 1, hits + _N_TAIL):
            term *= mean / h
            total += term
        return total
    if not is_tail:
        return elementary.exp(hits * log_mean - mean - elementary.lgamma(hits + 1.0))
    others = 0.0
    for h in range(hits):
        others += elementary.exp(h * log_mean - mean - elementary.lgamma(h + 1.0))
    return max(0.0, 1.0 - others)


# Most of a decision's time is spent here: two outcomes share their exponentials, and where no hit is to be expected
# (mu below 1e-17) both are what they are without a source.
@numba.njit(cache=True, nogil=True)
def _hit_or_not_into(log_mean, floor, power, likelihood, weight, log_weight):
    scale = 1.0 - 2.0 * floor
    log_never = elementary.log(floor) if floor > 0.0 else 0.0
    for i in range(log_mean.shape[0]):
        k = power[i]
        never_weight = elementary.exp(k * log_never) if floor > 0.0 else 0.0
        sure_log = k * elementary.log1p(-floor)
        sure_weight = elementary.exp(sure_log)
        for j in range(log_mean.shape[1]):
            if log_mean[i, j] < _NEVER:
                likelihood[i, 0, j], likelihood[i, 1, j] = 1.0 - floor, floor
                weight[i, 0, j], weight[i, 1, j] = sure_weight, never_weight
                log_weight[i, 0, j], log_weight[i, 1, j] = sure_log, k * log_never
                continue
            mean = elementary.exp(min(log_mean[i, j], 50.0))
            none = elementary.exp(-mean)
            # Two terms of the series where one minus the other would lose digits: either is right to 2e-11.
            some = mean * (1.0 - 0.5 * mean) if mean < 1e-5 else 1.0 - none
            miss, hit = floor + scale * none, floor + scale * some
            likelihood[i, 0, j], likelihood[i, 1, j] = miss, hit
            log_miss = k * elementary.log(miss) if miss > 0.0 else 0.0
            log_hit = k * elementary.log(hit)
            log_weight[i, 0, j], log_weight[i, 1, j] = log_miss, log_hit
            if k == 1.0:
                weight[i, 0, j], weight[i, 1, j] = miss, hit
            else:
                weight[i, 0, j] = elementary.exp(log_miss) if miss > 0.0 else 0.0
                weight[i, 1, j] = elementary.exp(log_hit)


@numba.njit(cache=True, nogil=True)
def likelihoods_into(log_mean, floor, power, likelihood, weight, log_weight):
    """Write how likely each outcome of a stop is for each place of the source, and what it weighs in a belief.

    L = f + (1 - n f) P(h)        f floor, n number of outcomes: no outcome is ruled out, and the sum stays 1
    W = L^k                       k power: 1 trusts a stop fully, less counts it as like others
    [1] = [1]

    Args:
        log_mean: (m, c) logarithm of the expected hits for m places of the searcher and c cells of the source.
        floor: Least probability f of an outcome, from 0 to 1 / n.
        power: (m,) power k of each place, from 0 to 1.
        likelihood: (m, n, c) L; overwritten.
        weight: (m, n, c) W; overwritten. May be the same array as `likelihood` where all powers are 1.
        log_weight: (m, n, c) ln W, 0 where W is 0; overwritten.

    Source:
        Tempering of likelihoods of a wrong model: remembered, unverified (power 0.3 to 0.5, floor 1e-3).
    """
    n_outcomes = likelihood.shape[1]
    if n_outcomes == 2:
        _hit_or_not_into(log_mean, floor, power, likelihood, weight, log_weight)
        return
    scale = 1.0 - n_outcomes * floor
    for i in range(log_mean.shape[0]):
        for h in range(n_outcomes):
            for j in range(log_mean.shape[1]):
                value = floor + scale * hit_probability(log_mean[i, j], h, n_outcomes)
                likelihood[i, h, j] = value
                if value <= 0.0:
                    weight[i, h, j] = 0.0
                    log_weight[i, h, j] = 0.0
                else:
                    log_w = power[i] * elementary.log(value)
                    log_weight[i, h, j] = log_w
                    weight[i, h, j] = value if power[i] == 1.0 else elementary.exp(log_w)


def dispersion_length_m(diffusivity_m2_s: float, lifetime_s: float, speed_m_s: float) -> float:
    """Return the distance that particles travel within their lifetime.

    lambda = sqrt(D tau / (1 + V^2 tau / (4 D)))        D diffusivity, tau lifetime, V speed of the wind
    [m] = sqrt([m2/s] [s] / ([m2/s2] [s] / [m2/s]))

    Source:
        Vergassola, Villermaux, Shraiman 2007, doi:10.1038/nature05464.
    """
    spread_m2 = diffusivity_m2_s * lifetime_s
    return math.sqrt(spread_m2 / (1.0 + speed_m_s * speed_m_s * lifetime_s / (4.0 * diffusivity_m2_s)))


def meander_diffusivity_m2_s(speed_m_s: float, spread_rad: float, correlation_s: float) -> float:
    """Return by how much a wandering wind spreads what it carries, across it.

    D = (V sd)^2 T        V speed, sd standard deviation of the direction, T its correlation time
    [m2/s] = [m2/s2] [s]

    Source:
        Taylor 1922, doi:10.1112/plms/s2-20.1.196, for times longer than T and small deviations.
    """
    across_m_s = speed_m_s * spread_rad
    return across_m_s * across_m_s * correlation_s


@dataclass(frozen=True, kw_only=True)
class EncounterModel:
    """Particles that a steady, even wind carries off and eddies spread until they are gone; in the plane or in space.

    2-D: mu = R dt / ln(lambda / a) exp(V (x - s).e / (2 D)) K0(|x - s| / lambda)
    3-D: mu = R a dt / |x - s| exp(V (x - s).e / (2 D) - |x - s| / lambda)
    [1] = [1/s] [s]

    Args:
        dimensions: 2 or 3.
        emission_per_s: Particles that the source releases, R [1/s].
        diffusivity_m2_s: D [m2/s], > 0.
        lifetime_s: tau [s], > 0.
        detector_m: Size of the nose a [m]; nearer than that the mean does not grow.
        wind_m_s: Where the air goes, V e, level, world frame [m/s].
        stop_s: How long the searcher smells at a place, dt [s].

    Source:
        Vergassola, Villermaux, Shraiman 2007, doi:10.1038/nature05464.
    Deviation:
        lambda / a counts as at least 2 in the logarithm: a strong wind makes lambda small, and the mean infinite.
        In a room the wind is neither even nor steady and walls reflect: temper what a stop weighs.
    """

    dimensions: Literal[2, 3]
    emission_per_s: float
    diffusivity_m2_s: float
    lifetime_s: float
    detector_m: float
    wind_m_s: tuple[float, float] = (0.0, 0.0)
    stop_s: float = 1.0

    @property
    def length_m(self) -> float:
        """Dispersion length of particles, lambda [m]."""
        return dispersion_length_m(self.diffusivity_m2_s, self.lifetime_s, norm2(*self.wind_m_s))

    @property
    def log_strength(self) -> float:
        """Logarithm of what stands before the exponential: R dt / ln(lambda / a) in 2-D [1], R a dt in 3-D [m]."""
        log_emitted = elementary.log(self.emission_per_s * self.stop_s)
        if self.dimensions == 3:
            return log_emitted + elementary.log(self.detector_m)
        return log_emitted - elementary.log(elementary.log(max(self.length_m / self.detector_m, _LEAST_RATIO)))

    def log_mean_hits(self, places_m: Array, cells_m: Array) -> Array:
        """Return the logarithm of the expected hits of a stop.

        Args:
            places_m: (m, dimensions) places of the searcher, world frame [m].
            cells_m: (n, dimensions) places of the source [m].

        Returns:
            (m, n) ln mu.
        """
        log_mean = np.empty((len(places_m), len(cells_m)))
        drift_x, drift_y = (speed / (2.0 * self.diffusivity_m2_s) for speed in self.wind_m_s)
        into = log_mean_hits_2d_into if self.dimensions == 2 else log_mean_hits_3d_into
        into(cells_m, places_m, drift_x, drift_y, self.length_m, self.detector_m, self.log_strength, log_mean)
        return log_mean

    def calibrated(self, hits_per_stop: float) -> Self:
        """Return the model whose source causes so many hits a stop at 1 m straight downwind (any side in calm air)."""
        speed_m_s = norm2(*self.wind_m_s)
        away = (1.0, 0.0) if speed_m_s == 0.0 else (self.wind_m_s[0] / speed_m_s, self.wind_m_s[1] / speed_m_s)
        place_m = np.zeros((1, self.dimensions))
        place_m[0, :2] = REFERENCE_M * away[0], REFERENCE_M * away[1]
        found = float(self.log_mean_hits(place_m, np.zeros((1, self.dimensions)))[0, 0])
        emission_per_s = self.emission_per_s * elementary.exp(elementary.log(hits_per_stop) - found)
        return type(self)(**{**self.__dict__, "emission_per_s": emission_per_s})


@dataclass(frozen=True, kw_only=True)
class PlumeAssumption:
    """Assumption about any plume of a mission; with the wind of the moment it gives an encounter model.

    Args:
        dimensions: 2 or 3.
        hits_at_1m: Expected hits of a stop at 1 m straight downwind of the source.
        diffusivity_m2_s: Spread by eddies and growth of puffs, without that by the wandering of the wind [m2/s].
        lifetime_s: Age beyond which gas is no longer smelled [s].
        room_length_m: Length of the room: gas that has crossed it with the wind is gone [m].
        detector_m: Size of the nose [m].
        correlation_s: How long the wind keeps its direction [s].
        stop_s: How long a stop is [s].
    """

    dimensions: Literal[2, 3]
    hits_at_1m: float
    diffusivity_m2_s: float
    lifetime_s: float
    room_length_m: float
    detector_m: float
    correlation_s: float
    stop_s: float

    def model(self, wind_m_s: tuple[float, float], spread_rad: float) -> EncounterModel:
        """Return the encounter model in a wind: the mean of what was felt [m/s] and how far its direction spreads."""
        speed_m_s = norm2(*wind_m_s)
        meander = meander_diffusivity_m2_s(speed_m_s, spread_rad, self.correlation_s)
        model = EncounterModel(
            dimensions=self.dimensions,
            emission_per_s=1.0,
            diffusivity_m2_s=self.diffusivity_m2_s + meander,
            lifetime_s=min(self.lifetime_s, self.room_length_m / max(speed_m_s, _LEAST_SPEED_M_S)),
            detector_m=self.detector_m,
            wind_m_s=wind_m_s,
            stop_s=self.stop_s,
        )
        return model.calibrated(self.hits_at_1m)


def nominal_dispersal(
    plume: NominalPlume,
    *,
    dimensions: Literal[2, 3],
    threshold_ppm: float,
    room_length_m: float,
    detector_m: float,
    correlation_s: float,
    stop_s: float,
) -> PlumeAssumption:
    """Return the dispersal model that follows from the nominal figures of a plume (knowledge level K1).

    D = D_eddies + gamma / 2;    tau = age at which a puff's centre falls below the threshold
    hits at 1 m = n dt (1 - exp(-r^2 / (2 s^2)))        n puffs released a second, dt stop
    [m2/s] = [m2/s] + [m2/s];    [s] = [m2] / [m2/s];    [1] = [1/s] [s]

    A puff of the amount q [ppm m3] has the centre c = q / ((2 pi)^(3/2) sigma^3), sigma^2 = sigma0^2 + gamma t. At 1 m,
    t = 1 m / V old, it is above the threshold c_th within r^2 = 2 sigma^2 ln(c / c_th) of its centre, and centres are
    spread by s^2 = 2 D_eddies t + sigma0^2 across the wind; sigma0^2 keeps the ratio finite for a puff just born.

    Source:
        Our derivation from the filament model of Farrell et al. 2002, doi:10.1023/A:1016283702837.
    """
    amount_ppm_m3 = plume.release_ppm_m3_s / plume.puffs_per_s
    width_m = elementary.cbrt(amount_ppm_m3 / threshold_ppm)
    width_m2 = width_m * width_m / (2.0 * math.pi)
    age_s = REFERENCE_M / max(plume.wind_speed_m_s, _LEAST_SPEED_M_S)
    return PlumeAssumption(
        dimensions=dimensions,
        hits_at_1m=max(0.1, plume.puffs_per_s * stop_s * _overlap(plume, width_m2, age_s)),
        diffusivity_m2_s=max(1e-4, plume.diffusivity_m2_s + 0.5 * plume.growth_m2_s),
        lifetime_s=_fading_s(plume, width_m2),
        room_length_m=room_length_m,
        detector_m=detector_m,
        correlation_s=correlation_s,
        stop_s=stop_s,
    )


def _overlap(plume: NominalPlume, width_m2: float, age_s: float) -> float:
    # `width_m2` is the sigma^2 at which a puff's centre is at the threshold: ln(c / c_th) = 1.5 ln(width / sigma^2).
    sigma_m2 = plume.initial_sigma_m * plume.initial_sigma_m + plume.growth_m2_s * age_s
    reach_m2 = 2.0 * sigma_m2 * max(0.0, 1.5 * elementary.log(width_m2 / sigma_m2))
    spread_m2 = 2.0 * plume.diffusivity_m2_s * age_s + plume.initial_sigma_m * plume.initial_sigma_m
    return -elementary.expm1(-reach_m2 / (2.0 * spread_m2))


def _fading_s(plume: NominalPlume, width_m2: float) -> float:
    if plume.growth_m2_s <= 0.0:
        return _LONGEST_LIFE_S
    return min(
        _LONGEST_LIFE_S, max(1.0, (width_m2 - plume.initial_sigma_m * plume.initial_sigma_m) / plume.growth_m2_s)
    )


def likelihoods(
    log_mean: Array, *, n_outcomes: int = 2, floor: float = 0.0, power: float | Array = 1.0
) -> tuple[Array, Array, Array]:
    """Return the probability of each outcome of a stop for each source position, its weight, and the log weight.

    Args:
        log_mean: (m, c) logarithm of expected hits: m places of the searcher, c cells of the source.
        n_outcomes: 2 for "hit or not", more to count hits.
        floor: Least probability of an outcome.
        power: Tempering: the weight is the likelihood to this power, one number or one for each place.

    Returns:
        Three arrays (m, n_outcomes, c): likelihood, weight, logarithm of the weight (0 where the weight is 0).
    """
    shape = (log_mean.shape[0], n_outcomes, log_mean.shape[1])
    likelihood, log_weight = np.empty(shape), np.empty(shape)
    powers = np.array(np.broadcast_to(np.asarray(power, np.float64), shape[:1]))
    weight = likelihood if (powers == 1.0).all() else np.empty(shape)
    likelihoods_into(log_mean, floor, powers, likelihood, weight, log_weight)
    return likelihood, weight, log_weight
