"""Analysis behind the report: the figures of each view, environments, cases and failures."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gslcosim.bench.report.curves import (
    BeliefTracks,
    CurveWithBand,
    DeclarationCounts,
    FinalBelief,
    TimeSummary,
    belief_curves,
    belief_tracks,
    profile_curves,
    rows_by_entry,
    runtime_curves,
    success_curves,
    summarise_declarations,
    summarise_final_beliefs,
    summarise_times,
)
from gslcosim.bench.report.difficulty import CaseDifficulty, FailureGroup, grade_cases, group_failures
from gslcosim.bench.report.leaderboard import LeaderboardRow, build_leaderboard, build_matrix, plume_clusters
from gslcosim.bench.report.plan_drawings import (
    DrawnTrack,
    PlanDrawing,
    StartSuccess,
    build_plan_drawings,
    compute_start_success,
    select_tracks,
)
from gslcosim.bench.report.report_data import Flags, ReportData
from gslcosim.bench.statistics.estimates import N_DRAWS, Estimate
from gslcosim.bench.statistics.pairs import N_FLIPS
from gslcosim.bench.statistics.ranking import PairsMatrix, pairs_matrix

SIGNIFICANT = 0.05
"""Corrected p below which one entry is said to beat another."""

_MOST_VIEWS = 24
# Of more pairs only those over all cases are reported.
_MANY_PAIRS = 200


@dataclass(frozen=True, kw_only=True)
class EntryComparison:
    """One entry against another over their pairs.

    Attributes:
        a: The one.
        b: The other.
        verdict: 1 where a beats b, -1 where b beats a, 0 where they cannot be distinguished.
        score: Mean difference of the score.
        success: Difference of the rates.
        a_better: Share of pairs in which a's score is higher, ties half.
        p_holm: Of the score, corrected for all pairs of the view; nan where no test is possible.
    """

    a: int
    b: int
    verdict: int
    score: Estimate
    success: Estimate
    a_better: Estimate
    p_holm: float


@dataclass(frozen=True, kw_only=True)
class ReportView:
    """All figures over some of the cases: all of them, those of a family, or those of a scenario."""

    key: str
    label: str
    kind: str
    scenarios: tuple[str, ...]
    n_trials: int
    n_controls: int
    standings: tuple[LeaderboardRow, ...]
    curves: tuple[CurveWithBand, ...]
    times: tuple[TimeSummary, ...]
    profiles: tuple[CurveWithBand, ...]
    runtimes: Mapping[str, tuple[CurveWithBand, ...]]
    pairs: tuple[EntryComparison, ...]
    declarations: tuple[DeclarationCounts, ...]
    beliefs: Mapping[str, tuple[CurveWithBand, ...]]
    last_beliefs: tuple[FinalBelief, ...]


@dataclass(frozen=True, kw_only=True)
class Analysis:
    """All figures of the report. `draws_plumes` says whether intervals draw whole plumes or single runs."""

    material: ReportData
    views: tuple[ReportView, ...]
    rooms: tuple[PlanDrawing, ...]
    starts: tuple[StartSuccess, ...]
    tracks: tuple[DrawnTrack, ...]
    grades: tuple[CaseDifficulty, ...]
    failures: tuple[FailureGroup, ...]
    draws_plumes: bool

    @property
    def everything(self) -> ReportView:
        """The view of all cases."""
        return self.views[0]


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
        draws_plumes=plume_clusters(material.rows, np.flatnonzero(~material.rows.is_control)) is not None,
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
    standings = build_leaderboard(material, within)
    return ReportView(
        key=key,
        label=label,
        kind=kind,
        scenarios=tuple(dict.fromkeys(rows["scenario"][within].tolist())),
        n_trials=int(within.sum()),
        n_controls=int((within & rows.is_control).sum()),
        standings=standings,
        curves=success_curves(material, within),
        times=summarise_times(material, within),
        profiles=profile_curves(material, within),
        runtimes=runtime_curves(material, within),
        pairs=_compared(material, within, [row.entry for row in standings]),
        declarations=summarise_declarations(material, within),
        beliefs=belief_curves(material, within, tracks) if tracks is not None else {},
        last_beliefs=summarise_final_beliefs(material, within),
    )


def _compared(material: ReportData, within: Flags, entries: list[int]) -> tuple[EntryComparison, ...]:
    n_pairs = _n_pairs(entries)
    if not n_pairs or (n_pairs > _MANY_PAIRS and not within.all()):
        return ()
    rows = material.rows
    # The least p that tosses can show is one in their number, and Holm's correction multiplies it by the pairs.
    n_flips = max(N_FLIPS, round(2.0 * n_pairs / SIGNIFICANT))
    scores, success = (
        _matrix(material, within, entries, rows.score, n_flips=n_flips),
        # Of success only the differences are reported, not their p.
        _matrix(material, within, entries, rows["success"].astype(np.float64), n_flips=1),
    )
    index = {entry.name: i for i, entry in enumerate(material.entries)}
    return tuple(
        EntryComparison(
            a=index[s.a], b=index[s.b], verdict=_verdict(s.difference, s.p_holm), score=s.difference,
            success=r.difference, a_better=s.a_better, p_holm=s.p_holm,
        )
        for s, r in zip(scores.pairs, success.pairs, strict=True)
        if s.difference.n
    )  # fmt: skip


def _n_pairs(entries: list[int]) -> int:
    return len(entries) * (len(entries) - 1) // 2


def _matrix(
    material: ReportData, within: Flags, entries: list[int], values: np.ndarray, *, n_flips: int
) -> PairsMatrix:
    rows = material.rows
    matrix, some = build_matrix(rows, within, entries, values)
    return pairs_matrix(
        matrix,
        [material.entries[i].name for i in entries],
        lower_is_better=False,
        clusters=plume_clusters(rows, some),
        strata=rows.cells[some],
        n_draws=500 if _n_pairs(entries) > _MANY_PAIRS else N_DRAWS,
        n_flips=n_flips,
    )


def _verdict(difference: Estimate, p: float) -> int:
    return int(np.sign(difference.value)) if not math.isnan(p) and p < SIGNIFICANT else 0


def count_runs(material: ReportData) -> tuple[int, int]:
    """Return the numbers of runs with gas and without."""
    n = sum(len(some) for _, some in rows_by_entry(material, np.ones(len(material.rows), dtype=bool)))
    return n, len(material.rows) - n
