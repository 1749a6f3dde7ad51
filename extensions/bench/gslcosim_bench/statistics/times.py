"""Times to the source, censored at the limit, and performance profiles of them.

A trial has a time [s] and whether the source was reached then. A trial that did not reach it is *censored*: all that
is known is that it would have taken longer. Failures that ended early (a collision) would not have gone on to find the
source; every function here counts them to the limit.

`time_s` are (n,) times of reaching [s]; those of failures do not count. `reached` (n,) says which reached the source.
`clusters` and `units` are trials that are drawn as one, since they share their room or their gas.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.aggregates import bootstrap_cells
from gslcosim_bench.statistics.estimates import (
    LEVEL,
    N_DRAWS,
    UNDEFINED,
    Estimate,
    as_finite_row,
    bootstrap,
    check_same_length,
    degrees_of_freedom,
    draw_counts,
    encode_labels,
    percentile_interval,
    student_quantile,
)
from gslcosim_bench.statistics.rates import rates_over_units
from gslcosim_bench.statistics.sampling_units import SamplingUnits


@dataclass(frozen=True)
class Curve:
    """A share of trials over time, or over a factor of it, with its pointwise band.

    Attributes:
        at: (m,) times [s], or factors.
        value: (m,) shares, 0 to 1.
        low: (m,) lower ends of the intervals.
        high: (m,) upper ends.
        n: Trials.
    """

    at: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    n: int


def cumulative_success(time_s: np.ndarray, reached: np.ndarray, at_s: np.ndarray, units: SamplingUnits) -> Curve:
    """Return the share of trials that have reached the source, over time, with the band of `rates_over_units`.

    Up to the limit this is the share of all trials that had reached the source by then: one minus Kaplan and Meier's
    curve of trials whose failures search for ever.

    Args:
        at_s: (m,) when to give the fraction, up to the limit [s].

    Source:
        Aalen and Johansen 1978: an early end is a competing event, not a censoring.
    """
    time_s, reached = _trials(time_s, reached)
    for_ever = np.where(reached, time_s, math.inf)
    return Curve(at_s, *rates_over_units(for_ever[:, None] <= at_s, units), time_s.size)


def counted_times(time_s: np.ndarray, reached: np.ndarray, limit_s: float | np.ndarray) -> np.ndarray:
    """Return min(t, T) for trials that reached the source and T for all others, (n,) [s].

    Args:
        limit_s: Time limit T of all trials, or (n,) of each [s].
    """
    time_s, reached = _trials(time_s, reached)
    limits_s = np.broadcast_to(np.asarray(limit_s, dtype=np.float64), time_s.shape)
    return np.where(reached, np.minimum(time_s, limits_s), limits_s)


def restricted_mean(
    time_s: np.ndarray,
    reached: np.ndarray,
    limit_s: float | np.ndarray,
    *,
    clusters: np.ndarray | None = None,
    cells: np.ndarray | None = None,
) -> Estimate:
    """Return the mean time to the source in which failures count the limit [s]: the area below the searching curve.

    RMST = mean(min(t_i, T)), t_i infinite for failures; interval ± t_{n-1} s / sqrt(n)

    With censoring at the limit alone Greenwood's variance of the area is s^2 (n - 1) / n^2, so this is its interval
    with Student's quantile in place of the normal one.

    Args:
        limit_s: Time limit T of all trials, or (n,) of each [s].
        cells: (n,) cases, which count the same however many trials they have; None: each trial does.

    Returns:
        Mean [s] with interval, within 0 and the limit. Where all failed no spread is seen: the lower end is then
        T (1 - p), p the upper end of Clopper and Pearson's interval for no success, as if each would have been at once.

    Source:
        Royston and Parmar 2013, doi:10.1186/1471-2288-13-152.
    Held by:
        extensions/bench/tests/unit/statistics/test_times.py (lifelines), test_simulated_entries.py (coverage)
    """
    counted_s = counted_times(time_s, reached, limit_s)
    n = counted_s.size
    if n == 0:
        return UNDEFINED
    mean_limit_s = float(np.mean(limit_s))
    if not np.any(reached):
        none_high = float(special.betaincinv(1, n, 0.5 + LEVEL / 2.0))
        return Estimate(float(counted_s.mean()), mean_limit_s * (1.0 - none_high), mean_limit_s, n)
    if cells is not None and (clusters is not None or np.ptp(np.bincount(encode_labels(cells))) > 0):
        return bootstrap_cells(counted_s, cells, clusters=clusters)
    if clusters is not None:
        return bootstrap(n, lambda rows: counted_s[rows].mean(axis=1), clusters=clusters)
    value_s, low_s, high_s = _student(counted_s)
    return Estimate(value_s, max(low_s, 0.0), min(high_s, mean_limit_s) if n > 1 else high_s, n)


def median_time(
    time_s: np.ndarray, reached: np.ndarray, *, clusters: np.ndarray | None = None, n_draws: int = N_DRAWS
) -> Estimate:
    """Return the time by which half of the trials have reached the source [s]; infinite if fewer than half do.

    It is the first time at which the searching share is 1/2 or less.

    Source:
        Efron 1981, doi:10.1080/01621459.1981.10477650, bootstrap of the Kaplan-Meier median.
    """
    time_s, reached = _trials(time_s, reached)
    known_s = np.where(reached, time_s, math.inf)

    def lower_median(rows: np.ndarray) -> np.ndarray:
        middle = (rows.shape[1] + 1) // 2 - 1
        return np.partition(known_s[rows], middle, axis=1)[:, middle]

    return bootstrap(known_s.size, lower_median, clusters=clusters, n_draws=n_draws)


def expected_running_time(
    time_s: np.ndarray, reached: np.ndarray, *, clusters: np.ndarray | None = None, n_draws: int = N_DRAWS
) -> Estimate:
    """Return the time to the source if one starts again after each failure [s]; infinite without success.

    ERT = sum of all run times, failed ones included / number of successes

    Args:
        time_s: (n,) run time: of reaching, or of the end of a failure [s].

    Source:
        Hansen et al. 2021, COCO, doi:10.1080/10556788.2020.1808977.
    """
    time_s, reached = _trials(as_finite_row(time_s, "time_s"), reached)

    def ratio(rows: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore"):
            return time_s[rows].sum(axis=1) / reached[rows].sum(axis=1)

    return bootstrap(time_s.size, ratio, clusters=clusters, n_draws=n_draws)


def mean_of_successes(time_s: np.ndarray, reached: np.ndarray) -> Estimate:
    """Return the mean time of those trials that reached the source [s]: failures are left out.

    It flatters methods that only succeed where it is quick, so it is never a figure to rank by. Student's interval;
    `n` is the number of successes.
    """
    time_s, reached = _trials(time_s, reached)
    found_s = time_s[reached]
    return Estimate(*_student(found_s), found_s.size) if found_s.size else UNDEFINED


# Mean with Student's interval; no interval for one value.
def _student(values: np.ndarray) -> tuple[float, float, float]:
    n, mean = values.size, float(values.mean())
    if n == 1:
        return mean, math.nan, math.nan
    half = student_quantile(0.5 + LEVEL / 2.0, n - 1) * float(values.std(ddof=1)) / math.sqrt(n)
    return mean, mean - half, mean + half


# A failure may have no time at all; a time of reaching is a number.
def _trials(time_s: np.ndarray, reached: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    time_s, reached = np.asarray(time_s, dtype=np.float64), np.asarray(reached, dtype=bool)
    check_same_length(time_s=time_s, reached=reached)
    as_finite_row(time_s[reached], "time_s of trials that reached the source")
    return time_s, reached


def performance_profile(times: np.ndarray, reference: np.ndarray, tau: np.ndarray, units: SamplingUnits) -> Curve:
    """Return the share of scenarios in which an entry is within a factor of the reference.

    rho(tau) = share of {t <= tau t_ref}

    Args:
        times: (n,) time of the entry in each scenario [s], infinite where it failed.
        reference: (n,) time of the reference in each, > 0 [s]: the oracle's, which does not change with the entrants.
        tau: (m,) factors.
        units: Rooms or plumes whose scenarios are drawn as one; the band is that of `rates_over_units`.

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
    # Both sides in one unit: a quotient of equal times is 1 to the bit.
    return Curve(tau, *rates_over_units((times / reference)[:, None] <= tau, units), times.size)


def runtime_distribution(
    times_s: np.ndarray, at_s: np.ndarray, *, clusters: np.ndarray | None = None, n_draws: int = N_DRAWS
) -> Curve:
    """Return which share of all (trial, target) pairs has been met by a time, with a band over trials.

    Args:
        times_s: (n, m) when each of n trials first met each of m targets, such as radii of 5, 2, 1 and 0.5 m around
            the source [s]; infinite (or nan) where it never did.
        at_s: (k,) when to give the fraction [s].

    Returns:
        The curve; n counts trials.

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
    counts = draw_counts(n, clusters=clusters, n_draws=n_draws)
    draws = np.concatenate([count @ met / count.sum(axis=1, keepdims=True) for count in counts])
    freedom = degrees_of_freedom(n, clusters=clusters)
    low, high = np.array([percentile_interval(at_once, freedom) for at_once in draws.T]).reshape(-1, 2).T
    return Curve(at_s, met.mean(axis=0), low, high, n)
