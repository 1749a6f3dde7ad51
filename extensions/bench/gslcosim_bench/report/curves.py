"""Curves of the report, and drawings over the plans of environments."""

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.untrusted_input import JsonObject, parse_json
from gslcosim_bench.report.leaderboard import paired_rows, sampling_units
from gslcosim_bench.report.report_data import EnvironmentMap, Flags, Floats, Ints, ReportData, TrialRows
from gslcosim_bench.statistics.estimates import UNDEFINED, Estimate, bootstrap_mean
from gslcosim_bench.statistics.rates import rate_over_units, rates_over_units, wilson
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


@dataclass(frozen=True, kw_only=True)
class CurveWithBand:
    """A line of an entry with its band: (m,) each; `n` trials."""

    entry: int
    x: Floats
    value: Floats
    low: Floats
    high: Floats
    n: int


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


def success_curves(material: ReportData, within: Flags) -> tuple[CurveWithBand, ...]:
    """Return for each entry which share had found the source over time."""
    rows, at_s = material.rows, np.linspace(0.0, limit_s(material.rows), _TIMES)
    lines: list[CurveWithBand] = []
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


def profile_curves(material: ReportData, within: Flags) -> tuple[CurveWithBand, ...]:
    """Return for each entry in which share of pairs it was within a factor of the oracle's time; none without one."""
    rows, oracle = material.rows, material.index_of_anchor("lower")
    if oracle is None:
        return ()
    factors = np.geomspace(1.0, _LARGEST_FACTOR, _FACTORS)
    lines: list[CurveWithBand] = []
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


def runtime_curves(material: ReportData, within: Flags) -> Mapping[str, tuple[CurveWithBand, ...]]:
    """Return which share had come within radii over time: of all radii together (`all`), and of each."""
    rows, at_s = material.rows, np.linspace(0.0, limit_s(material.rows), _TIMES)
    names = [f"time_within_{radius}_m_s" for radius in RADII_M]
    lines: dict[str, list[CurveWithBand]] = {key: [] for key in ("all", *RADII_M)}
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


# The share of some runs for which something holds, at each x.
def _share_line(rows: TrialRows, entry: int, some: Ints, x: Floats, holds: Flags) -> CurveWithBand:
    value, low, high = rates_over_units(holds, sampling_units(rows, some))
    return CurveWithBand(entry=entry, x=x, value=value, low=low, high=high, n=len(some))


def error_curves(material: ReportData, within: Flags) -> tuple[CurveWithBand, ...]:
    """Return for each entry which share had declared within a distance of the source; none where none declares.

    Of each run with gas the first declaration counts; a run without one is within no distance.
    """
    rows, at_m = material.rows, np.linspace(0.0, LARGEST_ERROR_M, _ERRORS)
    lines: list[CurveWithBand] = []
    for entry, some in rows_by_entry(material, within):
        if rows["declared"][some].any():
            error_m = np.where(rows["declared"][some], rows["declared_error_m"][some], math.inf)
            lines.append(_share_line(rows, entry, some, at_m, error_m[:, None] <= at_m))
    return tuple(lines)


def _line(entry: int, curve: Curve) -> CurveWithBand:
    return CurveWithBand(entry=entry, x=curve.at, value=curve.value, low=curve.low, high=curve.high, n=curve.n)


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


BELIEF_FIGURES = ("distance_m", "error_m", "mass_near", "entropy_bits", "minus_log_p")


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
    if material.tracks is None:
        return None
    index = {trial: i for i, trial in enumerate(material.rows["trial"])}
    at_s = np.linspace(0.0, limit_s(material.rows), _BELIEF_TIMES)
    found: dict[str, dict[int, Floats]] = {"belief_mass_near": {}, "belief_distance_m": {}}
    columns = ["trial", "t_s", *found]
    for batch in material.tracks.select(columns).to_batches(max_chunksize=512):
        trials = batch.column(0).to_pylist()
        lists = [batch.column(i) for i in range(1, 4)]
        for k, trial in enumerate(trials):
            row = index.get(trial)
            if row is None or row in found["belief_mass_near"]:
                continue
            t_s, mass, distance_m = (np.asarray(part[k].values, dtype=np.float64) for part in lists)
            if np.isfinite(mass).any():
                found["belief_mass_near"][row] = _held(at_s, t_s, mass)
                found["belief_distance_m"][row] = _held(at_s, t_s, distance_m)
    if not found["belief_mass_near"]:
        return None
    return BeliefTracks(at_s=at_s, mass_near=found["belief_mass_near"], distance_m=found["belief_distance_m"])


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


