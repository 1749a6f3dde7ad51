"""Aggregates over cells (environment, source, start), with whole sampling units resampled."""

from dataclasses import replace

import numpy as np

from gslcosim_bench.statistics.estimates import (
    N_DRAWS,
    SEED,
    UNDEFINED,
    Estimate,
    Seed,
    as_finite_row,
    bootstrap,
    check_same_length,
    draw_weights,
    encode_labels,
)


def bootstrap_cells(
    values: np.ndarray,
    cells: np.ndarray,
    *,
    clusters: np.ndarray | None = None,
    strata: np.ndarray | None = None,
    rng: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Estimate:
    """Return the mean over cells of the mean of each: each cell counts the same, however many trials it has.

    With success as 0 and 1 the means are rates. A cell counts in a draw as often as it was drawn: twice where its room
    was drawn twice, not at all where its room was left out; see `estimates.draw_weights` for strata.

    Args:
        values: (n,) one per trial.
        cells: (n,) label of the cell of each trial.
        clusters: (n,) label of the room or plume of each trial, whose trials are drawn as one.
        strata: (n,) label of what is drawn from apart; None: one stratum.

    Returns:
        The estimate; n counts trials.
    """
    values = as_finite_row(values, "values")
    check_same_length(values=values, cells=cells)
    if values.size == 0:
        return UNDEFINED
    code = encode_labels(cells)
    # A row stands for so much of the mean of all cells.
    share = draw_weights(values.size, strata=strata, clusters=clusters) / np.bincount(code)[code]
    weighted = share * values
    drawn = bootstrap(
        values.size,
        lambda rows: weighted[rows].sum(axis=1) / share[rows].sum(axis=1),
        strata=strata,
        clusters=clusters,
        seed=rng,
        n_draws=n_draws,
    )
    return replace(drawn, value=float(np.mean(np.bincount(code, weights=values) / np.bincount(code))))


def bootstrap_worst_quarter(
    values: np.ndarray,
    cells: np.ndarray,
    *,
    clusters: np.ndarray | None = None,
    strata: np.ndarray | None = None,
) -> Estimate:
    """Return the mean over the quarter of the cells in which it is lowest, ceil(m / 4) of m: how bad it gets.

    The cells are chosen once, and the interval is that of their mean. If each draw chose its own, its worst would
    mostly be better than those seen, since the worst room is left out of every third draw.

    Args:
        values: (n,) one per trial.
        cells: (n,) label of the cell of each trial.
    """
    values = as_finite_row(values, "values")
    check_same_length(values=values, cells=cells)
    if values.size == 0:
        return UNDEFINED
    code = encode_labels(cells)
    means = np.bincount(code, weights=values) / np.bincount(code)
    some = np.isin(code, np.argsort(means, kind="stable")[: -(-means.size // 4)])
    labels = [None if each is None else each[some] for each in (clusters, strata)]
    return bootstrap_cells(values[some], code[some], clusters=labels[0], strata=labels[1])
