"""How often a searcher meets gas of a source elsewhere, and how likely each count is; all by logarithms."""
# pyright: basic

import math

import numba
import numpy as np

EULER_GAMMA = 0.5772156649015329
# Terms of the power series at arguments up to 2: the next one is below 1e-17.
_N_SERIES = 12
# Logarithm of a mean so small that one minus it is one.
_NEVER = -40.0
# Terms of a tail of Poisson's law below a mean of 1: the next one is below 1e-19.
_N_TAIL = 20


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
        tests/unit/search/bayes/test_encounters.py (scipy's scaled function, from 1e-12 to 1e5)
    """
    half = 0.5 * x
    if x <= 2.0:
        q = half * half
        log_half = math.log(half)
        psi = -EULER_GAMMA
        term = 1.0
        total = psi - log_half
        for k in range(1, _N_SERIES + 1):
            term *= q / (k * k)
            psi += 1.0 / k
            total += term * (psi - log_half)
        return math.log(total)
    t = 2.0 / x
    scaled = 0.00053208
    scaled = scaled * t - 0.00251540
    scaled = scaled * t + 0.00587872
    scaled = scaled * t - 0.01062446
    scaled = scaled * t + 0.02189568
    scaled = scaled * t - 0.07832358
    scaled = scaled * t + 1.25331414
    return math.log(scaled) - 0.5 * math.log(x) - x


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
    Held by:
        tests/unit/search/bayes/test_encounters.py
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
    Held by:
        tests/unit/search/bayes/test_encounters.py
    """
    per_length = 1.0 / length_m
    for i in range(places_m.shape[0]):
        for j in range(cells_m.shape[0]):
            dx = places_m[i, 0] - cells_m[j, 0]
            dy = places_m[i, 1] - cells_m[j, 1]
            dz = places_m[i, 2] - cells_m[j, 2]
            d = max(math.sqrt(dx * dx + dy * dy + dz * dz), nearest_m)
            log_mean[i, j] = log_strength - math.log(d) + (drift_x * dx + drift_y * dy) - d * per_length


@numba.njit(cache=True, nogil=True)
def hit_probability(log_mean, hits, n_outcomes):
    """Return how likely an outcome of a stop is: 0, 1, ... hits, or so many or more for the last outcome.

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
        tests/unit/search/bayes/test_encounters.py (sums to 1; scipy's survival function for the tail)
    """
    mean = math.exp(min(log_mean, 50.0))
    if n_outcomes == 2:
        return math.exp(-mean) if hits == 0 else -math.expm1(-mean)
    is_tail = hits == n_outcomes - 1
    if is_tail and mean < 1.0:
        # Summed from its own first term: one minus the others would lose all digits of a rare outcome.
        term = math.exp(hits * log_mean - mean - math.lgamma(hits + 1.0))
        total = term
        for h in range(hits + 1, hits + _N_TAIL):
            term *= mean / h
            total += term
        return total
    if not is_tail:
        return math.exp(hits * log_mean - mean - math.lgamma(hits + 1.0))
    others = 0.0
    for h in range(hits):
        others += math.exp(h * log_mean - mean - math.lgamma(h + 1.0))
    return max(0.0, 1.0 - others)


# Most of a decision's time is spent here: two outcomes share their exponentials, and where no hit is to be expected
# (mu below 1e-17) both are what they are without a source.
@numba.njit(cache=True, nogil=True)
def _hit_or_not_into(log_mean, floor, power, likelihood, weight, log_weight):
    scale = 1.0 - 2.0 * floor
    log_never = math.log(floor) if floor > 0.0 else 0.0
    for i in range(log_mean.shape[0]):
        k = power[i]
        never_weight = math.exp(k * log_never) if floor > 0.0 else 0.0
        sure_log = k * math.log1p(-floor)
        sure_weight = math.exp(sure_log)
        for j in range(log_mean.shape[1]):
            if log_mean[i, j] < _NEVER:
                likelihood[i, 0, j], likelihood[i, 1, j] = 1.0 - floor, floor
                weight[i, 0, j], weight[i, 1, j] = sure_weight, never_weight
                log_weight[i, 0, j], log_weight[i, 1, j] = sure_log, k * log_never
                continue
            mean = math.exp(min(log_mean[i, j], 50.0))
            none = math.exp(-mean)
            # Two terms of the series where one minus the other would lose digits: either is right to 2e-11.
            some = mean * (1.0 - 0.5 * mean) if mean < 1e-5 else 1.0 - none
            miss, hit = floor + scale * none, floor + scale * some
            likelihood[i, 0, j], likelihood[i, 1, j] = miss, hit
            log_miss = k * math.log(miss) if miss > 0.0 else 0.0
            log_hit = k * math.log(hit)
            log_weight[i, 0, j], log_weight[i, 1, j] = log_miss, log_hit
            if k == 1.0:
                weight[i, 0, j], weight[i, 1, j] = miss, hit
            else:
                weight[i, 0, j] = math.exp(log_miss) if miss > 0.0 else 0.0
                weight[i, 1, j] = math.exp(log_hit)


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
    Held by:
        tests/unit/search/bayes/test_encounters.py
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
                    log_w = power[i] * math.log(value)
                    log_weight[i, h, j] = log_w
                    weight[i, h, j] = value if power[i] == 1.0 else math.exp(log_w)


@numba.njit(cache=True, nogil=True)
def log_k0_of(x):
    """Return `log_k0` of each number of a flat array."""
    out = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        out[i] = log_k0(x[i])
    return out
