"""Success rates with intervals that stay honest for few trials and at 0 and 100 %."""

import math

from gslcosim.base.errors import ShapeError
from gslcosim.bench.statistics.distributions import beta_quantile, two_sided_z
from gslcosim.bench.statistics.estimates import LEVEL, UNDEFINED, Estimate


def wilson(successes: int, n: int, level: float = LEVEL) -> Estimate:
    """Return a rate with Wilson's interval: the one that is shown.

    (p + z^2/2n ± z sqrt(p (1 - p) / n + z^2/4n^2)) / (1 + z^2/n)        p = successes / n, z normal quantile

    Args:
        successes: 0 to n.
        n: Trials; undefined for 0.
        level: Confidence level, 0 to 1.

    Raises:
        ShapeError: successes are not between 0 and n.

    Source:
        Wilson 1927, doi:10.1080/01621459.1927.10502953, without continuity correction.
    """
    _check_counts(successes, n)
    if n == 0:
        return UNDEFINED
    p, z = successes / n, two_sided_z(level)
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    low = 0.0 if successes == 0 else centre - half
    high = 1.0 if successes == n else centre + half
    return Estimate(p, low, high, n)


def clopper_pearson(successes: int, n: int, level: float = LEVEL) -> Estimate:
    """Return a rate with the exact interval: for claims of "at least" and for 0 or n successes.

    It covers at least as often as stated for every true rate, and is therefore wider than Wilson's.

    Args:
        successes: 0 to n.
        n: Trials; undefined for 0.
        level: Confidence level, 0 to 1.

    Raises:
        ShapeError: successes are not between 0 and n.

    Source:
        Clopper and Pearson 1934, doi:10.1093/biomet/26.4.404, as quantiles of beta distributions.
    """
    _check_counts(successes, n)
    if n == 0:
        return UNDEFINED
    tail = (1.0 - level) / 2.0
    low = 0.0 if successes == 0 else beta_quantile(tail, successes, n - successes + 1)
    high = 1.0 if successes == n else beta_quantile(1.0 - tail, successes + 1, n - successes)
    return Estimate(successes / n, low, high, n)


def _check_counts(successes: int, n: int) -> None:
    if not 0 <= successes <= n:
        raise ShapeError(f"successes: expected 0 to n = {n}, was {successes}. Give counts of the same trials.")
