"""Paired comparison of two entries that met the same cases: tests and differences."""

import math
from collections.abc import Iterator

import numpy as np

from gslcosim_bench.statistics.estimates import (
    N_DRAWS,
    SEED,
    Estimate,
    as_finite_row,
    bootstrap_mean,
    check_same_length,
    encode_labels,
)

# Up to here all patterns of signs are counted instead of drawn: 2^14 rows.
_EXACT_SIGNS = 14
_TOSSES_AT_ONCE = 2_000_000

N_FLIPS = 10_000
"""Patterns of signs that a permutation test draws: p has a standard error of 0.002 at 0.05."""


def paired_difference(
    a: np.ndarray,
    b: np.ndarray,
    *,
    clusters: np.ndarray | None = None,
    strata: np.ndarray | None = None,
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
    return bootstrap_mean(_differences(a, b), strata, clusters=clusters, n_draws=n_draws)


def sign_flip(a: np.ndarray, b: np.ndarray, *, clusters: np.ndarray | None = None) -> float:
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
    return float(sign_flips(difference[:, None], clusters=clusters)[0])


def sign_flips(differences: np.ndarray, *, clusters: np.ndarray | None = None, n_flips: int = N_FLIPS) -> np.ndarray:
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
        hits = sum(np.sum(np.abs(drawn) >= reached[many], axis=0) for drawn in _tossed_sums(sums[:, many], n_flips))
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
def _tossed_sums(differences: np.ndarray, n_flips: int) -> Iterator[np.ndarray]:
    rng, n = np.random.default_rng(SEED), len(differences)
    at_once = max(1, _TOSSES_AT_ONCE // n)
    for start in range(0, n_flips, at_once):
        tosses = rng.integers(0, 2, (min(at_once, n_flips - start), n), dtype=np.int8)
        yield (1.0 - 2.0 * tosses) @ differences
