"""Nulls: the best trivial entry for each flight, chosen by the other flights of its group."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.estimates import check_same_length, encode_labels

Floats = NDArray[np.float64]

LEAST_OTHERS = 4
"""Other flights of a group from which a null is chosen: those of a scenario with five repetitions."""


def best_null_elsewhere(success: Floats, groupings: Sequence[NDArray[np.int64]]) -> Floats:
    """Return the success in each flight of the null that is best in the other flights of its group.

    b_r = argmax over k of sum over s != r of y_sk        y_sk success of null k in flight s of the group
    value_r = mean of y_rk over the nulls k that are best: a tie is a toss

    The better of several nulls in the same flights that they are judged by would be too good: of two that succeed in
    half of ten flights, the better one has 59 % there. Chosen in the others, a null's success in flight r does not
    depend on its choice, so the mean is that of a null chosen with the flights of a group less one; it is never above
    the best null's, and less where nulls are hard to tell apart.

    Args:
        success: (n, n_nulls) 1 or 0 by flight and null; nan where a null has not flown.
        groupings: (n,) labels of flights that share a null, from the finest, such as scenarios, to coarser ones, such
            as families. A flight is of the first group with `LEAST_OTHERS` others in which each null that it has has
            flown; where there is none, of all flights.

    Returns:
        (n,) 0 to 1; nan where no null has flown. One flight alone has the mean of its nulls.

    Source:
        Ours: the selection of a null by leave-one-out, as of a model by cross-validation (Stone 1974).
    Held by:
        extensions/bench/tests/unit/statistics/test_nulls.py (no bias for equal nulls)
    """
    success = np.asarray(success, dtype=np.float64)
    if success.ndim != 2 or not success.shape[1]:
        raise ShapeError(f"success: expected a row for each flight and a column for each null, was {success.shape}.")
    if not len(success):
        return np.zeros(0)
    has_flown = ~np.isnan(success)
    # Of all flights first; a null that has not flown elsewhere is the worst.
    others, n_others = _sum_of_others(success, has_flown, np.zeros(len(success), dtype=np.int64))
    rate = np.where(n_others > 0, others / np.maximum(n_others, 1), -1.0)
    is_open = np.ones(len(success), dtype=bool)
    for labels in groupings:
        check_same_length(success=success, labels=labels)
        others, n_others = _sum_of_others(success, has_flown, encode_labels(np.asarray(labels)))
        is_enough = np.asarray(is_open & ((n_others >= LEAST_OTHERS) | ~has_flown).all(axis=1))
        rate[is_enough] = others[is_enough] / np.maximum(n_others[is_enough], 1)
        is_open &= ~is_enough
    rate = np.where(has_flown, rate, -np.inf)
    is_best = (rate >= rate.max(axis=1, keepdims=True) - 1e-12) & has_flown
    n_best = is_best.sum(axis=1)
    total = np.where(is_best, success, 0.0).sum(axis=1)
    return np.where(n_best > 0, total / np.maximum(n_best, 1), np.nan)


# Of each flight: the successes of each null in the other flights of its group, and how many those are.
def _sum_of_others(success: Floats, has_flown: NDArray[np.bool_], code: NDArray[np.int64]) -> tuple[Floats, Floats]:
    sums = np.zeros((2, int(code.max()) + 1, success.shape[1]))
    own = np.nan_to_num(success), has_flown.astype(np.float64)
    for of_group, values in zip(sums, own, strict=True):
        np.add.at(of_group, code, values)
    return sums[0][code] - own[0], sums[1][code] - own[1]
