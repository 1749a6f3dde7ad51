"""Aggregates over cells (environment, source, start), with trials resampled inside each cell.

A statistic here takes values in its last axis, so that it works on one sample and on many bootstrap samples at once:
from (..., m) to (...). `mean` and `worst_quarter_mean` are such statistics.
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
    encode_labels,
)

Statistic = Callable[[np.ndarray], np.ndarray]


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean over the last axis."""
    return np.asarray(values.mean(axis=-1))


def worst_quarter_mean(values: np.ndarray) -> np.ndarray:
    """Return the mean of the lowest ceil(m / 4) values over the last axis: how bad it gets.

    Args:
        values: (..., m) scores of cells.
    """
    n = -(-values.shape[-1] // 4)
    return mean(np.partition(values, n - 1, axis=-1)[..., :n])


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

    With success as 0 and 1 the means are rates. Other arguments as for `stratified_bootstrap`. A cell that a draw
    leaves empty (possible with clusters only) is left out of that draw, which then goes through the statistic for
    itself.

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
