"""Nulls: what entries have to beat in each case, chosen without the luck of the flight that they are compared with."""

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.estimates import check_same_length, encode_labels

Floats = NDArray[np.float64]


def best_null_elsewhere(success: Floats, groups: NDArray[np.int64]) -> Floats:
    """Return the success in each flight of the null that is best in the other flights of its group.

    b_r = argmax over k of sum over s != r of y_sk        y_sk success of null k in flight s of the group
    value_r = mean of y_rk over the nulls k that are best: a tie is a toss

    The better of several nulls in the same flights that they are judged by would be too good: of two that succeed in
    half of ten flights, the better one has 59 % there. Chosen in the others, a null's success in flight r does not
    depend on its choice, so the mean is that of a null chosen with the flights of a group less one; it is never above
    the best null's, and less where nulls are hard to tell apart.

    Args:
        success: (n, n_nulls) 1 or 0 by flight and null; nan where a null has not flown.
        groups: (n,) label of the cases that share a null, such as the scenario.

    Returns:
        (n,) 0 to 1; nan where no null has flown. In a group of one flight all nulls are best.

    Source:
        Ours: the selection of a null by leave-one-out, as of a model by cross-validation (Stone 1974).
    Held by:
        extensions/bench/tests/unit/statistics/test_nulls.py (no bias for equal nulls)
    """
    success = np.asarray(success, dtype=np.float64)
    if success.ndim != 2 or not success.shape[1]:
        raise ShapeError(f"success: expected a row for each flight and a column for each null, was {success.shape}.")
    check_same_length(success=success, groups=groups)
    found = np.full(len(success), np.nan)
    code = encode_labels(np.asarray(groups)) if len(success) else np.zeros(0, dtype=np.int64)
    for group in range(int(code.max(initial=-1)) + 1):
        rows = np.flatnonzero(code == group)
        own = success[rows]
        others = np.nansum(own, axis=0)[None, :] - np.nan_to_num(own)
        n_others = (~np.isnan(own)).sum(axis=0)[None, :] - ~np.isnan(own)
        # A null that has not flown elsewhere is the worst of those that have flown here.
        rate = np.where(n_others > 0, others / np.maximum(n_others, 1), -1.0)
        rate = np.where(np.isnan(own), -np.inf, rate)
        is_best = (rate >= rate.max(axis=1, keepdims=True) - 1e-12) & ~np.isnan(own)
        n_best = is_best.sum(axis=1)
        total = np.where(is_best, own, 0.0).sum(axis=1)
        found[rows] = np.where(n_best > 0, total / np.maximum(n_best, 1), np.nan)
    return found
