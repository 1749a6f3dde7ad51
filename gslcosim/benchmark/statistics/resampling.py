"""Bootstrap samples of rows: within strata, and whole clusters at a time."""

import math
from collections.abc import Callable, Iterator, Sized

import numpy as np

from gslcosim.benchmark.statistics.estimates import (
    LEVEL,
    N_DRAWS,
    SEED,
    UNDEFINED,
    Estimate,
    Seed,
    check_same_length,
    generator_of,
    percentile_interval,
)

# Rows times draws held at once: 32 MB of indices.
_CHUNK_ENTRIES = 4_000_000


def bootstrap(
    n: int,
    statistic: Callable[[np.ndarray], np.ndarray],
    *,
    strata: np.ndarray | None = None,
    clusters: np.ndarray | None = None,
    level: float = LEVEL,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Estimate:
    """Return a statistic of rows with its percentile bootstrap interval.

    Args:
        n: Rows.
        statistic: From (d, m) indices of rows to the (d,) statistic of each of the d samples.
        strata: (n,) labels; each stratum is drawn from apart. None: one stratum.
        clusters: (n,) labels; rows of a cluster are drawn together. None: each row for itself.
        level: Confidence level, 0 to 1.
        seed: Of the draws. Calls with the same seed, strata and clusters draw the same rows.
        n_draws: Bootstrap samples.

    Returns:
        The estimate; without interval where no stratum has two clusters (or rows).
    """
    if n == 0:
        return UNDEFINED
    value = float(statistic(np.arange(n)[None, :])[0])
    chunks = row_draws(n, strata=strata, clusters=clusters, seed=seed, n_draws=n_draws)
    draws = np.concatenate([np.asarray(statistic(rows), dtype=np.float64) for rows in chunks])
    return Estimate(value, *percentile_interval(draws, level, freedom_of(n, strata=strata, clusters=clusters)), n)


def row_draws(
    n: int,
    *,
    strata: np.ndarray | None = None,
    clusters: np.ndarray | None = None,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Iterator[np.ndarray]:
    """Yield bootstrap samples of rows, many at a time.

    From a stratum of k clusters (or rows) k - 1 are drawn with replacement, so that the variance of a mean over draws
    is s^2 / k without bias. Drawing k would shrink it by (k - 1) / k: by half for two repetitions of each case.
    A stratum of one shows no spread and adds none. Strata that share a cluster (starts that met the same gas) are drawn
    from together, so that the cluster stays whole.

    Args:
        n: Rows.
        strata: (n,) labels, or None.
        clusters: (n,) labels, or None.
        seed: Of the draws.
        n_draws: Samples in total.

    Yields:
        (d, m) indices of rows; the d sum up to `n_draws`.

    Source:
        McCarthy and Snowden 1985, The Bootstrap and Finite Population Sampling (k - 1 of k in each stratum).
    """
    rng = generator_of(seed)
    groups = _groups(n, strata, clusters)
    if all(len({len(rows) for rows in group}) == 1 for group in groups):
        yield from _equal_clusters(groups, rng, n_draws)
    else:
        yield from _unequal_clusters(groups, rng, n_draws)


def freedom_of(n: int, *, strata: np.ndarray | None = None, clusters: np.ndarray | None = None) -> int:
    """Return the degrees of freedom of the spread: clusters (or rows) less strata; 0 where no spread can be seen."""
    return sum(max(len(group) - 1, 0) for group in _groups(n, strata, clusters))


def draw_counts(
    n: int,
    *,
    strata: np.ndarray | None = None,
    clusters: np.ndarray | None = None,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Iterator[np.ndarray]:
    """Yield how often each row was drawn, (d, n), for the samples of `row_draws`: weights that serve many columns."""
    for rows in row_draws(n, strata=strata, clusters=clusters, seed=seed, n_draws=n_draws):
        slot = rows + n * np.arange(len(rows))[:, None]
        yield np.bincount(slot.ravel(), minlength=n * len(rows)).reshape(len(rows), n).astype(np.float64)


def codes_of(labels: np.ndarray) -> np.ndarray:
    """Return labels as 0, 1, 2 … in the order of first appearance, so that draws do not depend on how they sort."""
    _, first, codes = np.unique(np.asarray(labels), return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[codes.reshape(-1)]


# For each stratum its clusters, for each cluster its rows.
def _groups(
    n: int, strata: np.ndarray | None, clusters: np.ndarray | None
) -> list[np.ndarray] | list[list[np.ndarray]]:
    stratum = np.zeros(n, dtype=np.intp) if strata is None else _codes(strata, n)
    if clusters is None:
        return [rows[:, None] for rows in _members(stratum)]
    cluster = _codes(clusters, n)
    stratum = _joined(stratum, cluster)
    rows_of = _members(cluster)
    return [[rows_of[c] for c in np.unique(cluster[rows])] for rows in _members(stratum)]


def _equal_clusters(
    groups: list[np.ndarray] | list[list[np.ndarray]], rng: np.random.Generator, n_draws: int
) -> Iterator[np.ndarray]:
    tables = [np.asarray(group) for group in groups]
    for d in _chunks(sum(table.size for table in tables), n_draws):
        picked = [table[rng.integers(0, len(table), (d, _n_drawn(table)))].reshape(d, -1) for table in tables]
        yield np.concatenate(picked, axis=1)


def _unequal_clusters(
    groups: list[np.ndarray] | list[list[np.ndarray]], rng: np.random.Generator, n_draws: int
) -> Iterator[np.ndarray]:
    for _ in range(n_draws):
        drawn = [group[i] for group in groups for i in rng.integers(0, len(group), _n_drawn(group))]
        yield np.concatenate(drawn)[None, :]


def _n_drawn(group: Sized) -> int:
    return max(1, len(group) - 1)


def _chunks(n: int, n_draws: int) -> Iterator[int]:
    at_once = max(1, _CHUNK_ENTRIES // n)
    for _ in range(math.ceil(n_draws / at_once)):
        yield min(at_once, n_draws)
        n_draws -= at_once


def _codes(labels: np.ndarray, n: int) -> np.ndarray:
    check_same_length(rows=np.empty(n), labels=labels)
    return codes_of(labels)


def _members(codes: np.ndarray) -> list[np.ndarray]:
    order = np.argsort(codes, kind="stable")
    return np.split(order, np.cumsum(np.bincount(codes))[:-1])


# Gives strata that share a cluster the same code.
def _joined(stratum: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    while True:
        of_cluster = np.full(cluster.max() + 1, stratum.max() + 1)
        np.minimum.at(of_cluster, cluster, stratum)
        of_stratum = np.arange(stratum.max() + 1)
        np.minimum.at(of_stratum, stratum, of_cluster[cluster])
        if np.array_equal(of_stratum[stratum], stratum):
            return codes_of(stratum)
        stratum = of_stratum[stratum]
