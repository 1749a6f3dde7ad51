"""ROC curves: how well declared confidence separates environments with a source from those without one."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from gslcosim_bench.statistics.estimates import (
    LEVEL,
    UNDEFINED,
    Estimate,
    as_finite_row,
    check_same_length,
    two_sided_z,
)


@dataclass(frozen=True)
class Roc:
    """An ROC curve with its area.

    Attributes:
        threshold: (m,) confidences, falling, the first infinite: a run is called positive from there on.
        false_positive: (m,) share of runs without a source that are called positive.
        true_positive: (m,) share of runs with a source that are called positive (and, of a localisation ROC, declared
            at the right place).
        area: P(positive > negative) + P(equal) / 2 with its interval; n counts both kinds of runs.
        n_positive: Runs with a source.
        n_negative: Runs without.
    """

    threshold: np.ndarray
    false_positive: np.ndarray
    true_positive: np.ndarray
    area: Estimate
    n_positive: int
    n_negative: int


def roc(score: np.ndarray, is_positive: np.ndarray) -> Roc:
    """Return the ROC curve of confidences and its area.

    Args:
        score: (n,) highest confidence that was declared in each run, 0 where nothing was.
        is_positive: (n,) whether the room had a source.

    Returns:
        The curve; the area is undefined without both kinds of runs. Its interval is DeLong's on the logit scale, and
        Newcombe's where the area is 0 or 1 or shows no spread.

    Source:
        Fawcett 2006, doi:10.1016/j.patrec.2005.10.010 (curve); DeLong, DeLong and Clarke-Pearson 1988,
        doi:10.2307/2531595 (variance); Pepe 2003 (logit scale);
        Newcombe 2006, doi:10.1002/sim.2324, method 5.
    """
    score, is_positive = as_finite_row(score, "score"), np.asarray(is_positive, dtype=bool)
    check_same_length(score=score, is_positive=is_positive)
    return _curve(score[is_positive], score[~is_positive])


def localisation_roc(score: np.ndarray, is_positive: np.ndarray, is_near: np.ndarray) -> Roc:
    """Return the ROC curve in which a source counts as found only if the declared place is near it.

    A run with a source that is declared elsewhere, or nowhere, is called positive at no threshold, so the curve ends at
    the share of runs declared at the right place, and so does the greatest possible area.

    Args:
        score: (n,) highest confidence that was declared in each run, 0 where nothing was.
        is_positive: (n,) whether the room had a source.
        is_near: (n,) whether the place declared with that confidence is within the success radius of the source.

    Source:
        Starr et al. 1975, doi:10.1148/116.3.533; Swensson 1996, doi:10.1118/1.597758.
    """
    score, is_positive = as_finite_row(score, "score"), np.asarray(is_positive, dtype=bool)
    is_near = np.asarray(is_near, dtype=bool)
    check_same_length(score=score, is_positive=is_positive, is_near=is_near)
    localised = np.where(is_near, score, -math.inf)
    return _curve(localised[is_positive], score[~is_positive])


def _curve(positive: np.ndarray, negative: np.ndarray) -> Roc:
    every = np.concatenate([positive, negative])
    threshold = np.concatenate([[math.inf], np.unique(every[np.isfinite(every)])[::-1]])
    false_positive, true_positive = (_share_from(kind, threshold) for kind in (negative, positive))
    area = _area(positive, negative)
    return Roc(threshold, false_positive, true_positive, area, positive.size, negative.size)


# Share of scores at or above each threshold.
def _share_from(scores: np.ndarray, threshold: np.ndarray) -> np.ndarray:
    if scores.size == 0:
        return np.full(threshold.shape, math.nan)
    return 1.0 - np.searchsorted(np.sort(scores), threshold) / scores.size


def _area(positive: np.ndarray, negative: np.ndarray) -> Estimate:
    m, n = positive.size, negative.size
    if m == 0 or n == 0:
        return UNDEFINED
    of_positive, of_negative = _beaten(positive, negative), 1.0 - _beaten(negative, positive)
    area = float(of_positive.mean())
    spreads = [
        float(shares.var(ddof=1)) / shares.size if shares.size > 1 else 0.0 for shares in (of_positive, of_negative)
    ]
    if not 0.0 < area < 1.0 or sum(spreads) == 0.0:
        return Estimate(area, *_newcombe(area, m, n), m + n)
    half = two_sided_z(LEVEL) * math.sqrt(sum(spreads)) / (area * (1.0 - area))
    logit = math.log(area / (1.0 - area))
    low, high = special.expit([logit - half, logit + half]).tolist()
    return Estimate(area, low, high, m + n)


# Which share of the others each score beats, ties half.
def _beaten(scores: np.ndarray, others: np.ndarray) -> np.ndarray:
    ordered = np.sort(others)
    left, right = (np.searchsorted(ordered, scores, side=side) for side in ("left", "right"))
    return (left + right) / (2.0 * others.size)


# Both areas t with (area - t)^2 = z^2 V(t), V after Hanley and McNeil 1982 with (m + n) / 2 for both numbers of runs.
def _newcombe(area: float, m: int, n: int) -> tuple[float, float]:
    z, more = two_sided_z(LEVEL), (m + n) / 2.0 - 1.0

    def excess(t: float) -> float:
        variance = t * (1.0 - t) / (m * n) * (1.0 + more * (1.0 - t) / (2.0 - t) + more * t / (1.0 + t))
        return (area - t) ** 2 - z * z * variance

    # The area itself is a root too where it is 0 or 1: the search begins beside it.
    ends = ((end, area + 1e-9 * (end - area)) for end in (0.0, 1.0))
    low, high = (float(optimize.root_scalar(excess, bracket=each).root) if each[0] != area else area for each in ends)
    return low, high
