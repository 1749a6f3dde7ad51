"""Performance profiles: how often an entry is how much slower than a reference, and how fast it meets targets."""

from dataclasses import dataclass

import numpy as np

from gslcosim.base.errors import ShapeError
from gslcosim.bench.statistics.estimates import (
    LEVEL,
    N_DRAWS,
    SEED,
    Seed,
    as_finite_row,
    check_same_length,
    degrees_of_freedom,
    draw_counts,
    percentile_interval,
)
from gslcosim.bench.statistics.rates import wilson
from gslcosim.bench.statistics.times import Curve

PROFILE_TAU = (1.0, 2.0, 5.0, 10.0)
"""Factors at which a profile is told in tables."""


@dataclass(frozen=True)
class Profile:
    """A share of scenarios over the factor by which an entry may be slower than the reference.

    Attributes:
        tau: (m,) factors.
        value: (m,) shares, 0 to 1; the last ones tend to the rate of success.
        low: (m,) lower ends of Wilson's intervals.
        high: (m,) upper ends.
        n: Scenarios (or trials).
    """

    tau: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    n: int


def performance_profile(
    times: np.ndarray, reference: np.ndarray, tau: np.ndarray | None = None, level: float = LEVEL
) -> Profile:
    """Return in which share of scenarios an entry is within a factor of the reference.

    rho(tau) = share of {t <= tau t_ref}

    Args:
        times: (n,) time of the entry in each scenario [s], infinite where it failed.
        reference: (n,) time of the reference in each, > 0 [s]: the oracle's, which does not change with the entrants.
        tau: (m,) factors; None: 1, 2, 5, 10.
        level: Confidence level, 0 to 1.

    Raises:
        ShapeError: lengths differ, or a time of the reference is not finite and above zero.

    Source:
        Dolan and Moré 2002, doi:10.1007/s101070100263.
    Deviation:
        A fixed reference instead of the best entrant.
    """
    reference = as_finite_row(reference, "reference")
    times = np.asarray(times, dtype=np.float64)
    check_same_length(times=times, reference=reference)
    if np.any(reference <= 0.0):
        raise ShapeError(f"reference: expected times above 0 s, the least is {reference.min():g} s. Leave these out.")
    factors = np.asarray(PROFILE_TAU if tau is None else tau, dtype=np.float64)
    # Both sides in one unit: a quotient of equal times is 1 to the bit.
    ratio = np.sort(times / reference)
    within = np.searchsorted(ratio, factors, side="right")
    shares = [wilson(int(count), times.size, level) for count in within]
    value, low, high = np.array([(share.value, share.low, share.high) for share in shares]).reshape(-1, 3).T
    return Profile(factors, value, low, high, times.size)


def runtime_distribution(
    times_s: np.ndarray,
    at_s: np.ndarray,
    *,
    clusters: np.ndarray | None = None,
    level: float = LEVEL,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Curve:
    """Return which share of all (trial, target) pairs has been met by a time, with a band over trials.

    Args:
        times_s: (n, m) when each of n trials first met each of m targets, such as radii of 5, 2, 1 and 0.5 m around
            the source [s]; infinite (or nan) where it never did.
        at_s: (k,) when to give the fraction [s].
        clusters: (n,) labels of trials that are drawn together.
        level: Confidence level of the pointwise bootstrap band, 0 to 1.
        seed: Of the bootstrap.
        n_draws: Bootstrap samples.

    Returns:
        The curve; n counts trials.

    Raises:
        ShapeError: not two dimensions.

    Source:
        Hansen et al. 2021, COCO, doi:10.1080/10556788.2020.1808977, without simulated restarts.
    """
    times_s, at_s = np.asarray(times_s, dtype=np.float64), np.asarray(at_s, dtype=np.float64)
    if times_s.ndim != 2:
        raise ShapeError(f"times_s: expected trials in rows and targets in columns, was {times_s.shape}.")
    n, m = times_s.shape
    if n == 0 or m == 0:
        unknown = np.full(at_s.shape, np.nan)
        return Curve(at_s, unknown, unknown, unknown, 0)
    met = (times_s[:, :, None] <= at_s).mean(axis=1)
    draws = np.concatenate(
        [
            counts @ met / counts.sum(axis=1, keepdims=True)
            for counts in draw_counts(n, clusters=clusters, seed=seed, n_draws=n_draws)
        ]
    )
    freedom = degrees_of_freedom(n, clusters=clusters)
    low, high = np.array([percentile_interval(at_once, level, freedom) for at_once in draws.T]).reshape(-1, 2).T
    return Curve(at_s, met.mean(axis=0), low, high, n)
