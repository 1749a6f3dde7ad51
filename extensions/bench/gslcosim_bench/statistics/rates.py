"""Success rates with intervals, differences of rates, and lift over luck."""

import math
from collections.abc import Iterable

import numpy as np

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.estimates import (
    LEVEL,
    UNDEFINED,
    Estimate,
    check_same_length,
    student_quantile,
    two_sided_z,
)
from gslcosim_bench.statistics.sampling_units import SamplingUnits, compute_means


def wilson(successes: int, n: int, level: float = LEVEL) -> Estimate:
    """Return a rate with Wilson's interval.

    (p + z^2/2n ± z sqrt(p (1 - p) / n + z^2/4n^2)) / (1 + z^2/n)        p = successes / n, z normal quantile

    Args:
        successes: 0 to n.
        n: Trials; undefined for 0.

    Source:
        Wilson 1927, doi:10.1080/01621459.1927.10502953, without continuity correction.
    """
    if not 0 <= successes <= n:
        raise ShapeError(f"successes: expected 0 to n = {n}, was {successes}. Give counts of the same trials.")
    if n == 0:
        return UNDEFINED
    p, z = successes / n, two_sided_z(level)
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    low = 0.0 if successes == 0 else centre - half
    high = 1.0 if successes == n else centre + half
    return Estimate(p, low, high, n)


