"""Curves of the report."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from gslcosim_bench.report.leaderboard import paired_rows, sampling_units
from gslcosim_bench.report.report_data import Flags, Floats, Ints, ReportData, TrialRows, read_samples
from gslcosim_bench.statistics.estimates import UNDEFINED, Estimate, bootstrap_mean
from gslcosim_bench.statistics.rates import rate_over_units, rates_over_units
from gslcosim_bench.statistics.roc import Roc, localisation_roc, roc
from gslcosim_bench.statistics.times import (
    Curve,
    cumulative_success,
    expected_running_time,
    mean_of_successes,
    median_time,
    performance_profile,
    restricted_mean,
    runtime_distribution,
)

RADII_M = {"5": 5.0, "2": 2.0, "1": 1.0, "05": 0.5}
_TIMES, _FACTORS, _BINS, _BELIEF_TIMES = 61, 41, 30, 21
_LARGEST_FACTOR = 50.0
LARGEST_ERROR_M, _ERRORS = 5.0, 101
"""Errors of declarations that are drawn, up to [m], and at how many distances."""
_FEWER_DRAWS = 500
BELIEF_FIGURES = ("distance_m", "error_m", "mass_near", "entropy_bits", "minus_log_p")


@dataclass(frozen=True, kw_only=True, eq=False)
class ChartLine:
    """The line of an entry, (m,) each, with the ends of its band where it has one; `n` trials; `area` is that below it.

    One with a `label` is a line of several entries, of which the first gives it its colour.
    """

    entry: int
    x: Floats
    value: Floats
    low: Floats | None = None
    high: Floats | None = None
    n: int
    label: str = ""
    area: Estimate | None = None

    @classmethod
    def of_estimates(cls, entry: int, x: Floats, estimates: Sequence[Estimate], n: int, label: str = "") -> Self:
        """Return the line through some estimates."""
        value, low, high = (np.array([getattr(each, end) for each in estimates]) for end in ("value", "low", "high"))
        return cls(entry=entry, x=x, value=value, low=low, high=high, n=n, label=label)


@dataclass(frozen=True, kw_only=True)
class TimeSummary:
    """Distribution of an entry's times to the source.

    Attributes:
        restricted_s: Mean in which failures count the limit [s].
        median_s: Infinite where fewer than half succeed [s].
        expected_s: With a new start after each failure; infinite without success [s].
        found_s: Mean of the successes alone [s]: it flatters.
        bins: Successes in equal parts of the time from 0 to the limit.
        n_missed: Runs without success.
    """

    entry: int
    restricted_s: Estimate
    median_s: Estimate
    expected_s: Estimate
    found_s: Estimate
    bins: Ints
    n_missed: int
    n: int


@dataclass(frozen=True, kw_only=True)
class DeclarationCounts:
    """Declarations of an entry by outcome: counts of runs, rates, and areas below its curves.

    Attributes:
        right: Runs with gas whose first declaration was within the success radius.
        elsewhere: Runs with gas whose first declaration was not.
        silent: Runs with gas without one.
        alarms: Runs without gas with one.
        quiet: Runs without gas without one.
    """

    entry: int
    right: int
    elsewhere: int
    silent: int
    alarms: int
    quiet: int
    right_frac: Estimate
    elsewhere_frac: Estimate
    silent_frac: Estimate
    alarm_frac: Estimate
    curve: Roc | None
    place_curve: Roc | None


def rows_by_entry(material: ReportData, within: Flags, *, is_control: bool = False) -> list[tuple[int, Ints]]:
    """Return the rows of each entry that has some, with gas or without."""
    rows = material.rows
    chosen = within & (rows.is_control == is_control)
    found = ((i, np.flatnonzero(chosen & (rows.entry == i))) for i in range(len(material.entries)))
    return [(i, some) for i, some in found if some.size]


def limit_s(rows: TrialRows) -> float:
    """Return the longest time limit [s]."""
    return float(np.max(rows["time_limit_s"], initial=1.0))


def success_curves(material: ReportData, within: Flags) -> tuple[ChartLine, ...]:
    """Return for each entry which share had found the source over time."""
    rows, at_s = material.rows, np.linspace(0.0, limit_s(material.rows), _TIMES)
    lines: list[ChartLine] = []
    for entry, some in rows_by_entry(material, within):
        units = sampling_units(rows, some)
        lines.append(_line(entry, cumulative_success(rows.time_s[some], rows["success"][some], at_s, units)))
    return tuple(lines)


def summarise_times(material: ReportData, within: Flags) -> tuple[TimeSummary, ...]:
    """Return the distribution of times of each entry."""
    rows, edges_s = material.rows, np.linspace(0.0, limit_s(material.rows), _BINS + 1)
    return tuple(_times(rows, entry, some, edges_s) for entry, some in rows_by_entry(material, within))


def _times(rows: TrialRows, entry: int, some: Ints, edges_s: Floats) -> TimeSummary:
    time_s, success, clusters = rows.time_s[some], rows["success"][some], sampling_units(rows, some).clusters
    cells = rows.cells[some]
    end_s = np.nan_to_num(rows["end_s"][some], nan=0.0)
    run_s = np.where(success, time_s, np.where(end_s > 0.0, end_s, rows["time_limit_s"][some]))
    return TimeSummary(
        entry=entry,
        restricted_s=restricted_mean(time_s, success, rows["time_limit_s"][some], clusters=clusters, cells=cells),
        median_s=median_time(time_s, success, clusters=clusters, n_draws=1000),
        expected_s=expected_running_time(run_s, success, clusters=clusters, n_draws=1000),
        found_s=mean_of_successes(time_s, success),
        bins=np.histogram(time_s[success], edges_s)[0],
        n_missed=int((~success).sum()),
        n=len(some),
    )


def profile_curves(material: ReportData, within: Flags) -> tuple[ChartLine, ...]:
    """Return for each entry in which share of pairs it was within a factor of the oracle's time; none without one."""
    rows, oracle = material.rows, material.index_of_anchor("lower")
    if oracle is None:
        return ()
    factors = np.geomspace(1.0, _LARGEST_FACTOR, _FACTORS)
    lines: list[ChartLine] = []
    for entry, _ in rows_by_entry(material, within):
        own, best = paired_rows(rows, within, entry, oracle)
        found = rows["success"][best] & (rows.time_s[best] > 0.0)
        own, best = own[found], best[found]
        if not own.size:
            continue
        times_s = np.where(rows["success"][own], rows.time_s[own], math.inf)
        profile = performance_profile(times_s, rows.time_s[best], factors, sampling_units(rows, own))
        lines.append(_line(entry, profile))
    return tuple(lines)


