"""Leaderboard: a row of figures for each entry over some of the cases."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gslcosim_bench.report.report_data import Flags, Floats, Ints, ReportData, TrialRows
from gslcosim_bench.statistics.aggregates import bootstrap_cells, bootstrap_worst_quarter
from gslcosim_bench.statistics.estimates import UNDEFINED, Estimate, bootstrap, encode_labels
from gslcosim_bench.statistics.ranking import EntryComparison, compare_entries
from gslcosim_bench.statistics.rates import lift, lift_over_units, pool_design_effect, rate_over_units
from gslcosim_bench.statistics.sampling_units import SamplingUnits, find_sampling_units
from gslcosim_bench.statistics.times import restricted_mean

DECLARED_WITHIN_M = {"declared_05": 0.5, "declared_1": 1.0, "declared_2": 2.0}
"""Radii by the figures of success by declaration [m]."""


@dataclass(frozen=True, kw_only=True)
class LeaderboardRow:
    """An entry's row: its rank, and its figures over the runs with gas.

    Attributes:
        rank: One more than the number of entries that beat it: the best place it may have.
        last_rank: The worst place it may have: the number of entries less those that it beats.
        score: Mean over cases of the mean q of each.
        worst: The same over the quarter of the cases in which it is worst.
        normalised: (score - walker) / (oracle - walker), both anchors taken as they are; undefined without them.
        success: Mean over cases of the share of runs; so are the other shares, the time and SPL.
        declared_05: Share of runs whose first declaration was within 0.5 m of the source; undefined where no entry of
            the results declares.
        declared_1: The same within 1 m.
        declared_2: The same within 2 m.
        lift: Success less luck in runs without gas; undefined without such runs.
        time_s: Restricted mean time [s].
        spl: Mean of SPL.
        overhead: Median travel overhead of the successes.
        false_alarms: Share of the runs without gas with a declaration; without such runs, share of the others
            with a declaration of a wrong place.
        decision_ms: Median over runs of the median time of a decision [ms of wall clock].
        n: Runs with gas.
    """

    entry: int
    rank: int
    last_rank: int
    score: Estimate
    worst: Estimate
    normalised: Estimate
    success: Estimate
    declared_05: Estimate
    declared_1: Estimate
    declared_2: Estimate
    lift: Estimate
    time_s: Estimate
    spl: Estimate
    overhead: Estimate
    false_alarms: Estimate
    decision_ms: Estimate
    n: int


def build_leaderboard(material: ReportData, within: Flags) -> tuple[tuple[LeaderboardRow, ...], EntryComparison]:
    """Return the rows of all entries that flew, highest score first, and the comparison that ranks follow from.

    Args:
        within: (n,) which rows count.
    """
    rows = material.rows
    flown = [(i, np.flatnonzero(within & (rows.entry == i))) for i in range(len(material.entries))]
    with_gas = [chosen[~rows.is_control[chosen]] for _, chosen in flown]
    effect = pool_design_effect((rows["success"][some], sampling_units(rows, some)) for some in with_gas if some.size)
    bare = [_standing(rows, i, chosen, effect) for i, chosen in flown if chosen.size]
    bare = [row for row in bare if row.n]
    lower = next((r.score.value for r in bare if material.entries[r.entry].anchor == "upper"), None)
    upper = next((r.score.value for r in bare if material.entries[r.entry].anchor == "lower"), None)
    comparison = compare_within(rows, within, [row.entry for row in bare])
    completed = [
        replace(row, rank=first, last_rank=last, normalised=_normalised(row.score, lower, upper))
        for row, (first, last) in zip(bare, comparison.ranks, strict=True)
    ]
    return tuple(sorted(completed, key=lambda row: (-row.score.value, row.entry))), comparison


def compare_within(rows: TrialRows, within: Flags, entries: Sequence[int]) -> EntryComparison:
    """Return the comparison of entries in score and success, in one family; its pairs have indices of entries.

    Args:
        within: (n,) which count; runs without gas do not.
    """
    score, some = build_matrix(rows, within, entries, rows.score)
    success, _ = build_matrix(rows, within, entries, rows["success"].astype(np.float64))
    compared = compare_entries(
        {"score": score, "success": success},
        ranked_by="score",
        lower_is_better=False,
        units=sampling_units(rows, some),
        cases=encode_labels(rows.cells[some]) if some.size else rows.cells[some],
        limit=1.0,
    )
    return replace(compared, pairs=tuple(replace(p, a=entries[p.a], b=entries[p.b]) for p in compared.pairs))


def sampling_units(rows: TrialRows, chosen: Ints) -> SamplingUnits:
    """Return what is drawn of some rows: whole rooms, whole plumes or single runs."""
    return find_sampling_units(rows.rooms[chosen], rows.gas[chosen], rows.cells[chosen])


# The design effect of success over all entries serves rates of 0 and 1, which show none themselves.
def _standing(rows: TrialRows, entry: int, chosen: Ints, effect: float) -> LeaderboardRow:
    controls = chosen[rows.is_control[chosen]]
    chosen = chosen[~rows.is_control[chosen]]
    success, cells, units = rows["success"][chosen], rows.cells[chosen], sampling_units(rows, chosen)
    overhead, decision_ms = rows["travel_overhead"][chosen], rows["wall_decision_p50_ms"][chosen]
    error_m = np.where(rows["declared"][chosen], rows["declared_error_m"][chosen], np.nan)
    declares = bool(rows["declared"].any())
    some = controls if len(controls) else chosen
    is_false = rows["declared"][some] if len(controls) else rows["n_false_declarations"][some] > 0
    return LeaderboardRow(
        entry=entry,
        rank=0,
        last_rank=0,
        score=bootstrap_cells(rows.score[chosen], cells, clusters=units.clusters, strata=units.stratum),
        worst=bootstrap_worst_quarter(rows.score[chosen], cells, clusters=units.clusters, strata=units.stratum),
        normalised=UNDEFINED,
        success=rate_over_units(success, units, effect=effect),
        **{
            name: rate_over_units(error_m <= radius_m, units, effect=effect) if declares else UNDEFINED
            for name, radius_m in DECLARED_WITHIN_M.items()
        },
        lift=lift_with_interval(rows, chosen, controls),
        time_s=restricted_mean(
            rows.time_s[chosen], success, rows["time_limit_s"][chosen], clusters=units.clusters, cells=cells
        )
        if len(chosen)
        else UNDEFINED,
        spl=bootstrap_cells(np.nan_to_num(rows["spl"][chosen]), cells, clusters=units.clusters, strata=units.stratum),
        overhead=median_with_interval(overhead[np.isfinite(overhead)]),
        false_alarms=rate_over_units(is_false, sampling_units(rows, some)),
        decision_ms=median_with_interval(decision_ms[np.isfinite(decision_ms)]),
        n=len(chosen),
    )


def median_with_interval(values: Floats) -> Estimate:
    """Return the median of (n,) finite values with its bootstrap interval."""
    return bootstrap(values.size, lambda rows: np.median(values[rows], axis=-1), n_draws=1000)


def lift_with_interval(rows: TrialRows, chosen: Ints, controls: Ints) -> Estimate:
    """Return success less luck, over whole rooms or plumes; over single runs paired where every run has its control."""
    if not len(controls) or not len(chosen):
        return UNDEFINED
    both = np.concatenate([chosen, controls])
    units = sampling_units(rows, both)
    if units.level != "flights":
        return lift_over_units(rows["success"][both], rows.is_control[both], units)
    places = [{(rows["case"][i], rows["repetition"][i]): i for i in some} for some in (chosen, controls)]
    success = rows["success"]
    if places[0].keys() == places[1].keys():
        keys = sorted(places[0])
        return lift(*(success[[place[key] for key in keys]] for place in places), paired=True)
    return lift(success[chosen], success[controls], paired=False)


def _normalised(score: Estimate, walker: float | None, oracle: float | None) -> Estimate:
    if walker is None or oracle is None or not oracle > walker:
        return UNDEFINED
    low, value, high = ((x - walker) / (oracle - walker) for x in (score.low, score.value, score.high))
    return Estimate(value, low, high, score.n)


def build_matrix(rows: TrialRows, within: Flags, entries: Sequence[int], values: Floats) -> tuple[Floats, Ints]:
    """Return values by pair and entry, (n_units, n_entries), nan where one has not run, and a row of each unit.

    Args:
        within: (n,) which count; runs without gas do not.
        values: (n,) of all rows.
    """
    chosen = np.flatnonzero(within & ~rows.is_control & np.isin(rows.entry, entries))
    units, first, place = np.unique(rows.unit[chosen], return_index=True, return_inverse=True)
    column = {entry: k for k, entry in enumerate(entries)}
    matrix = np.full((len(units), len(entries)), np.nan)
    matrix[place, [column[entry] for entry in rows.entry[chosen].tolist()]] = values[chosen]
    return matrix, chosen[first]


def paired_rows(rows: TrialRows, within: Flags, a: int, b: int) -> tuple[Ints, Ints]:
    """Return the rows of two entries in the same cases and repetitions with gas, in the same order."""
    some = [np.flatnonzero(within & ~rows.is_control & (rows.entry == entry)) for entry in (a, b)]
    _, left, right = np.intersect1d(rows.unit[some[0]], rows.unit[some[1]], return_indices=True)
    return some[0][left], some[1][right]
