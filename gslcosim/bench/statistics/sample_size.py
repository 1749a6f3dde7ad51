"""Sample sizes that distinguish two rates."""

import math

from gslcosim.base.errors import UsageError
from gslcosim.bench.statistics.distributions import normal_quantile


def n_for_power(p1: float, p2: float, power: float = 0.8, level: float = 0.05) -> int:
    """Return how many trials of each entry show that two rates differ, when cases are not paired.

    n = (z_{1-level/2} sqrt(2 p (1 - p)) + z_power sqrt(p1 (1 - p1) + p2 (1 - p2)))^2 / (p1 - p2)^2,  p = (p1 + p2) / 2

    Args:
        p1: True rate of one entry, 0 to 1.
        p2: True rate of the other.
        power: Chance to find the difference.
        level: Chance to find one where there is none, two-sided.

    Raises:
        UsageError: the rates are equal or not rates.

    Source:
        Fleiss, Levin and Paik 2003, Statistical Methods for Rates and Proportions, chapter 4.
    """
    _check_rates(p1, p2)
    mean = (p1 + p2) / 2.0
    under_none = normal_quantile(1.0 - level / 2.0) * math.sqrt(2.0 * mean * (1.0 - mean))
    under_some = normal_quantile(power) * math.sqrt(p1 * (1.0 - p1) + p2 * (1.0 - p2))
    return math.ceil(((under_none + under_some) / (p1 - p2)) ** 2)


def n_pairs_for_power(only_a: float, only_b: float, power: float = 0.8, level: float = 0.05) -> int:
    """Return how many pairs show that two rates differ, from the rates of pairs in which just one entry succeeds.

    n = (z_{1-level/2} sqrt(s) + z_power sqrt(s - d^2))^2 / d^2        s = p_a + p_b, d = p_a - p_b of those pairs

    Args:
        only_a: Rate of pairs in which only the one succeeds, 0 to 1.
        only_b: Rate of pairs in which only the other does.
        power: Chance to find the difference.
        level: Chance to find one where there is none, two-sided.

    Raises:
        UsageError: the rates are equal, not rates, or sum up to more than 1.

    Source:
        Connor 1987, doi:10.2307/2531961.
    """
    _check_rates(only_a, only_b)
    one, difference = only_a + only_b, only_a - only_b
    if one > 1.0:
        raise UsageError(f"only_a, only_b: expected a sum of at most 1, was {one:g}. Give shares of all pairs.")
    under_none = normal_quantile(1.0 - level / 2.0) * math.sqrt(one)
    under_some = normal_quantile(power) * math.sqrt(one - difference**2)
    return math.ceil(((under_none + under_some) / difference) ** 2)


def _check_rates(a: float, b: float) -> None:
    if a == b or not (0.0 <= a <= 1.0 and 0.0 <= b <= 1.0):
        raise UsageError(f"rates: expected two different ones from 0 to 1, were {a:g} and {b:g}. Give other rates.")
