"""Comparison of all entries in one family: differences with simultaneous intervals, who beats whom, and ranks."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.estimates import (
    LEVEL,
    SEED,
    Estimate,
    student_quantile,
)
from gslcosim_bench.statistics.sampling_units import LinearisedMeans, SamplingUnits, compute_means

Floats = NDArray[np.float64]

N_SIGNS = 4000
"""Drawn patterns of signs: the level of a family has a standard error of 0.3 points."""

# Up to here all patterns of signs are gone through instead of drawn: 2^12 rows.
_EXACT_UNITS = 12
_ENTRIES_AT_ONCE = 500_000
_ROUNDING = 1e-7


@dataclass(frozen=True, kw_only=True)
class EntryPair:
    """One entry against another over the flights of the same cases that both made.

    Attributes:
        a: Index of the one.
        b: Index of the other.
        verdict: 1 where a beats b, -1 where b beats a, 0 where they are not told apart.
        differences: Mean of a minus b of each figure with its simultaneous interval; n counts pairs of flights.
        p: Of the figure that ranks, corrected for the family; below 1 - level where there is a verdict.
        a_better: Share of pairs in which a ranks higher, ties half, with an interval of its own.
    """

    a: int
    b: int
    verdict: int
    differences: Mapping[str, Estimate]
    p: float
    a_better: Estimate


@dataclass(frozen=True, kw_only=True)
class EntryComparison:
    """All entries compared in one family, from which ranks and verdicts follow.

    Attributes:
        pairs: Each two entries with flights in common, the earlier one as a.
        ranks: Lowest and highest place that each entry may have.
        critical_value: Standard errors to each side in simultaneous intervals; nan without pairs.
        level: Of the whole family.
        units: What is drawn.
    """

    pairs: tuple[EntryPair, ...]
    ranks: tuple[tuple[int, int], ...]
    critical_value: float
    level: float
    units: SamplingUnits


def compare_entries(
    figures: Mapping[str, NDArray[Any]],
    *,
    ranked_by: str,
    lower_is_better: bool,
    units: SamplingUnits,
    cases: NDArray[np.int64] | None = None,
    level: float = LEVEL,
    limit: float = math.inf,
    seed: int = SEED,
    n_signs: int = N_SIGNS,
) -> EntryComparison:
    """Compare all entries with each other in all figures at once.

    t = difference / standard error, over whole units        interval: difference ± c standard error

    c is the least number that the largest |t| of the family exceeds in at most 1 - level of all patterns of signs,
    where each unit's differences of all pairs and figures change their sign together. Signs are given to the
    differences themselves, which bounds false verdicts, and to what is left after taking out means, which makes all
    intervals hold their true differences together; the larger c serves. It is never below Student's quantile. The
    standard error is computed anew under each pattern: a room with a quarter of the weight has a quarter of it there.

    a beats b where its interval leaves zero out. An entry that x others beat and that beats y of n has a rank between
    1 + x and n - y. So equal entries all have rank 1 in `level` of comparisons, however many they are.

    Args:
        figures: (n_flights, n_entries) each, in the same order; nan where an entry has no result.
        ranked_by: The figure that verdicts and ranks are of.
        lower_is_better: True where that is a time, False for successes and scores.
        cases: (n_flights,) case of each, 0 on; each case counts the same. None: each flight does.
        level: Confidence level of the whole family, 0 to 1.
        limit: Largest difference that is possible; intervals end there.
        n_signs: Drawn patterns; up to twelve units all patterns are gone through.

    Source:
        Single-step maxT of Westfall and Young 1993, Resampling-Based Multiple Testing; signs of residuals as in the
        wild bootstrap (Liu 1988, doi:10.1214/aos/1176351062); ranks of Mogstad et al. 2024, Review of Economic
        Studies 91.
    Held by:
        extensions/bench/tests/unit/statistics/test_ranking.py and tests/benchmarks/simulated_entries.py (error and
        coverage)
    """
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in figures.items()}
    shape = arrays[ranked_by].shape
    if any(values.ndim != 2 or values.shape != shape or np.isinf(values).any() for values in arrays.values()):
        raise ShapeError(
            "figures: expected a finite number or nan for each flight and entry, of one shape, was "
            f"{', '.join(f'{name} {values.shape}' for name, values in arrays.items())}. Count failures with the limit."
        )
    has_any = np.asarray(~np.isnan(arrays[ranked_by]).all(axis=0))
    index = [
        (a, b)
        for a, b in combinations(np.flatnonzero(has_any).tolist(), 2)
        if not np.isnan(arrays[ranked_by][:, a] + arrays[ranked_by][:, b]).all()
    ]
    if not index:
        return EntryComparison(pairs=(), ranks=_ranks({}, has_any), critical_value=math.nan, level=level, units=units)
    first, second = (np.array(side) for side in zip(*index, strict=True))
    columns = {name: values[:, first] - values[:, second] for name, values in arrays.items()}
    means = compute_means(np.concatenate(list(columns.values()), axis=1), units, cases)
    family = _Family(means, units, level, seed, n_signs)
    m, names = len(index), list(columns)
    sign = -1.0 if lower_is_better else 1.0
    ranked = columns[ranked_by]
    won = np.where(np.isnan(ranked), np.nan, 0.5 + 0.5 * np.sign(sign * ranked))
    better = estimate_means(won, units, cases, level=level, bounds=(0.0, 1.0))
    at = names.index(ranked_by) * m
    p = family.p_values(at, at + m)
    verdicts = np.where(p <= 1.0 - level + _ROUNDING, np.sign(sign * means.value[at : at + m]), 0.0).astype(int)
    pairs = tuple(
        EntryPair(
            a=a, b=b, verdict=int(verdicts[i]), p=float(p[i]), a_better=better[i],
            differences={name: family.estimate(k * m + i, limit) for k, name in enumerate(names)},
        )
        for i, (a, b) in enumerate(index)
    )  # fmt: skip
    beats = {(pair.a, pair.b): pair.verdict for pair in pairs}
    return EntryComparison(
        pairs=pairs, ranks=_ranks(beats, has_any), critical_value=family.critical_value, level=level, units=units
    )


def estimate_family(
    differences: Floats,
    units: SamplingUnits,
    cases: NDArray[np.int64] | None = None,
    *,
    level: float = LEVEL,
    limit: float = math.inf,
    seed: int = SEED,
    n_signs: int = N_SIGNS,
) -> tuple[list[Estimate], Floats]:
    """Return the mean of each column of differences with simultaneous intervals, and p values, of one family.

    As `compare_entries`, for differences to one reference: all intervals hold their true differences together in
    `level` of comparisons, and p is corrected for the number of columns.

    Args:
        differences: (n_flights, m); nan where there is none.
        cases: (n_flights,) case of each, 0 on; each case counts the same. None: each flight does.
        limit: Largest difference that is possible; intervals end there.
    """
    means = compute_means(np.asarray(differences, dtype=np.float64), units, cases)
    family = _Family(means, units, level, seed, n_signs)
    m = differences.shape[1]
    return [family.estimate(i, limit) for i in range(m)], family.p_values(0, m)


def estimate_means(
    values: Floats,
    units: SamplingUnits,
    cases: NDArray[np.int64] | None = None,
    *,
    level: float = LEVEL,
    bounds: tuple[float, float] = (-math.inf, math.inf),
) -> list[Estimate]:
    """Return the mean of each column over whole units, each with Student's interval of its own.

    Args:
        values: (n, m) a row per flight; nan where there is none.
        cases: (n,) case of each, 0 on; None: each flight counts the same.
        bounds: What the ends cannot exceed.
    """
    means = compute_means(values, units, cases)
    error = means.standard_error
    found: list[Estimate] = []
    for i, value in enumerate(means.value.tolist()):
        half = student_quantile(0.5 + level / 2.0, units.freedom) * float(error[i]) if units.freedom else math.nan
        found.append(_bounded(value, half, bounds, int(means.n[i])))
    return found


def _bounded(value: float, half: float, bounds: tuple[float, float], n: int) -> Estimate:
    low, high = (min(max(end, bounds[0]), bounds[1]) for end in (value - half, value + half))
    return Estimate(value, low, high, n) if not math.isnan(half) else Estimate(value, math.nan, math.nan, n)


# The largest |t| of the family in each pattern of signs, and what follows from it.
class _Family:
    def __init__(self, means: LinearisedMeans, units: SamplingUnits, level: float, seed: int, n_signs: int) -> None:
        self._means, self._freedom = means, units.freedom
        error = means.standard_error
        self._t = np.abs(means.value) / error
        self._error = error
        self._largest = [_largest_of_signs(part, means, units, seed, n_signs) for part in (means.total, means.residual)]
        self._is_drawn = units.n > _EXACT_UNITS
        student = student_quantile(0.5 + level / 2.0, units.freedom) if units.freedom else math.inf
        # A tie is no verdict.
        self.critical_value = (1.0 + _ROUNDING) * max(student, *(self._critical(each, level) for each in self._largest))

    def _critical(self, largest: Floats, level: float) -> float:
        allowed = math.floor((1.0 - level) * (len(largest) + self._is_drawn) + _ROUNDING) - self._is_drawn
        return float(largest[::-1][max(allowed, 0)]) if len(largest) else 0.0

    def p_values(self, start: int, stop: int) -> Floats:
        t = self._t[start:stop] * (1.0 - _ROUNDING)
        found = 2.0 * special.stdtr(self._freedom, -t) if self._freedom else np.ones(t.shape)
        for largest in self._largest:
            if len(largest):
                reached = len(largest) - np.searchsorted(largest, t)
                found = np.maximum(found, (self._is_drawn + reached) / (self._is_drawn + len(largest)))
        return found

    def estimate(self, column: int, limit: float) -> Estimate:
        half = self.critical_value * float(self._error[column])
        half = half if math.isfinite(half) else math.nan
        return _bounded(float(self._means.value[column]), half, (-limit, limit), int(self._means.n[column]))


# Sorted. Units differ in weight, so the error is computed anew under each pattern of signs s, as `compute_means` does:
# v = sum s x, e_u = sqrt(k / (k - 1)) (s x_u - v w_u / sum w) in each stratum, x_u a unit's part and w_u its share.
def _largest_of_signs(parts: Floats, means: LinearisedMeans, units: SamplingUnits, seed: int, n_signs: int) -> Floats:
    is_any = (parts != 0.0).any(axis=0)
    if not is_any.any() or units.freedom <= 0:
        return np.zeros(0)
    parts, share = parts[:, is_any], means.share[:, is_any]
    least = means.least_error[is_any] ** 2
    stratum = units.stratum_of_unit
    strata = [np.flatnonzero(stratum == h) for h in range(int(stratum.max()) + 1)]
    found: list[Floats] = []
    for signs in _signs(parts.shape[0], parts.shape[1], seed, n_signs):
        value, variance = np.zeros((len(signs), parts.shape[1])), np.zeros((len(signs), parts.shape[1]))
        for rows in strata:
            x, w, s = parts[rows], share[rows], signs[:, rows]
            weight, k = w.sum(axis=0), (w > 0.0).sum(axis=0)
            sums = s @ x
            mean = sums / np.where(weight > 0.0, weight, 1.0)
            squares = (x**2).sum(axis=0) - mean * (2.0 * (s @ (x * w)) - mean * (w**2).sum(axis=0))
            value += sums
            variance += k / np.maximum(k - 1, 1) * squares
        found.append((np.abs(value) / np.sqrt(np.maximum(variance, least))).max(axis=1))
    return np.sort(np.concatenate(found))


def _signs(n: int, m: int, seed: int, n_signs: int) -> Iterable[Floats]:
    if n <= _EXACT_UNITS:
        patterns = np.arange(2**n)[:, None] >> np.arange(n) & 1
        return (chunk for chunk in np.array_split(1.0 - 2.0 * patterns, max(1, 2**n * m // _ENTRIES_AT_ONCE)))
    rng, at_once = np.random.default_rng(seed), max(1, _ENTRIES_AT_ONCE // max(n, m))
    counts = [min(at_once, n_signs - start) for start in range(0, n_signs, at_once)]
    return (1.0 - 2.0 * rng.integers(0, 2, (count, n), dtype=np.int8).astype(np.float64) for count in counts)


# Those without results come last.
def _ranks(beats: Mapping[tuple[int, int], int], has_any: NDArray[np.bool_]) -> tuple[tuple[int, int], ...]:
    n = int(has_any.sum())
    low, high = np.where(has_any, 1, n + 1), np.where(has_any, n, len(has_any))
    for (a, b), verdict in beats.items():
        if verdict:
            better, worse = (a, b) if verdict > 0 else (b, a)
            low[worse] += 1
            high[better] -= 1
    return tuple((int(first), int(last)) for first, last in zip(low, high, strict=True))
