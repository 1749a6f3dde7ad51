"""Times to the source, censored at the limit, and performance profiles of them.

A trial has a time [s] and whether the source was reached then. A trial that did not reach it is *censored*: all that
is known is that it would have taken longer. Failures that ended early (a collision) would not have gone on to find the
source; every function here but `kaplan_meier`, which takes any censoring, counts them to the limit.
"""

import math
from dataclasses import dataclass

import numpy as np

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.aggregates import bootstrap_cells
from gslcosim_bench.statistics.estimates import (
    LEVEL,
    N_DRAWS,
    SEED,
    UNDEFINED,
    Estimate,
    Seed,
    as_finite_row,
    bootstrap,
    check_same_length,
    degrees_of_freedom,
    draw_counts,
    encode_labels,
    percentile_interval,
    student_quantile,
    two_sided_z,
)
from gslcosim_bench.statistics.rates import clopper_pearson, rates_over_units, wilson
from gslcosim_bench.statistics.sampling_units import SamplingUnits


@dataclass(frozen=True)
class Curve:
    """A share of trials over time, with its pointwise band.

    Attributes:
        at_s: (m,) times [s].
        value: (m,) shares, 0 to 1.
        low: (m,) lower ends of the intervals.
        high: (m,) upper ends.
        n: Trials.
    """

    at_s: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    n: int


def kaplan_meier(time_s: np.ndarray, reached: np.ndarray, at_s: np.ndarray, level: float = LEVEL) -> Curve:
    """Return the share of trials that still search, over time, with a band.

    S(t) = prod_{t_i <= t} (1 - d_i / Y_i)                   d_i trials that reach at t_i, Y_i that search until then
    V(t) = sum_{t_i <= t} d_i / (Y_i (Y_i - d_i))            Greenwood; var S = S^2 V
    band = S^exp(± z sqrt(V) / ln S)                         log(-log) form, always within 0 and 1

    Args:
        time_s: (n,) time of reaching or of censoring [s].
        reached: (n,) whether the source was reached then.
        at_s: (m,) when to give the fraction [s], in any order.

    Returns:
        The curve; nan without trials.

    Source:
        Kaplan and Meier 1958, doi:10.1080/01621459.1958.10501452; band: Kalbfleisch and Prentice 1980.
    Deviation:
        Where none or all have reached, the log(-log) form is undefined: Wilson's interval of so many trials.
    Held by:
        extensions/bench/tests/unit/statistics/test_times.py (lifelines; leukaemia trial of Freireich et al. 1963)
    """
    time_s, reached = _trials(time_s, reached)
    at_s = np.asarray(at_s, dtype=np.float64)
    if time_s.size == 0:
        unknown = np.full(at_s.shape, math.nan)
        return Curve(at_s, unknown, unknown, unknown, 0)
    event_s, deaths, at_risk = _events(time_s, reached)
    before = np.searchsorted(event_s, at_s, side="right")
    share = np.concatenate([[1.0], np.cumprod(1.0 - deaths / at_risk)])[before]
    with np.errstate(divide="ignore", invalid="ignore"):
        greenwood = np.concatenate([[0.0], np.cumsum(deaths / (at_risk * (at_risk - deaths)))])[before]
        width = two_sided_z(level) * np.sqrt(greenwood) / np.log(share)
        low, high = share ** np.exp(-width), share ** np.exp(width)
    none, every = wilson(0, time_s.size, level), wilson(time_s.size, time_s.size, level)
    low = np.where(share >= 1.0, every.low, np.where(share <= 0.0, none.low, low))
    high = np.where(share >= 1.0, every.high, np.where(share <= 0.0, none.high, high))
    return Curve(at_s, share, low, high, time_s.size)