def runtime_curves(material: ReportData, within: Flags) -> Mapping[str, tuple[ChartLine, ...]]:
    """Return which share had come within radii over time: of all radii together (`all`), and of each."""
    rows, at_s = material.rows, np.linspace(0.0, limit_s(material.rows), _TIMES)
    names = [f"time_within_{radius}_m_s" for radius in RADII_M]
    lines: dict[str, list[ChartLine]] = {key: [] for key in ("all", *RADII_M)}
    for entry, some in rows_by_entry(material, within):
        met_s = np.stack([rows[name][some] for name in names], axis=1)
        clusters = sampling_units(rows, some).clusters
        pooled = runtime_distribution(met_s, at_s, clusters=clusters, n_draws=_FEWER_DRAWS)
        lines["all"].append(_line(entry, pooled))
        for column, radius in enumerate(RADII_M):
            reached = np.isfinite(met_s[:, column])
            time_s = np.where(reached, met_s[:, column], rows["time_limit_s"][some])
            lines[radius].append(_line(entry, cumulative_success(time_s, reached, at_s, sampling_units(rows, some))))
    return {key: tuple(found) for key, found in lines.items()}


def error_curves(material: ReportData, within: Flags) -> tuple[ChartLine, ...]:
    """Return for each entry which share had declared within a distance of the source; none where none declares.

    Of each run with gas the first declaration counts; a run without one is within no distance.
    """
    rows, at_m = material.rows, np.linspace(0.0, LARGEST_ERROR_M, _ERRORS)
    lines: list[ChartLine] = []
    for entry, some in rows_by_entry(material, within):
        if rows["declared"][some].any():
            error_m = np.where(rows["declared"][some], rows["declared_error_m"][some], math.inf)
            # The share of some runs for which something holds, at each x.
            value, low, high = rates_over_units(error_m[:, None] <= at_m, sampling_units(rows, some))
            lines.append(ChartLine(entry=entry, x=at_m, value=value, low=low, high=high, n=len(some)))
    return tuple(lines)


def _line(entry: int, curve: Curve) -> ChartLine:
    return ChartLine(entry=entry, x=curve.at, value=curve.value, low=curve.low, high=curve.high, n=curve.n)


def summarise_declarations(material: ReportData, within: Flags) -> tuple[DeclarationCounts, ...]:
    """Return the counts of declarations of all entries that made any."""
    with_gas, without = dict(rows_by_entry(material, within)), dict(rows_by_entry(material, within, is_control=True))
    declaring = material.rows["declared"] & within
    return tuple(
        _declared(material.rows, entry, some, without.get(entry, np.zeros(0, dtype=np.int64)))
        for entry, some in with_gas.items()
        if bool(np.any(declaring & (material.rows.entry == entry)))
    )


