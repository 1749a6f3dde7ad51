"""Analysis behind the report: the figures of each view, difficulty of each case with its causes, and failures."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim_bench.report.curves import (
    BeliefTracks,
    ChartLine,
    DeclarationCounts,
    FinalBelief,
    TimeSummary,
    belief_curves,
    belief_tracks,
    error_curves,
    profile_curves,
    runtime_curves,
    success_curves,
    summarise_declarations,
    summarise_final_beliefs,
    summarise_times,
)
from gslcosim_bench.report.labels import LevelSuccess, compare_levels
from gslcosim_bench.report.leaderboard import LeaderboardRow, build_leaderboard
from gslcosim_bench.report.null_differences import NullDifference, compare_with_nulls
from gslcosim_bench.report.plans import PlanDrawing, StartSuccess, build_plan_drawings, compute_start_success
from gslcosim_bench.report.report_data import EnvironmentMap, Flags, Floats, Ints, ReportData, read_samples
from gslcosim_bench.report.responses import ParameterResponse, compute_responses
from gslcosim_bench.report.tracks import DrawnTrack, select_tracks
from gslcosim_bench.statistics.difficulty import (
    contact_difficulty,
    distance_difficulty,
    fit_rasch,
    geometric_difficulty,
    grades,
    plume_legibility,
    wind_difficulty,
)
from gslcosim_bench.statistics.estimates import UNDEFINED, Estimate, two_sided_z
from gslcosim_bench.statistics.ranking import EntryComparison
from gslcosim_bench.statistics.rates import wilson
from gslcosim_bench.statistics.sampling_units import SamplingUnits
from gslcosim_bench.statistics.times import restricted_mean

BLIND, SWEEP = "persistent_walk", "sweep"
"""The entries whose flights tell of geometry and of contact with gas: the bundled methods under their own names."""
_MOST_VIEWS = 24
# Of more pairs only those over all cases are reported.
_MANY_PAIRS = 200


@dataclass(frozen=True, kw_only=True)
class DifficultyCauses:
    """Causes of a case's difficulty, each dimensionless; nan where the runs it needs are missing.

    Attributes:
        geometry: D1, how rarely the persistent walk finds the source.
        contact: D2, how rarely the sweep meets gas in the first third of the time.
        distance: D3, the shortest path over the diagonal of the room.
        legibility: D4, how plainly the plume points to its source; high is easy.
        wind: D5, how much the wind's direction differs along the oracle's way and over time.
    """

    geometry: float
    contact: float
    distance: float
    legibility: float
    wind: float


def compute_causes(material: ReportData, rooms: Sequence[PlanDrawing], cells: Ints) -> list[DifficultyCauses]:
    """Return the causes of difficulty of each case.

    Args:
        cells: (n,) indices of the cases, as in `TrialRows`.
    """
    rows = material.rows
    index = {entry.name: i for i, entry in enumerate(material.entries)}
    maps = _map_of_rows(rooms)
    of_oracle = np.flatnonzero(rows.entry == material.index_of_anchor("lower")).tolist()
    tracks = {row: team[-1].T for row, team in read_samples(material, ("x_m", "y_m"), of_oracle).items()}
    found: list[DifficultyCauses] = []
    for cell in cells.tolist():
        flown = np.flatnonzero((rows.cells == cell) & ~rows.is_control)
        blind, sweep = (flown[rows.entry[flown] == index.get(name, -1)] for name in (BLIND, SWEEP))
        plan = next((maps[row] for row in flown.tolist() if row in maps), None)
        found.append(
            DifficultyCauses(
                geometry=geometric_difficulty(float(rows["success"][blind].mean())) if blind.size else math.nan,
                contact=_contact_difficulty(material, sweep),
                distance=_distance(shortest_path_m(material, flown), plan),
                legibility=_legibility(plan) if plan else math.nan,
                wind=_wind(plan, [tracks[row] for row in flown.tolist() if row in tracks]) if plan else math.nan,
            )
        )
    return found


def _contact_difficulty(material: ReportData, sweep: Ints) -> float:
    if not sweep.size:
        return math.nan
    rows = material.rows
    return contact_difficulty(rows["first_contact_s"][sweep], float(rows["time_limit_s"][sweep[0]]))


def shortest_path_m(material: ReportData, flown: Ints) -> float:
    """Return the shortest path of the runs of one case [m]: equal for all, nan where none has a result."""
    lengths_m = material.rows["shortest_path_m"][flown]
    known_m = lengths_m[np.isfinite(lengths_m)]
    return float(known_m[0]) if known_m.size else math.nan


def _distance(shortest_m: float, plan: EnvironmentMap | None) -> float:
    return distance_difficulty(shortest_m, plan.cell_m * math.hypot(*plan.occupied.shape)) if plan else math.nan


def _map_of_rows(rooms: Sequence[PlanDrawing]) -> dict[int, EnvironmentMap]:
    return {
        row: room.plan
        for room in rooms
        if room.plan is not None
        for row in room.rows.tolist()
    }  # fmt: skip


def _wind(plan: EnvironmentMap, tracks: Sequence[Floats]) -> float:
    if plan.wind_toward is None or not tracks:
        return math.nan
    track_m = np.concatenate(tracks)
    cells = np.unique(_cells_of(plan, track_m[np.isfinite(track_m).all(axis=1)]), axis=0)
    return wind_difficulty(plan.wind_toward[cells[:, 0], cells[:, 1]])


# Where a robot waits its cell is counted once.
def _cells_of(plan: EnvironmentMap, track_m: Floats) -> Ints:
    cells = np.floor((track_m - plan.origin_m) / plan.cell_m).astype(np.int64)
    return np.clip(cells, 0, np.array(plan.occupied.shape) - 1)


def _legibility(plan: EnvironmentMap) -> float:
    if plan.mean_gas_ppm is None or plan.intermittency is None or plan.wind_toward is None:
        return math.nan
    axis = _axis_of(plan)
    against = -plan.wind_toward[axis[:, 0], axis[:, 1]]
    # One cell to each side, along the nearest of eight directions; where the wind has none there is no upwind.
    turn = np.round(np.arctan2(against[:, 1], against[:, 0]) / (0.25 * math.pi)) * (0.25 * math.pi)
    step = np.where(np.hypot(*against.T)[:, None] > 0, np.round(np.stack([np.cos(turn), np.sin(turn)], axis=1)), 0)
    before, after = axis + step.astype(np.int64), axis - step.astype(np.int64)
    seen = _is_air(plan, before) & _is_air(plan, after) & (step != 0).any(axis=1)
    upwind, downwind = plan.mean_gas_ppm[tuple(before[seen].T)], plan.mean_gas_ppm[tuple(after[seen].T)]
    gas_free = 1.0 - plan.intermittency[tuple(axis[seen].T)]
    return plume_legibility((upwind - downwind) / (2.0 * plan.cell_m), gas_free)


# The cell with the most gas in each ring around the source, as long as there is some.
def _axis_of(plan: EnvironmentMap) -> Ints:
    assert plan.mean_gas_ppm is not None
    nx, ny = plan.occupied.shape
    x_m, y_m = (origin + (np.arange(n) + 0.5) * plan.cell_m for origin, n in zip(plan.origin_m, (nx, ny), strict=True))
    gaps_m = [np.hypot(x_m[:, None] - x, y_m[None, :] - y) for x, y, _ in plan.sources_m]
    ring = np.floor(np.min(gaps_m, axis=0) / plan.cell_m).astype(np.int64)
    gas_ppm = np.where(plan.occupied, 0.0, np.nan_to_num(plan.mean_gas_ppm))
    order = np.lexsort((-gas_ppm.reshape(-1), ring.reshape(-1)))
    first = order[np.unique(ring.reshape(-1)[order], return_index=True)[1]]
    axis = np.stack(np.unravel_index(first, (nx, ny)), axis=1)
    return axis[gas_ppm[tuple(axis.T)] > 0.0]


def _is_air(plan: EnvironmentMap, cells: Ints) -> Flags:
    inside = np.all((cells >= 0) & (cells < np.array(plan.occupied.shape)), axis=1)
    safe = np.where(inside[:, None], cells, 0)
    return inside & ~plan.occupied[safe[:, 0], safe[:, 1]]


@dataclass(frozen=True, kw_only=True)
class CaseDifficulty:
    """Difficulty of a case.

    Attributes:
        grade: easy, medium or hard: thirds of the suite's cases; empty where nothing distinguishes cases.
        difficulty: Of the Rasch model [logit], mean 0; higher is harder; the anchors that know the source left out.
        is_informative: Whether some runs succeeded and some did not.
        success: Share of all entries' runs, the oracle's left out.
        oracle_s: Restricted mean time of the oracle [s]; undefined without one.
        walker: Success of the random walker; undefined without one.
        contact: Share of runs that met gas.
        causes: What makes it difficult.
    """

    case: str
    family: str
    grade: str
    difficulty: Estimate
    is_informative: bool
    success: Estimate
    oracle_s: Estimate
    walker: Estimate
    contact: Estimate
    shortest_m: float
    causes: DifficultyCauses
    n: int


@dataclass(frozen=True, kw_only=True)
class FailureGroup:
    """Runs that ended alike without success.

    Attributes:
        status: flown, or why there is no result.
        outcome: Of the referee; empty without a result.
        rows: Which runs, in the order of the suite.
        by_entry: How many of each entry, most first.
    """

    status: str
    outcome: str
    rows: Ints
    by_entry: tuple[tuple[int, int], ...]


def grade_cases(material: ReportData, rooms: Sequence[PlanDrawing]) -> tuple[CaseDifficulty, ...]:
    """Return the difficulty of each case with gas, in the order of the suite."""
    rows = material.rows
    oracle, walker = material.index_of_anchor("lower"), material.index_of_anchor("upper")
    cells = np.unique(rows.cells[~rows.is_control])
    entries = [i for i in range(len(material.entries)) if i != oracle]
    if not cells.size or not entries:
        return ()
    successes, trials = _counts(material, cells, entries)
    fit = fit_rasch(successes, trials)
    # Equal cases differ in the last digits of the fit.
    rounded = np.round(fit.difficulty, 6)
    graded = grades(rounded) if np.ptp(rounded) > 0 else [""] * cells.size
    half = two_sided_z(0.95) * fit.difficulty_error
    causes = compute_causes(material, rooms, cells)
    found: list[CaseDifficulty] = []
    for k, cell in enumerate(cells.tolist()):
        some = np.flatnonzero((rows.cells == cell) & ~rows.is_control)
        d, n = float(fit.difficulty[k]), int(trials[k].sum())
        found.append(
            CaseDifficulty(
                case=str(rows["case"][some[0]]), family=str(rows["family"][some[0]]), grade=graded[k],
                difficulty=Estimate(d, d - half[k], d + half[k], n), is_informative=bool(fit.is_informative[k]),
                success=wilson(int(successes[k].sum()), n), oracle_s=_time_of(material, some, oracle),
                walker=_rate_of(material, some, walker), contact=_contact(material, some),
                shortest_m=shortest_path_m(material, some), causes=causes[k], n=n,
            )
        )  # fmt: skip
    return tuple(found)


def _counts(material: ReportData, cells: Ints, entries: Sequence[int]) -> tuple[Ints, Ints]:
    rows = material.rows
    shape = (len(cells), len(entries))
    successes, trials = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
    chosen = np.flatnonzero(~rows.is_control & np.isin(rows.entry, entries))
    column = {entry: k for k, entry in enumerate(entries)}
    of_entry = np.array([column[i] for i in rows.entry[chosen].tolist()], dtype=np.int64)
    place = np.searchsorted(cells, rows.cells[chosen]) * len(entries) + of_entry
    np.add.at(trials.reshape(-1), place, 1)
    np.add.at(successes.reshape(-1), place, rows["success"][chosen].astype(np.int64))
    return successes, trials


def _time_of(material: ReportData, some: Ints, entry: int | None) -> Estimate:
    own = some[material.rows.entry[some] == entry] if entry is not None else some[:0]
    rows = material.rows
    return restricted_mean(rows.time_s[own], rows["success"][own], rows["time_limit_s"][own]) if own.size else UNDEFINED


def _rate_of(material: ReportData, some: Ints, entry: int | None) -> Estimate:
    own = some[material.rows.entry[some] == entry] if entry is not None else some[:0]
    return wilson(int(material.rows["success"][own].sum()), own.size)


def _contact(material: ReportData, some: Ints) -> Estimate:
    return wilson(int(np.isfinite(material.rows["first_contact_s"][some]).sum()), some.size)


def group_failures(material: ReportData) -> tuple[FailureGroup, ...]:
    """Return the runs with gas that did not succeed, and all without a result, largest group first."""
    rows = material.rows
    failed = np.flatnonzero((~rows["success"] & ~rows.is_control) | (rows["status"] != "flown"))
    keys = list(zip(rows["status"][failed].tolist(), rows["outcome"][failed].tolist()))
    groups: list[FailureGroup] = []
    for (status, outcome), _ in Counter(keys).most_common():
        some = failed[[key == (status, outcome) for key in keys]]
        by_entry = tuple(Counter(rows.entry[some].tolist()).most_common())
        groups.append(FailureGroup(status=status, outcome=outcome, rows=some, by_entry=by_entry))
    return tuple(groups)


@dataclass(frozen=True, kw_only=True)
class PairComparison:
    """One entry against another over their pairs.

    Attributes:
        a: The one.
        b: The other.
        verdict: 1 where a beats b, -1 where b beats a, 0 where they are not told apart.
        is_same: Whether they are not told apart and any difference in success is smaller than one that matters.
        score: Mean difference of the score, with its simultaneous interval.
        success: The same of the success.
        a_better: Share of pairs in which a's score is higher, ties half.
        p: Of the score, corrected for all pairs of the view.
    """

    a: int
    b: int
    verdict: int
    is_same: bool
    score: Estimate
    success: Estimate
    a_better: Estimate
    p: float


@dataclass(frozen=True, kw_only=True)
class ReportView:
    """All figures over some of the cases: all of them, those of a family, or those of a scenario.

    `units` is what is drawn, `critical_value` how many standard errors simultaneous intervals reach to each side.
    """

    key: str
    label: str
    kind: str
    scenarios: tuple[str, ...]
    n_trials: int
    n_controls: int
    units: SamplingUnits
    critical_value: float
    standings: tuple[LeaderboardRow, ...]
    curves: tuple[ChartLine, ...]
    times: tuple[TimeSummary, ...]
    profiles: tuple[ChartLine, ...]
    runtimes: Mapping[str, tuple[ChartLine, ...]]
    pairs: tuple[PairComparison, ...]
    declarations: tuple[DeclarationCounts, ...]
    errors: tuple[ChartLine, ...]
    beliefs: Mapping[str, tuple[ChartLine, ...]]
    last_beliefs: tuple[FinalBelief, ...]
    responses: tuple[ParameterResponse, ...]


@dataclass(frozen=True, kw_only=True)
class Analysis:
    """All figures of the report; `levels` are empty where the suite labels no cases, `nulls` where it names none."""

    material: ReportData
    views: tuple[ReportView, ...]
    rooms: tuple[PlanDrawing, ...]
    starts: tuple[StartSuccess, ...]
    tracks: tuple[DrawnTrack, ...]
    grades: tuple[CaseDifficulty, ...]
    failures: tuple[FailureGroup, ...]
    levels: tuple[LevelSuccess, ...] = ()
    nulls: tuple[NullDifference, ...] = ()

    @property
    def everything(self) -> ReportView:
        """The view of all cases."""
        return self.views[0]

    @property
    def is_about_declarations(self) -> bool:
        """True where success is by declaration, or an entry declares in most of its runs with gas."""
        rows = self.material.rows
        flown = ~rows.is_control
        if "declaration" in rows["success_of"][flown].tolist():
            return True
        own = (flown & (rows.entry == entry) for entry in range(len(self.material.entries)))
        return any(bool(rows["declared"][some].mean() > 0.5) for some in own if some.any())


def analyse(material: ReportData) -> Analysis:
    """Return all figures of a report."""
    tracks = belief_tracks(material)
    rooms = build_plan_drawings(material)
    return Analysis(
        material=material,
        views=tuple(
            _view(material, within, key=key, label=label, kind=kind, tracks=tracks)
            for key, label, kind, within in _parts(material)
        ),
        rooms=rooms,
        starts=compute_start_success(material, rooms),
        tracks=select_tracks(material, rooms),
        grades=grade_cases(material, rooms),
        failures=group_failures(material),
        levels=compare_levels(material),
        nulls=compare_with_nulls(material),
    )


# Key, label, kind and rows of each view.
def _parts(material: ReportData) -> list[tuple[str, str, str, Flags]]:
    rows = material.rows
    parts = [("all", "all cases", "all", np.ones(len(rows), dtype=bool))]
    for kind in ("family", "scenario"):
        names = list(dict.fromkeys(rows[kind].tolist()))
        if 1 < len(names) <= _MOST_VIEWS - len(parts):
            parts += [(f"{kind}:{name}", name, kind, rows[kind] == name) for name in names]
    known: set[bytes] = set()
    # A family of one scenario is reported once.
    return [part for part in parts if not ((mark := part[3].tobytes()) in known or known.add(mark))]


def _view(
    material: ReportData, within: Flags, *, key: str, label: str, kind: str, tracks: BeliefTracks | None
) -> ReportView:
    rows = material.rows
    standings, comparison = build_leaderboard(material, within)
    return ReportView(
        key=key,
        label=label,
        kind=kind,
        scenarios=tuple(dict.fromkeys(rows["scenario"][within].tolist())),
        n_trials=int(within.sum()),
        n_controls=int((within & rows.is_control).sum()),
        units=comparison.units,
        critical_value=comparison.critical_value,
        standings=standings,
        curves=success_curves(material, within),
        times=summarise_times(material, within),
        profiles=profile_curves(material, within),
        runtimes=runtime_curves(material, within),
        pairs=_pairs(material, comparison, is_whole=bool(within.all())),
        declarations=summarise_declarations(material, within),
        errors=error_curves(material, within),
        beliefs=belief_curves(material, within, tracks) if tracks is not None else {},
        last_beliefs=summarise_final_beliefs(material, within),
        responses=compute_responses(material, within),
    )


def _pairs(material: ReportData, comparison: EntryComparison, *, is_whole: bool) -> tuple[PairComparison, ...]:
    if len(comparison.pairs) > _MANY_PAIRS and not is_whole:
        return ()
    margin = material.smallest_difference
    return tuple(
        PairComparison(
            a=pair.a, b=pair.b, verdict=pair.verdict,
            is_same=not pair.verdict and pair.differences["success"].is_within(margin),
            score=pair.differences["score"], success=pair.differences["success"], a_better=pair.a_better, p=pair.p,
        )
        for pair in comparison.pairs
    )  # fmt: skip


def find_beaten(view: ReportView, entry: int) -> list[int]:
    """Return the entries that an entry beats, in the order of the leaderboard."""
    beaten = {p.b if p.verdict > 0 else p.a for p in view.pairs if p.verdict and entry == (p.a, p.b)[p.verdict < 0]}
    return [row.entry for row in view.standings if row.entry in beaten]


def find_same(view: ReportView, entry: int) -> list[int]:
    """Return the entries that are shown to be the same as an entry, in the order of the leaderboard."""
    same = {other for p in view.pairs if p.is_same for one, other in ((p.a, p.b), (p.b, p.a)) if one == entry}
    return [row.entry for row in view.standings if row.entry in same]