def cumulative_success(
    time_s: np.ndarray,
    reached: np.ndarray,
    at_s: np.ndarray,
    level: float = LEVEL,
    *,
    units: SamplingUnits | None = None,
) -> Curve:
    """Return the share of trials that have reached the source, over time, with a band.

    One minus `kaplan_meier` of trials whose failures search for ever. Up to the limit this is the share of all trials
    that had reached the source by then.

    Args:
        time_s: (n,) time of reaching [s]; that of a failure does not count.
        reached: (n,) whether the source was reached.
        at_s: (m,) when to give the fraction, up to the limit [s].
        units: Rooms or plumes whose trials are drawn as one; the band is then that of `rates_over_units`.

    Source:
        Aalen and Johansen 1978: an early end is a competing event, not a censoring.
    """
    time_s, reached = _trials(time_s, reached)
    for_ever = np.where(reached, time_s, math.inf)
    if units is not None:
        at_s = np.asarray(at_s, dtype=np.float64)
        return Curve(at_s, *rates_over_units(for_ever[:, None] <= at_s, units, level), time_s.size)
    searching = kaplan_meier(for_ever, reached, at_s, level)
    return Curve(searching.at_s, 1.0 - searching.value, 1.0 - searching.high, 1.0 - searching.low, searching.n)


def counted_times(time_s: np.ndarray, reached: np.ndarray, limit_s: float | np.ndarray) -> np.ndarray:
    """Return min(t, T) for trials that reached the source and T for all others, (n,) [s].

    Args:
        time_s: (n,) time of reaching [s]; that of a failure does not count.
        reached: (n,) whether the source was reached.
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
    level: float = LEVEL,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Estimate:
    """Return the mean time to the source in which failures count the limit [s]: the area below the searching curve.

    RMST = mean(min(t_i, T)), t_i infinite for failures; interval ± t_{n-1} s / sqrt(n)

    With censoring at the limit alone Greenwood's variance of the area is s^2 (n - 1) / n^2, so this is its interval
    with Student's quantile in place of the normal one.

    Args:
        time_s: (n,) time of reaching [s]; that of a failure does not count.
        reached: (n,) whether the source was reached.
        limit_s: Time limit T of all trials, or (n,) of each [s].
        clusters: (n,) labels of trials that share their gas; with them the interval is a bootstrap over clusters.
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
    return _mean(counted_s, np.asarray(reached, dtype=bool), limit_s, clusters, cells, level, seed, n_draws)