def belief_curves(material: ReportData, within: Flags, tracks: BeliefTracks) -> Mapping[str, tuple[CurveWithBand, ...]]:
    """Return the means of `mass` (within the radius) and `distance` [m] over time; nan where half have none yet."""
    return {
        "mass": _belief_lines(material, within, tracks.at_s, tracks.mass_near),
        "distance": _belief_lines(material, within, tracks.at_s, tracks.distance_m),
    }


def _belief_lines(
    material: ReportData, within: Flags, at_s: Floats, series: Mapping[int, Floats]
) -> tuple[CurveWithBand, ...]:
    lines: list[CurveWithBand] = []
    for entry, some in rows_by_entry(material, within):
        having = np.array([i for i in some.tolist() if i in series], dtype=np.int64)
        if having.size:
            values = np.stack([series[i] for i in having.tolist()])
            points = [_mean_at(values[:, k], material.rows, having) for k in range(at_s.size)]
            lines.append(_line_of(entry, at_s, points, having.size))
    return tuple(lines)


def _mean_at(values: Floats, rows: TrialRows, some: Ints) -> Estimate:
    known = np.isfinite(values)
    if known.sum() * 2 < values.size:
        return UNDEFINED
    units = sampling_units(rows, some[known])
    return bootstrap_mean(values[known], units.stratum, clusters=units.clusters, n_draws=_FEWER_DRAWS)


def _line_of(entry: int, x: Floats, points: Sequence[Estimate], n: int) -> CurveWithBand:
    value, low, high = (np.array([getattr(p, part) for p in points]) for part in ("value", "low", "high"))
    return CurveWithBand(entry=entry, x=x, value=value, low=low, high=high, n=n)


QUANTUM_M = 0.02
"""Resolution of the tracks on the page [m]."""

_MOST_CELLS = 120
_MOST_POINTS = 110
_MOST_TRACKS = 900
_MOST_OF_AN_ENTRY = 36
_MOST_OF_A_TEAM = 10
SOLID = 255
"""Byte of a plan where something solid is."""

_MOST_GAS = 250
# Gas fainter than the greatest by this factor is left blank.
_DECADES = 2.5


@dataclass(frozen=True, kw_only=True)
class PlanDrawing:
    """A plan to draw on: (nx, ny) bytes, 255 solid, else how much gas there is, 0 to 250 on a logarithmic scale.

    `rows` are the runs in it; `plan` is the map it was drawn from, if there is one; `box_m` is what is shown,
    (x0, y0, x1, y1) [m]. `greatest_ppm` is 0 without gas.
    """

    scenario: str
    label: str
    origin_m: tuple[float, float]
    extent_m: tuple[float, float]
    box_m: tuple[float, float, float, float]
    cells: NDArray[np.uint8] | None
    greatest_ppm: float
    height_m: float | None
    sources_m: tuple[tuple[float, float], ...]
    rows: Ints
    plan: EnvironmentMap | None


@dataclass(frozen=True, kw_only=True)
class StartSuccess:
    """Success of an entry from one start of an environment."""

    room: int
    entry: int
    x_m: float
    y_m: float
    success: Estimate


@dataclass(frozen=True, kw_only=True)
class DrawnTrack:
    """The way of an agent: (m, 2) steps of `QUANTUM_M`, the first from the origin."""

    room: int
    row: int
    steps: Ints


