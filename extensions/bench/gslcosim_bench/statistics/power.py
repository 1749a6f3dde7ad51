"""Power of paired comparisons: how many pairs show a difference in success, by McNemar's exact test."""

import numpy as np

from gslcosim.base.errors import ModelError, ShapeError

LARGEST_N_PAIRS = 20_000


def paired_power(n_pairs: int, *, difference: float, discordance: float, alpha: float = 0.05) -> float:
    """Return the chance that McNemar's exact test finds a true difference in success.

    Of n pairs M are discordant, M ~ Bin(n, discordance); in X of them the better entry alone succeeds,
    X ~ Bin(M, (discordance + difference) / (2 discordance)); the test refuses where p(X, M) <= alpha.

    Args:
        difference: Of the two rates of success, above 0.
        discordance: Share of pairs in which just one entry succeeds; at least the difference.

    Held by:
        extensions/bench/tests/unit/statistics/test_power.py (simulated pairs)
    """
    from scipy import stats

    if not 0.0 < difference <= discordance <= 1.0:
        raise ShapeError(
            "difference, discordance: expected 0 < difference <= discordance <= 1, "
            f"were {difference:g} and {discordance:g}."
        )
    n_discordant = np.arange(n_pairs + 1)
    weights = stats.binom.pmf(n_discordant, n_pairs, discordance)
    share = (discordance + difference) / (2.0 * discordance)
    # Both tails: the largest count of the rarer side that is still significant, -1 where none is.
    limit = np.asarray(stats.binom.ppf(alpha / 2.0, n_discordant, 0.5), dtype=np.int64)
    limit = np.where(stats.binom.cdf(limit, n_discordant, 0.5) > alpha / 2.0, limit - 1, limit)
    found = stats.binom.cdf(limit, n_discordant, share) + stats.binom.sf(n_discordant - limit - 1, n_discordant, share)
    return float(np.sum(weights * np.where(limit >= 0, found, 0.0)))


def pairs_needed(
    *, difference: float, discordance: float, power: float = 0.8, alpha: float = 0.05, design_effect: float = 1.0
) -> int:
    """Return how many pairs show a difference with the given power.

    Args:
        power: Chance to find it, 0 to 1.
        design_effect: By how much pairs that share a room or plume inflate the variance:
            1 + (m - 1) rho for groups of m with the correlation rho (Kish 1965).
    """
    low, high = 1, 2
    arguments = {"difference": difference, "discordance": discordance, "alpha": alpha}
    while paired_power(high, **arguments) < power:
        low, high = high, 2 * high
        if low > LARGEST_N_PAIRS:
            raise ModelError(f"pairs_needed: more than {LARGEST_N_PAIRS} pairs. Ask for a larger difference.")
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if paired_power(middle, **arguments) >= power else (middle, high)
    return int(np.ceil(high * design_effect))
