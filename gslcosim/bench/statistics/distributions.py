"""Quantiles and tails of distributions that intervals and tests need, without loading a large library."""

import math
from collections.abc import Callable
from functools import lru_cache
from statistics import NormalDist

_SMALLEST = 1e-300
_CLOSE = 1e-15
_MANY = 10_000


def normal_quantile(probability: float) -> float:
    """Return the point below which the standard normal distribution has this probability."""
    return NormalDist().inv_cdf(probability)


def two_sided_z(level: float) -> float:
    """Return z such that a standard normal number lies within ±z with the probability `level`; 1.96 for 0.95."""
    return normal_quantile(0.5 + level / 2.0)


def normal_tail(z: float) -> float:
    """Return the probability that a standard normal number is above z."""
    return 0.5 * math.erfc(z / math.sqrt(2.0))


def beta_cdf(x: float, a: float, b: float) -> float:
    """Return the regularised incomplete beta function I_x(a, b).

    Args:
        x: 0 to 1.
        a: First shape, > 0.
        b: Second shape, > 0.

    Source:
        DLMF 8.17.22, continued fraction, evaluated by Lentz's method; 8.17.4 for the far side.
    """
    if x <= 0.0 or x >= 1.0:
        return float(x >= 1.0)
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - beta_cdf(1.0 - x, b, a)
    log_front = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    return math.exp(log_front) / (a * _fraction(lambda m: _beta_term(m, x, a, b), 1.0))


# The m-th partial numerator of DLMF 8.17.22; all partial denominators are 1.
def _beta_term(m: int, x: float, a: float, b: float) -> tuple[float, float]:
    half = m // 2
    if m % 2:
        return -(a + half) * (a + b + half) * x / ((a + 2 * half) * (a + 2 * half + 1)), 1.0
    return half * (b - half) * x / ((a + 2 * half - 1) * (a + 2 * half)), 1.0


# first + n_1/(d_1 + n_2/(d_2 + ...)) by Lentz's method in the form of Thompson and Barnett 1986.
def _fraction(term: Callable[[int], tuple[float, float]], first: float) -> float:
    value = c = first or _SMALLEST
    d = 0.0
    for m in range(1, _MANY):
        numerator, denominator = term(m)
        d = 1.0 / (denominator + numerator * d or _SMALLEST)
        c = denominator + numerator / c or _SMALLEST
        value *= c * d
        if abs(c * d - 1.0) < _CLOSE:
            break
    return value


def beta_quantile(probability: float, a: float, b: float) -> float:
    """Return the x at which I_x(a, b) has this probability, by bisection."""
    return _root(lambda x: beta_cdf(x, a, b) - probability, 0.0, 1.0)


@lru_cache(maxsize=1024)
def student_quantile(probability: float, freedom: float) -> float:
    """Return the point below which Student's t has this probability, 0 < probability < 1.

    Source:
        Abramowitz and Stegun 1964, 26.5.27: with x = f / (f + t^2), P(|T| > t) = I_x(f/2, 1/2).
    """
    if probability < 0.5:
        return -student_quantile(1.0 - probability, freedom)
    if probability == 0.5:
        return 0.0
    x = beta_quantile(2.0 * (1.0 - probability), freedom / 2.0, 0.5)
    return math.sqrt(freedom * (1.0 - x) / x)


def chi_square_tail(value: float, freedom: int) -> float:
    """Return the probability that chi-square with so many degrees of freedom is above a value.

    Source:
        DLMF 8.11.4 (series of the lower incomplete gamma function) and 8.9.2 (continued fraction of the upper one).
    """
    a, x = freedom / 2.0, value / 2.0
    if x <= 0.0:
        return 1.0
    front = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        return 1.0 - front * _lower_gamma_series(a, x)
    return front / _fraction(lambda m: (-m * (m - a), x + 2 * m + 1.0 - a), x + 1.0 - a)


# gamma(a, x) / (x^a e^-x)
def _lower_gamma_series(a: float, x: float) -> float:
    term = total = 1.0 / a
    for k in range(1, _MANY):
        term *= x / (a + k)
        total += term
        if term < total * _CLOSE:
            break
    return total


# Where a function that rises from below to above zero is zero.
def _root(function: Callable[[float], float], low: float, high: float) -> float:
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if function(middle) < 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
