"""Aggregates over cells (environment, source, start), with trials resampled inside each cell.

A statistic here takes values in its last axis, so that it works on one sample and on many bootstrap samples at once:
from (..., m) to (...). `mean`, `interquartile_mean` and `optimality_gap` are such statistics.
"""

from collections.abc import Callable

import numpy as np

from gslcosim.bench.statistics.estimates import (
    LEVEL,
    N_DRAWS,
    SEED,
    UNDEFINED,
    Estimate,
    Seed,
    as_finite_row,
    bootstrap,
    check_same_length,
    draw_counts,
    encode_labels,
    make_generator,
    percentile_interval,
)

Statistic = Callable[[np.ndarray], np.ndarray]


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean over the last axis."""
    return np.asarray(values.mean(axis=-1))


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Return the mean of the middle half over the last axis.

    The lowest and the highest quarter, floor(m / 4) values each, are left out. Meant for scores and for rates of cells,
    not for 0 and 1: of those it jumps.

    Args:
        values: (..., m) scores.

    Source:
        Agarwal et al. 2021, Deep reinforcement learning at the edge of the statistical precipice, arXiv:2108.13264.
    """
    m = values.shape[-1]
    cut = m // 4
    if cut == 0:
        return mean(values)
    parted = np.partition(values, (cut, m - cut - 1), axis=-1)
    return mean(parted[..., cut : m - cut])


def optimality_gap(values: np.ndarray, target: float = 1.0) -> np.ndarray:
    """Return by how much values fall short of a target on average, over the last axis; more than it does not count.

    gap = mean(max(target - x, 0))

    Args:
        values: (..., m) scores.
        target: The score of a method that leaves nothing to wish for.

    Source:
        Agarwal et al. 2021, arXiv:2108.13264.
    """
    return mean(np.maximum(target - values, 0.0))


def stratified_bootstrap(
    values: np.ndarray,
    strata: np.ndarray | None,
    statistic: Statistic = mean,
    *,
    clusters: np.ndarray | None = None,
    rng: Seed = SEED,
    n_draws: int = N_DRAWS,
    level: float = LEVEL,
) -> Estimate:
    """Return a statistic of trials with an interval from trials drawn again inside each stratum.

    Entries whose rows have the same strata and clusters in the same order get the same draws, and so stay paired.

    Args:
        values: (n,) one per trial.
        strata: (n,) label of the cell of each trial; None: one cell.
        statistic: From (d, m) samples to (d,).
        clusters: (n,) label of the gas seed of each trial, whose trials are drawn as one; None: each for itself.
        rng: Seed or generator of the draws.
        n_draws: Bootstrap samples.
        level: Confidence level, 0 to 1.

    Raises:
        ShapeError: lengths differ, or a value is not finite.

    Source:
        Agarwal et al. 2021, arXiv:2108.13264, with the ends of `estimates.percentile_interval`.
    Held by:
        tests/unit/bench/statistics/test_aggregates.py, test_simulated_entries.py (coverage)
    """
    values = as_finite_row(values, "values")
    return bootstrap(
        values.size,
        lambda rows: statistic(values[rows]),
        strata=strata,
        clusters=clusters,
        level=level,
        seed=rng,
        n_draws=n_draws,
    )