def build_plan_drawings(material: ReportData) -> tuple[PlanDrawing, ...]:
    """Return the rooms that were run in; those without a map are the box around starts and sources."""
    rows, rooms = material.rows, list[PlanDrawing]()
    for scenario in dict.fromkeys(rows["scenario"].tolist()):
        here = np.flatnonzero(rows["scenario"] == scenario)
        maps = [room for room in material.maps if room.scenario == scenario]
        parts = _parts(rows["varied"], here, maps) if maps else [(None, here)]
        many = len(parts) > 1
        for i, (room, some) in enumerate(parts):
            label = f"{scenario} {i + 1}" if many else scenario
            rooms.append(_mapped(label, room, some) if room else _bare(material, label, some))
    return tuple(rooms)


# The rows of each map: those whose values hold the map's.
def _parts(varied: Floats, here: Ints, maps: Sequence[EnvironmentMap]) -> list[tuple[EnvironmentMap | None, Ints]]:
    values = [parse_json(text or "{}", JsonObject, place="trials: varied") for text in varied[here]]
    wanted = [parse_json(room.varied, JsonObject, place="maps.json: varied") for room in maps]
    place = [
        next((k for k, want in enumerate(wanted) if all(value.get(key) == want[key] for key in want)), 0)
        for value in values
    ]
    parts = [(room, here[np.array(place) == k]) for k, room in enumerate(maps)]
    return [(room, some) for room, some in parts if some.size]


def _mapped(label: str, room: EnvironmentMap, some: Ints) -> PlanDrawing:
    cells, cell_m, greatest = _packed(room)
    nx, ny = cells.shape
    x0, y0 = room.origin_m
    return PlanDrawing(
        scenario=room.scenario, label=label, origin_m=room.origin_m, extent_m=(nx * cell_m, ny * cell_m),
        box_m=(x0, y0, x0 + room.occupied.shape[0] * room.cell_m, y0 + room.occupied.shape[1] * room.cell_m),
        cells=cells, greatest_ppm=greatest, height_m=room.height_m,
        sources_m=tuple((x, y) for x, y, _ in room.sources_m), rows=some, plan=room,
    )  # fmt: skip


def _bare(material: ReportData, label: str, some: Ints) -> PlanDrawing:
    rows = material.rows
    sources = {(float(x), float(y)) for x, y in zip(rows["source_x_m"][some], rows["source_y_m"][some])}
    sources = {place for place in sources if all(np.isfinite(place))}
    starts = np.stack([rows["start_x_m"][some], rows["start_y_m"][some]], axis=1)
    places = np.concatenate([starts[np.isfinite(starts).all(axis=1)], np.array(list(sources)).reshape(-1, 2)])
    low, high = (places.min(0) - 2.0, places.max(0) + 2.0) if places.size else (np.zeros(2), np.ones(2))
    return PlanDrawing(
        scenario=str(rows["scenario"][some[0]]), label=label, origin_m=(float(low[0]), float(low[1])),
        extent_m=(float(high[0] - low[0]), float(high[1] - low[1])),
        box_m=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        cells=None, greatest_ppm=0.0, height_m=None, sources_m=tuple(sorted(sources)), rows=some, plan=None,
    )  # fmt: skip