def rates_over_units(
    outcomes: np.ndarray, units: SamplingUnits, *, effect: float = math.nan
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rates over cases with Wilson's intervals for as many flights as whole units are worth.

    n_e = min(n', p (1 - p) / v) (z / t)^2        v variance over units, z normal and t Student's quantile
    n' = 1 / sum w^2        w = 1 / (cases x flights of the case), so n where cases have equally many flights

    Where each flight is a unit this is Wilson's interval itself. A rate of 0 or 1 shows no spread, which says nothing
    of how alike the flights of a unit are: p (1 - p) / v is then n' / `effect`, and at least the number of units.

    Args:
        outcomes: (n, m) a row per flight.
        effect: Design effect where a rate is 0 or 1; nan: that of the other columns, or, without any, as if each unit
            was one flight.

    Returns:
        Rates, lower and upper ends, (m,) each; nan without flights, ends nan where units show no spread.

    Source:
        Korn and Graubard 1998, Survey Methodology 24, 193-201 (their effective size, with Wilson's interval: Franco et
        al. 2019, doi:10.1093/jssam/smy019).
    Held by:
        extensions/bench/tests/unit/statistics/test_sampling_units.py (coverage)
    """
    outcomes = np.asarray(outcomes, dtype=np.float64)
    n, m = outcomes.shape
    if n == 0:
        unknown = np.full(m, math.nan)
        return unknown, unknown, unknown
    p, variance, alone = _rates_and_variances(outcomes, units)
    z, most = two_sided_z(LEVEL), _independent_size(units)
    size = np.full(m, most)
    if units.level != "flights":
        if units.freedom < 1:
            unknown = np.full(m, math.nan)
            return p, unknown, unknown
        spread = variance > 0.0
        if math.isnan(effect):
            effect = float(variance[spread].sum() / alone[spread].sum()) if spread.any() else math.inf
        size[spread] = np.minimum(most * alone[spread] / variance[spread], most)
        size[~spread] = min(max(most / effect, units.n), most)
        size = size * (z / student_quantile(0.5 + LEVEL / 2.0, units.freedom)) ** 2
    # With a variance of all there can be, p (1 - p), a rate stands on one flight at least.
    size = np.maximum(size, 1.0)
    centre = (p + z * z / (2 * size)) / (1 + z * z / size)
    half = z * np.sqrt(p * (1 - p) / size + z * z / (4 * size * size)) / (1 + z * z / size)
    return p, np.where(p <= 0.0, 0.0, centre - half), np.where(p >= 1.0, 1.0, centre + half)


def rate_over_units(outcomes: np.ndarray, units: SamplingUnits, *, effect: float = math.nan) -> Estimate:
    """Return one rate of `rates_over_units`; `outcomes` are (n,)."""
    outcomes = np.asarray(outcomes, dtype=bool)
    if not outcomes.size:
        return UNDEFINED
    value, low, high = (float(part[0]) for part in rates_over_units(outcomes[:, None], units, effect=effect))
    return Estimate(value, low, high, outcomes.size)


def pool_design_effect(samples: Iterable[tuple[np.ndarray, SamplingUnits]]) -> float:
    """Return the design effect of several rates: variance over units by that of independent flights, nan if unknown.

    sum v / sum (p (1 - p) / n')        over the rates other than 0 and 1, as in `rates_over_units`

    Args:
        samples: (n,) outcomes with their units, of each entry.
    """
    found = [_rates_and_variances(np.asarray(each, dtype=np.float64)[:, None], units) for each, units in samples]
    seen, alone = (float(sum(each[i].sum() for each in found)) for i in (1, 2))
    return seen / alone if seen > 0.0 and alone > 0.0 else math.nan


# Rates, their variances over units and those of independent flights, (m,) each.
def _rates_and_variances(outcomes: np.ndarray, units: SamplingUnits) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if not len(outcomes):
        nothing = np.zeros(outcomes.shape[1])
        return nothing, nothing, nothing
    means = compute_means(outcomes, units, units.case)
    is_sure = np.ptp(outcomes, axis=0) == 0.0
    p = np.where(is_sure, outcomes[0], means.value)
    variance = np.where(is_sure, 0.0, (means.residual**2).sum(axis=0))
    return p, variance, p * (1.0 - p) / _independent_size(units)


def _independent_size(units: SamplingUnits) -> float:
    of_case = np.bincount(units.case)
    weight = 1.0 / (of_case[units.case] * len(of_case))
    return float(1.0 / (weight**2).sum())


def lift(success: np.ndarray, luck: np.ndarray, *, paired: bool) -> Estimate:
    """Return the rate of success with a source less that of luck in the no-source controls.

    Args:
        success: (n,) whether each trial with a source came near it.
        luck: (m,) whether each control, without gas, came near the place where the source would be.
        paired: Whether trial i and control i are the same case with the same seeds; then n = m.

    Returns:
        The lift, -1 to 1; n counts pairs, or trials and controls together.

    Source:
        Chosen; blind walks come near 14 to 22 % of the sources of GSL-Bench, so a rate alone says little.
    Held by:
        extensions/bench/tests/unit/statistics/test_lift.py (statsmodels; published examples), test_simulated_entries.py
    """
    success, luck = np.asarray(success, dtype=bool), np.asarray(luck, dtype=bool)
    if paired:
        check_same_length(success=success, luck=luck)
        return paired_difference_of_rates(success, luck)
    return difference_of_rates(int(success.sum()), success.size, int(luck.sum()), luck.size)


def lift_over_units(outcomes: np.ndarray, is_luck: np.ndarray, units: SamplingUnits) -> Estimate:
    """Return the lift over cases, with Student's interval over whole units, each with its trials and its controls.

    Args:
        outcomes: (n,) whether each trial or control came near the source, or the place where it would be.
        is_luck: (n,) which of them are controls.

    Returns:
        The lift; n counts trials and controls together; no interval where units show no spread.
    """
    both = np.stack([np.where(is_luck, np.nan, outcomes), np.where(is_luck, outcomes, np.nan)], axis=1)
    means = compute_means(both, units, units.case)
    value = float(means.value[0] - means.value[1])
    if units.freedom < 1 or math.isnan(value):
        return Estimate(value, math.nan, math.nan, len(both)) if not math.isnan(value) else UNDEFINED
    spread = math.sqrt(float(((means.residual[:, 0] - means.residual[:, 1]) ** 2).sum()))
    half = student_quantile(0.5 + LEVEL / 2.0, units.freedom) * max(spread, 1.0 / len(both))
    return Estimate(value, max(value - half, -1.0), min(value + half, 1.0), len(both))


def difference_of_rates(successes_a: int, n_a: int, successes_b: int, n_b: int, level: float = LEVEL) -> Estimate:
    """Return the difference of two independent rates, p_a - p_b, with Newcombe's interval.

    d - sqrt((p_a - l_a)^2 + (u_b - p_b)^2)   to   d + sqrt((u_a - p_a)^2 + (p_b - l_b)^2)       l, u Wilson's ends

    Source:
        Newcombe 1998, doi:10.1002/(SICI)1097-0258(19980430)17:8<873::AID-SIM779>3.0.CO;2-I, method 10.
    """
    return subtract_rates(wilson(successes_a, n_a, level), wilson(successes_b, n_b, level))


def subtract_rates(a: Estimate, b: Estimate) -> Estimate:
    """Return the difference of two independent rates, a - b, from their intervals, as `difference_of_rates`.

    With intervals of `rate_over_units` it holds for whole rooms or plumes. Rooms that both share make it too wide.
    """
    return _squared_and_added(a, b, 0.0, a.n + b.n) if a.n and b.n else UNDEFINED


def paired_difference_of_rates(a: np.ndarray, b: np.ndarray) -> Estimate:
    """Return the difference of two rates over the same cases, p_a - p_b, with Newcombe's paired interval.

    As `difference_of_rates` with - 2 phi (p_a - l_a) (u_b - p_b) below the root, phi the correlation of the outcomes.

    Args:
        a: (n,) outcomes of one.
        b: (n,) outcomes of the other in the same cases.

    Source:
        Newcombe 1998, doi:10.1002/(SICI)1097-0258(19981130)17:22<2635::AID-SIM954>3.0.CO;2-C, method 10 (phi with
        continuity correction).
    """
    a, b = np.asarray(a, dtype=bool), np.asarray(b, dtype=bool)
    check_same_length(a=a, b=b)
    if a.size == 0:
        return UNDEFINED
    rate_a, rate_b = (wilson(int(outcomes.sum()), a.size) for outcomes in (a, b))
    return _squared_and_added(rate_a, rate_b, _correlation(a, b), a.size)


def _squared_and_added(a: Estimate, b: Estimate, phi: float, n: int) -> Estimate:
    difference = a.value - b.value
    a_below, a_above, b_below, b_above = a.value - a.low, a.high - a.value, b.value - b.low, b.high - b.value
    below = math.sqrt(max(a_below**2 - 2 * phi * a_below * b_above + b_above**2, 0.0))
    above = math.sqrt(max(a_above**2 - 2 * phi * a_above * b_below + b_below**2, 0.0))
    return Estimate(difference, difference - below, difference + above, n)


# Newcombe's phi: a positive one is drawn towards zero by half a pair; 0 where a rate is 0 or 1.
def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    both, only_a, only_b, none = (int(np.sum(cell)) for cell in (a & b, a & ~b, b & ~a, ~(a | b)))
    margins = (both + only_a) * (only_b + none) * (both + only_b) * (only_a + none)
    if margins == 0:
        return 0.0
    excess = both * none - only_a * only_b
    if excess > 0:
        excess = max(excess - a.size / 2.0, 0.0)
    return excess / math.sqrt(margins)