def bootstrap_cells(
    values: np.ndarray,
    cells: np.ndarray,
    statistic: Statistic = mean,
    *,
    clusters: np.ndarray | None = None,
    rng: Seed = SEED,
    n_draws: int = N_DRAWS,
    level: float = LEVEL,
) -> Estimate:
    """Return a statistic of the means of cells: each cell counts the same, however many trials it has.

    With success as 0 and 1 the means are rates, whose interquartile mean does not jump. Other arguments as for
    `stratified_bootstrap`. A cell that a draw leaves empty (possible with clusters only) is left out of that draw,
    which then goes through the statistic for itself.

    Args:
        values: (n,) one per trial.
        cells: (n,) label of the cell of each trial.
        statistic: From (d, n_cells) means to (d,).
        clusters: (n,) label of the gas seed of each trial.
        rng: Seed or generator of the draws.
        n_draws: Bootstrap samples.
        level: Confidence level, 0 to 1.

    Returns:
        The estimate; n counts trials.
    """
    values = as_finite_row(values, "values")
    check_same_length(values=values, cells=cells)
    if values.size == 0:
        return UNDEFINED
    code = encode_labels(cells)
    n_cells = int(code.max()) + 1

    def of_means(rows: np.ndarray) -> np.ndarray:
        slot = (code[rows] + n_cells * np.arange(len(rows))[:, None]).ravel()
        trials = np.bincount(slot, minlength=n_cells * len(rows)).reshape(len(rows), n_cells)
        sums = np.bincount(slot, weights=values[rows].ravel(), minlength=n_cells * len(rows)).reshape(trials.shape)
        if trials.all():
            return statistic(sums / trials)
        filled = zip(sums, trials, trials > 0)
        return np.array([float(statistic(s[has] / t[has])) for s, t, has in filled])

    return bootstrap(values.size, of_means, strata=cells, clusters=clusters, level=level, seed=rng, n_draws=n_draws)


def probability_of_improvement(
    a: np.ndarray,
    b: np.ndarray,
    *,
    strata_a: np.ndarray | None = None,
    strata_b: np.ndarray | None = None,
    lower_is_better: bool = False,
    rng: Seed = SEED,
    n_draws: int = N_DRAWS,
    level: float = LEVEL,
) -> Estimate:
    """Return how likely a trial of a is better than one of b in the same cell, ties counted half; not paired.

    P = mean over cells of [P(A > B) + P(A = B) / 2]: Mann and Whitney's U / (n_a n_b) of each cell

    Args:
        a: (n_a,) values of one entry.
        b: (n_b,) values of the other.
        strata_a: (n_a,) cells of the former; None: one cell for all.
        strata_b: (n_b,) cells of the latter. Cells that only one of them has are left out.
        lower_is_better: True for times, False for scores.
        rng: Seed or generator of the draws.
        n_draws: Bootstrap samples.
        level: Confidence level, 0 to 1.

    Returns:
        The estimate; n counts the trials of both in common cells.

    Source:
        Agarwal et al. 2021, arXiv:2108.13264.
    """
    a, b = as_finite_row(a, "a"), as_finite_row(b, "b")
    cells_a = np.zeros(a.size) if strata_a is None else np.asarray(strata_a)
    cells_b = np.zeros(b.size) if strata_b is None else np.asarray(strata_b)
    check_same_length(a=a, strata_a=cells_a)
    check_same_length(b=b, strata_b=cells_b)
    common = np.intersect1d(cells_a, cells_b)
    if common.size == 0:
        return UNDEFINED
    sign, generator = (-1.0 if lower_is_better else 1.0), make_generator(rng)
    value, draws, n = 0.0, np.zeros(n_draws), 0
    for cell in common:
        here_a, here_b = sign * a[cells_a == cell], sign * b[cells_b == cell]
        n += here_a.size + here_b.size
        value += float(_win_share(here_a, here_b, *(np.ones((1, part.size)) for part in (here_a, here_b)))[0])
        counts_a = np.concatenate(list(draw_counts(here_a.size, seed=generator, n_draws=n_draws)))
        counts_b = np.concatenate(list(draw_counts(here_b.size, seed=generator, n_draws=n_draws)))
        draws += _win_share(here_a, here_b, counts_a, counts_b)
    low, high = percentile_interval(draws / common.size, level, n - 2 * common.size)
    return Estimate(value / common.size, low, high, n)


# P(A > B) + P(A = B) / 2 of samples given by how often each value was drawn, (d, n_a) and (d, n_b).
def _win_share(a: np.ndarray, b: np.ndarray, counts_a: np.ndarray, counts_b: np.ndarray) -> np.ndarray:
    order = np.argsort(b, kind="stable")
    below = np.zeros((len(counts_b), b.size + 1))
    np.cumsum(counts_b[:, order], axis=1, out=below[:, 1:])
    left, right = (np.searchsorted(b[order], a, side=side) for side in ("left", "right"))
    wins = 0.5 * (below[:, left] + below[:, right])
    return (counts_a * wins).sum(axis=1) / (counts_a.sum(axis=1) * counts_b.sum(axis=1))