def _packed(room: EnvironmentMap) -> tuple[NDArray[np.uint8], float, float]:
    every = max(1, -(-max(room.occupied.shape) // _MOST_CELLS))
    solid = _blocks(room.occupied.astype(np.float64), every) >= 0.5
    if room.mean_gas_ppm is None:
        return np.where(solid, SOLID, 0).astype(np.uint8), room.cell_m * every, 0.0
    gas = _blocks(np.nan_to_num(room.mean_gas_ppm), every)
    greatest = float(gas.max(initial=0.0))
    if greatest <= 0.0:
        return np.where(solid, SOLID, 0).astype(np.uint8), room.cell_m * every, 0.0
    decades = np.log10(np.maximum(gas / greatest, 1e-12)) / _DECADES
    level = np.round(_MOST_GAS * np.clip(1.0 + decades, 0.0, 1.0))
    return np.where(solid, SOLID, level).astype(np.uint8), room.cell_m * every, greatest


# Mean over blocks of cells; what is left over at the far sides makes smaller blocks.
def _blocks(values: Floats, every: int) -> Floats:
    if every == 1:
        return values
    for axis in (0, 1):
        starts = np.arange(0, values.shape[axis], every)
        widths = np.diff(np.append(starts, values.shape[axis]))
        values = np.add.reduceat(values, starts, axis=axis) / (widths[:, None] if axis == 0 else widths)
    return values


def compute_start_success(material: ReportData, rooms: Sequence[PlanDrawing]) -> tuple[StartSuccess, ...]:
    """Return the success of each entry from each start in each room."""
    rows, found = material.rows, list[StartSuccess]()
    everything = np.ones(len(rows), dtype=bool)
    for entry, flown in rows_by_entry(material, everything):
        for i, room in enumerate(rooms):
            some = np.intersect1d(flown, room.rows)
            places = np.round(np.stack([rows["start_x_m"][some], rows["start_y_m"][some]], axis=1), 2)
            if not some.size or not np.isfinite(places).all():
                continue
            starts, place = np.unique(places, axis=0, return_inverse=True)
            for k, (x_m, y_m) in enumerate(starts.tolist()):
                success = rows["success"][some[place.reshape(-1) == k]]
                rate = wilson(int(success.sum()), success.size)
                found.append(StartSuccess(room=i, entry=entry, x_m=x_m, y_m=y_m, success=rate))
    return tuple(found)


def select_tracks(material: ReportData, rooms: Sequence[PlanDrawing]) -> tuple[DrawnTrack, ...]:
    """Return some tracks of each entry in each room, thinned: as many of each as fit on a page of bounded size."""
    if material.tracks is None:
        return ()
    rows = material.rows
    everything = rows_by_entry(material, np.ones(len(rows), dtype=bool))
    each = max(2, min(_MOST_OF_AN_ENTRY, _MOST_TRACKS // max(1, len(rooms) * len(everything))))
    wanted: dict[str, tuple[int, int]] = {}
    for i, room in enumerate(rooms):
        for _, flown in everything:
            some = np.intersect1d(flown, room.rows)
            picked = some[np.unique(np.linspace(0, some.size - 1, min(each, some.size)).round().astype(int))]
            wanted |= {str(rows["trial"][row]): (i, int(row)) for row in picked.tolist()}
    return tuple(_tracks(material, wanted))


def _tracks(material: ReportData, wanted: Mapping[str, tuple[int, int]]) -> list[DrawnTrack]:
    found: dict[str, list[DrawnTrack]] = {}
    assert material.tracks is not None
    for batch in material.tracks.select(["trial", "x_m", "y_m"]).to_batches(max_chunksize=512):
        for k, trial in enumerate(batch.column(0).to_pylist()):
            # A team has a row for each robot.
            if trial in wanted and len(found.get(trial, ())) < _MOST_OF_A_TEAM:
                xy_m = np.stack([np.asarray(batch.column(i)[k].values, dtype=np.float64) for i in (1, 2)], axis=1)
                xy_m = xy_m[np.isfinite(xy_m).all(axis=1)]
                if len(xy_m) > 1:
                    room, row = wanted[trial]
                    found.setdefault(trial, []).append(DrawnTrack(room=room, row=row, steps=_thinned(xy_m)))
    return [track for trial in wanted for track in found.get(trial, ())]


def _thinned(xy_m: Floats) -> Ints:
    keep = np.unique(np.linspace(0, len(xy_m) - 1, min(_MOST_POINTS, len(xy_m))).round().astype(int))
    places = np.round(xy_m[keep] / QUANTUM_M).astype(np.int64)
    moved = np.concatenate([[True], (np.diff(places, axis=0) != 0).any(axis=1)])
    return np.diff(places[moved], axis=0, prepend=np.zeros((1, 2), dtype=np.int64))


def encode_plan(cells: NDArray[np.uint8]) -> str:
    """Return the bytes of a plan as text, in C order."""
    return base64.b64encode(np.ascontiguousarray(cells).tobytes()).decode()
