"""Aggregates over cells (environment, source, start), with whole sampling units resampled."""

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
    encode_labels,
)

Statistic = Callable[[np.ndarray], np.ndarray]
"""From (d, m) samples to (d,)."""

CellStatistic = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From (d, m) means of cells and (d, m) how often each cell was drawn to (d,)."""


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean over the last axis."""
    return np.asarray(values.mean(axis=-1))


def mean_of_cells(means: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the mean over cells, each as often as it was drawn."""
    return (means * weights).sum(axis=-1) / weights.sum(axis=-1)


def worst_quarter_of_cells(means: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the mean over the quarter of the cells in which it is lowest, ceil(m / 4) of m: how bad it gets.

    Args:
        means: (d, m) scores of cells.
        weights: (d, m) how often each cell was drawn.
    """
    order = np.argsort(means, axis=-1, kind="stable")
    means, weights = (np.take_along_axis(part, order, axis=-1) for part in (means, weights))
    before = np.cumsum(weights, axis=-1) - weights
    is_worst = before < 0.25 * weights.sum(axis=-1, keepdims=True) - 1e-9
    return mean_of_cells(means, weights * is_worst)


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
        clusters: (n,) label of the room or plume of each trial, whose trials are drawn as one; None: each for itself.
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
    statistic: CellStatistic = mean_of_cells,
    *,
    clusters: np.ndarray | None = None,
    strata: np.ndarray | None = None,
    rng: Seed = SEED,
    n_draws: int = N_DRAWS,
    level: float = LEVEL,
) -> Estimate:
    """Return a statistic of the means of cells: each cell counts the same, however many trials it has.

    With success as 0 and 1 the means are rates. A cell counts in a draw as often as it was drawn: twice where its room
    was drawn twice, not at all where its room was left out.

    Args:
        values: (n,) one per trial.
        cells: (n,) label of the cell of each trial.
        statistic: `mean_of_cells` or `worst_quarter_of_cells`.
        clusters: (n,) label of the room or plume of each trial, whose trials are drawn as one.
        strata: (n,) label of what is drawn from apart; None: one stratum.
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
    size = np.bincount(code)

    def of_means(rows: np.ndarray) -> np.ndarray:
        slot = (code[rows] + n_cells * np.arange(len(rows))[:, None]).ravel()
        trials = np.bincount(slot, minlength=n_cells * len(rows)).reshape(len(rows), n_cells)
        sums = np.bincount(slot, weights=values[rows].ravel(), minlength=n_cells * len(rows)).reshape(trials.shape)
        return statistic(sums / np.maximum(trials, 1), trials / size)

    return bootstrap(values.size, of_means, strata=strata, clusters=clusters, level=level, seed=rng, n_draws=n_draws)