def _declared(rows: TrialRows, entry: int, some: Ints, controls: Ints) -> DeclarationCounts:
    declared, near = rows["declared"][some], rows["declared_error_m"][some] <= rows["within_m"][some]
    right, n = int((declared & near).sum()), len(some)
    elsewhere, alarms = int((declared & ~near).sum()), int(rows["declared"][controls].sum())
    both, units = np.concatenate([some, controls]), sampling_units(rows, some)
    score = np.nan_to_num(rows["declared_confidence"][both], nan=0.0)
    positive = ~rows.is_control[both]
    at_place = np.concatenate([declared & near, np.zeros(len(controls), dtype=bool)])
    return DeclarationCounts(
        entry=entry, right=right, elsewhere=elsewhere, silent=n - right - elsewhere, alarms=alarms,
        quiet=len(controls) - alarms, right_frac=rate_over_units(declared & near, units),
        elsewhere_frac=rate_over_units(declared & ~near, units), silent_frac=rate_over_units(~declared, units),
        alarm_frac=rate_over_units(rows["declared"][controls], sampling_units(rows, controls)),
        curve=roc(score, positive) if len(controls) else None,
        place_curve=localisation_roc(score, positive, at_place) if len(controls) else None,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class FinalBelief:
    """Means over an entry's runs with gas of the figures of its last belief; fields as the columns `belief_…`."""

    entry: int
    distance_m: Estimate
    error_m: Estimate
    mass_near: Estimate
    entropy_bits: Estimate
    minus_log_p: Estimate
    n: int


@dataclass(frozen=True, kw_only=True)
class BeliefTracks:
    """Figures of beliefs over time: of each trial at common times; the last one is held after the end of a run.

    Attributes:
        at_s: (m,) times [s].
        mass_near: Of each row index with a belief, (m,).
        distance_m: As above [m].
    """

    at_s: Floats
    mass_near: Mapping[int, Floats]
    distance_m: Mapping[int, Floats]


def belief_tracks(material: ReportData) -> BeliefTracks | None:
    """Return the figures of all beliefs over time; None without any."""
    at_s = np.linspace(0.0, limit_s(material.rows), _BELIEF_TIMES)
    mass_near, distance_m = dict[int, Floats](), dict[int, Floats]()
    for row, (samples, *_) in read_samples(material, ("t_s", "belief_mass_near", "belief_distance_m")).items():
        t_s, mass, distance = samples
        if np.isfinite(mass).any():
            mass_near[row], distance_m[row] = _held(at_s, t_s, mass), _held(at_s, t_s, distance)
    return BeliefTracks(at_s=at_s, mass_near=mass_near, distance_m=distance_m) if mass_near else None


# The last known value at each time; nan before the first.
def _held(at_s: Floats, t_s: Floats, values: Floats) -> Floats:
    known = np.isfinite(values) & np.isfinite(t_s)
    t_s, values = t_s[known], values[known]
    place = np.searchsorted(t_s, at_s, side="right") - 1
    return np.where(place >= 0, values[np.maximum(place, 0)], np.nan)


def summarise_final_beliefs(material: ReportData, within: Flags) -> tuple[FinalBelief, ...]:
    """Return the quality of the last beliefs of all entries that have one."""
    rows, found = material.rows, list[FinalBelief]()
    for entry, some in rows_by_entry(material, within):
        some = some[np.isfinite(rows["belief_distance_m"][some])]
        if some.size:
            found.append(FinalBelief(entry=entry, n=some.size, **{key: _mean_of(rows, f"belief_{key}", some)
                                                               for key in BELIEF_FIGURES}))  # fmt: skip
    return tuple(found)


def _mean_of(rows: TrialRows, column: str, some: Ints) -> Estimate:
    some = some[np.isfinite(rows[column][some])]
    units = sampling_units(rows, some)
    return bootstrap_mean(rows[column][some], units.stratum, clusters=units.clusters)


def belief_curves(material: ReportData, within: Flags, tracks: BeliefTracks) -> Mapping[str, tuple[ChartLine, ...]]:
    """Return the means of `mass` (within the radius) and `distance` [m] over time; nan where half have none yet."""
    return {
        "mass": _belief_lines(material, within, tracks.at_s, tracks.mass_near),
        "distance": _belief_lines(material, within, tracks.at_s, tracks.distance_m),
    }


def _belief_lines(
    material: ReportData, within: Flags, at_s: Floats, series: Mapping[int, Floats]
) -> tuple[ChartLine, ...]:
    lines: list[ChartLine] = []
    for entry, some in rows_by_entry(material, within):
        having = np.array([i for i in some.tolist() if i in series], dtype=np.int64)
        if having.size:
            values = np.stack([series[i] for i in having.tolist()])
            points = [_mean_at(values[:, k], material.rows, having) for k in range(at_s.size)]
            lines.append(ChartLine.of_estimates(entry, at_s, points, having.size))
    return tuple(lines)


def _mean_at(values: Floats, rows: TrialRows, some: Ints) -> Estimate:
    known = np.isfinite(values)
    if known.sum() * 2 < values.size:
        return UNDEFINED
    units = sampling_units(rows, some[known])
    return bootstrap_mean(values[known], units.stratum, clusters=units.clusters, n_draws=_FEWER_DRAWS)
