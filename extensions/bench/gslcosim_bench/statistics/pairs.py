"""Paired comparison of two entries that met the same cases: tests, differences, and corrections for multiple tests."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim_bench.statistics.estimates import (
    LEVEL,
    N_DRAWS,
    SEED,
    Estimate,
    Seed,
    as_finite_row,
    bootstrap_mean,
    check_same_length,
    encode_labels,
    make_generator,
)

# Up to here all patterns of signs are counted instead of drawn: 2^14 rows.
_EXACT_SIGNS = 14
_TOSSES_AT_ONCE = 2_000_000

N_FLIPS = 10_000
"""Patterns of signs that a permutation test draws: p has a standard error of 0.002 at 0.05."""


@dataclass(frozen=True)
class McNemar:
    """Discordant pairs of two entries: those in which just one of them succeeded.

    Attributes:
        n: Pairs.
        only_a: Pairs in which a succeeded and b failed.
        only_b: Pairs in which b succeeded and a failed.
        p: Exact two-sided p value; 1 without such pairs.
    """

    n: int
    only_a: int
    only_b: int
    p: float


def mcnemar(a: np.ndarray, b: np.ndarray) -> McNemar:
    """Test whether two entries succeed equally often in the same cases.

    p = min(1, 2 P(X <= min(n_a, n_b))), X binomial of n_a + n_b trials with 1/2

    Args:
        a: (n,) successes of one entry.
        b: (n,) successes of the other in the same cases.

    Source:
        McNemar 1947, doi:10.1007/BF02295996, in the exact form.
    """
    from scipy import special

    a, b = np.asarray(a, dtype=bool), np.asarray(b, dtype=bool)
    check_same_length(a=a, b=b)
    only_a, only_b = int(np.sum(a & ~b)), int(np.sum(b & ~a))
    tail = float(special.bdtr(min(only_a, only_b), only_a + only_b, 0.5))
    return McNemar(a.size, only_a, only_b, min(1.0, 2.0 * tail))


def paired_difference(
    a: np.ndarray,
    b: np.ndarray,
    *,
    clusters: np.ndarray | None = None,
    strata: np.ndarray | None = None,
    level: float = LEVEL,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Estimate:
    """Return the mean of a minus b over pairs, with its paired bootstrap interval.

    Args:
        a: (n,) values of one entry: successes as 0 and 1, counted times, scores.
        b: (n,) values of the other in the same cases.
        clusters: (n,) labels of pairs that share their gas and are drawn as one.
        strata: (n,) labels of cells that are drawn from apart.

    Source:
        Efron and Tibshirani 1993, An Introduction to the Bootstrap, chapter 13; ends: `estimates.percentile_interval`.
    """
    return bootstrap_mean(_differences(a, b), strata=strata, clusters=clusters, level=level, seed=seed, n_draws=n_draws)


def sign_flip(
    a: np.ndarray,
    b: np.ndarray,
    *,
    clusters: np.ndarray | None = None,
    seed: Seed = SEED,
    n_flips: int = N_FLIPS,
) -> float:
    """Return the p value of the paired permutation test that the mean difference is zero.

    If it made no difference which entry flew, the sign of each pair's difference would be a toss. p is the share of
    tosses whose sum is at least as far from zero as the one seen: of all patterns up to 14 differences that are not
    zero, else (1 + hits) / (1 + n_flips) of drawn ones.

    Args:
        a: (n,) values of one entry.
        b: (n,) values of the other in the same cases.
        clusters: (n,) labels of pairs whose signs are tossed as one.

    Returns:
        Two-sided p; 1 where all differences are zero, nan without pairs.

    Source:
        Fisher 1935, The Design of Experiments, section 21; (1 + hits) / (1 + n): Phipson and Smyth 2010,
        doi:10.2202/1544-6115.1585.
    """
    difference = _differences(a, b)
    return float(sign_flips(difference[:, None], clusters=clusters, seed=seed, n_flips=n_flips)[0])


def sign_flips(
    differences: np.ndarray, *, clusters: np.ndarray | None = None, seed: Seed = SEED, n_flips: int = N_FLIPS
) -> np.ndarray:
    """Return the p value of `sign_flip` for many columns of differences, with the same tosses for all of them.

    Args:
        differences: (n, m) differences of n pairs, m times; nan where there is no pair.
        clusters: (n,) labels of pairs whose signs are tossed as one.

    Returns:
        (m,) two-sided p.
    """
    has_pairs = ~np.isnan(differences).all(axis=0)
    sums = _sum_clusters(differences, clusters)
    # Sums that are equal but for rounding are ties.
    reached = np.abs(sums.sum(axis=0)) - 1e-9 * np.abs(sums).sum(axis=0)
    is_few = np.count_nonzero(sums, axis=0) <= _EXACT_SIGNS
    p = np.full(sums.shape[1], math.nan)
    for column in np.flatnonzero(is_few & has_pairs):
        p[column] = np.mean(_all_sums(sums[:, column]) >= reached[column])
    many = np.flatnonzero(~is_few)
    if many.size:
        hits = sum(
            np.sum(np.abs(drawn) >= reached[many], axis=0) for drawn in _tossed_sums(sums[:, many], n_flips, seed)
        )
        p[many] = (1 + hits) / (1 + n_flips)
    return p


# Pairs that share their signs are one difference, their sum.
def _sum_clusters(differences: np.ndarray, clusters: np.ndarray | None) -> np.ndarray:
    sums = np.nan_to_num(differences)
    if clusters is None or not len(sums):
        return sums
    check_same_length(pairs=sums, clusters=clusters)
    code = encode_labels(clusters)
    by_cluster = np.zeros((code.max() + 1, sums.shape[1]))
    np.add.at(by_cluster, code, sums)
    return by_cluster


def holm(p_values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return p values corrected for their number: the chance of one false finding among all stays below the level.

    p~_(i) = max_{j <= i} min(1, (m - j + 1) p_(j))        p_(j) ascending, m of them

    Args:
        p_values: (m,) uncorrected; nan (no test was possible) stays nan and is not counted.

    Source:
        Holm 1979, A simple sequentially rejective multiple test procedure.
    """
    p = np.asarray(p_values, dtype=np.float64)
    corrected = np.full(p.shape, math.nan)
    known = np.flatnonzero(~np.isnan(p))
    order = known[np.argsort(p[known], kind="stable")]
    stepped = np.minimum(1.0, p[order] * (known.size - np.arange(known.size)))
    corrected[order] = np.maximum.accumulate(stepped) if known.size else stepped
    return corrected


def mean_ranks(values: np.ndarray) -> np.ndarray:
    """Return ranks from 1 for the lowest value; equal values share the mean of their ranks, (n,)."""
    _, code, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return (last - (count - 1) / 2.0)[code.reshape(-1)]


def _differences(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    a, b = as_finite_row(a, "a"), as_finite_row(b, "b")
    check_same_length(a=a, b=b)
    return a - b


# Sizes of the sums of differences with each pattern of signs.
def _all_sums(difference: np.ndarray) -> np.ndarray:
    difference = difference[difference != 0.0]
    patterns = np.arange(2**difference.size)[:, None] >> np.arange(difference.size) & 1
    return np.abs((1 - 2 * patterns) @ difference)


# Sums of each column with tossed signs, many tosses at a time.
def _tossed_sums(differences: np.ndarray, n_flips: int, seed: Seed) -> Iterator[np.ndarray]:
    rng, n = make_generator(seed), len(differences)
    at_once = max(1, _TOSSES_AT_ONCE // n)
    for start in range(0, n_flips, at_once):
        tosses = rng.integers(0, 2, (min(at_once, n_flips - start), n), dtype=np.int8)
        yield (1.0 - 2.0 * tosses) @ differences