def median_time(
    time_s: np.ndarray,
    reached: np.ndarray,
    *,
    clusters: np.ndarray | None = None,
    level: float = LEVEL,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Estimate:
    """Return the time by which half of the trials have reached the source [s]; infinite if fewer than half do.

    It is the first time at which the searching share is 1/2 or less.

    Args:
        time_s: (n,) time of reaching [s]; that of a failure does not count.
        reached: (n,) whether the source was reached.
        clusters: (n,) labels of trials that are drawn together.

    Source:
        Efron 1981, doi:10.1080/01621459.1981.10477650, bootstrap of the Kaplan-Meier median.
    """
    time_s, reached = _trials(time_s, reached)
    known_s = np.where(reached, time_s, math.inf)

    def lower_median(rows: np.ndarray) -> np.ndarray:
        middle = (rows.shape[1] + 1) // 2 - 1
        return np.partition(known_s[rows], middle, axis=1)[:, middle]

    return bootstrap(known_s.size, lower_median, clusters=clusters, level=level, seed=seed, n_draws=n_draws)


def expected_running_time(
    time_s: np.ndarray,
    reached: np.ndarray,
    *,
    clusters: np.ndarray | None = None,
    level: float = LEVEL,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Estimate:
    """Return the time to the source if one starts again after each failure [s]; infinite without success.

    ERT = sum of all run times, failed ones included / number of successes

    Args:
        time_s: (n,) run time: of reaching, or of the end of a failure [s].
        reached: (n,) whether the source was reached.
        clusters: (n,) labels of trials that are drawn together.

    Source:
        Hansen et al. 2021, COCO, doi:10.1080/10556788.2020.1808977.
    """
    time_s, reached = _trials(as_finite_row(time_s, "time_s"), reached)

    def ratio(rows: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore"):
            return time_s[rows].sum(axis=1) / reached[rows].sum(axis=1)

    return bootstrap(time_s.size, ratio, clusters=clusters, level=level, seed=seed, n_draws=n_draws)


def mean_of_successes(time_s: np.ndarray, reached: np.ndarray, level: float = LEVEL) -> Estimate:
    """Return the mean time of those trials that reached the source [s]: failures are left out.

    It flatters methods that only succeed where it is quick, so it is never a figure to rank by. Student's interval;
    `n` is the number of successes.

    Args:
        time_s: (n,) time of reaching [s].
        reached: (n,) whether the source was reached.
    """
    time_s, reached = _trials(time_s, reached)
    found_s = time_s[reached]
    return Estimate(*_student(found_s, level), found_s.size) if found_s.size else UNDEFINED


# Mean of counted times; the limit is what a failure counts.
def _mean(
    counted_s: np.ndarray,
    reached: np.ndarray,
    limit_s: float | np.ndarray,
    clusters: np.ndarray | None,
    cells: np.ndarray | None,
    level: float,
    seed: Seed,
    n_draws: int,
) -> Estimate:
    n = counted_s.size
    if n == 0:
        return UNDEFINED
    mean_limit_s = float(np.mean(limit_s))
    if not reached.any():
        return Estimate(
            float(counted_s.mean()), mean_limit_s * (1.0 - clopper_pearson(0, n, level).high), mean_limit_s, n
        )
    if cells is not None and (clusters is not None or np.ptp(np.bincount(encode_labels(cells))) > 0):
        return bootstrap_cells(counted_s, cells, clusters=clusters, level=level, rng=seed, n_draws=n_draws)
    if clusters is not None:
        return bootstrap(
            n, lambda rows: counted_s[rows].mean(axis=1), clusters=clusters, level=level, seed=seed, n_draws=n_draws
        )
    value_s, low_s, high_s = _student(counted_s, level)
    return Estimate(value_s, max(low_s, 0.0), min(high_s, mean_limit_s) if n > 1 else high_s, n)


# Mean with Student's interval; no interval for one value.
def _student(values: np.ndarray, level: float) -> tuple[float, float, float]:
    n, mean = values.size, float(values.mean())
    if n == 1:
        return mean, math.nan, math.nan
    half = student_quantile(0.5 + level / 2.0, n - 1) * float(values.std(ddof=1)) / math.sqrt(n)
    return mean, mean - half, mean + half


# Times at which trials reach, how many do, and how many still searched until then.
def _events(time_s: np.ndarray, reached: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    event_s, deaths = np.unique(time_s[reached], return_counts=True)
    at_risk = time_s.size - np.searchsorted(np.sort(time_s), event_s)
    return event_s, deaths, at_risk


# A failure may have no time at all; a time of reaching is a number.
def _trials(time_s: np.ndarray, reached: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    time_s, reached = np.asarray(time_s, dtype=np.float64), np.asarray(reached, dtype=bool)
    check_same_length(time_s=time_s, reached=reached)
    as_finite_row(time_s[reached], "time_s of trials that reached the source")
    return time_s, reached


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
    times: np.ndarray,
    reference: np.ndarray,
    tau: np.ndarray | None = None,
    level: float = LEVEL,
    *,
    units: SamplingUnits | None = None,
) -> Profile:
    """Return in which share of scenarios an entry is within a factor of the reference.

    rho(tau) = share of {t <= tau t_ref}

    Args:
        times: (n,) time of the entry in each scenario [s], infinite where it failed.
        reference: (n,) time of the reference in each, > 0 [s]: the oracle's, which does not change with the entrants.
        tau: (m,) factors; None: 1, 2, 5, 10.
        units: Rooms or plumes whose scenarios are drawn as one; the band is then that of `rates_over_units`.

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
    if units is not None:
        return Profile(factors, *rates_over_units((times / reference)[:, None] <= factors, units, level), times.size)
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
    draws = np.concatenate(
        [
            counts @ met / counts.sum(axis=1, keepdims=True)
            for counts in draw_counts(n, clusters=clusters, seed=seed, n_draws=n_draws)
        ]
    )
    freedom = degrees_of_freedom(n, clusters=clusters)
    low, high = np.array([percentile_interval(at_once, level, freedom) for at_once in draws.T]).reshape(-1, 2).T
    return Curve(at_s, met.mean(axis=0), low, high, n)
