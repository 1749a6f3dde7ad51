"""How difficult each case is, and which flights failed and how."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim.benchmark.report.causes import Causes, causes_of, shortest_path_m
from gslcosim.benchmark.report.reading import Ints, Material
from gslcosim.benchmark.report.rooms import DrawnRoom
from gslcosim.benchmark.statistics.difficulty import fit_rasch, grades
from gslcosim.benchmark.statistics.estimates import UNDEFINED, Estimate
from gslcosim.benchmark.statistics.rates import wilson
from gslcosim.benchmark.statistics.special import two_sided_z
from gslcosim.benchmark.statistics.times import restricted_mean


@dataclass(frozen=True, kw_only=True)
class CaseGrade:
    """How difficult a case is.

    Attributes:
        grade: easy, medium or hard: thirds of the suite's cases; empty where nothing tells cases apart.
        difficulty: Of the Rasch model [logit], mean 0; higher is harder; the anchors that know the source left out.
        is_informative: Whether some flights succeeded and some did not.
        success: Share of all entries' flights, the oracle's left out.
        oracle_s: Restricted mean time of the oracle [s]; undefined without one.
        walker: Success of the random walker; undefined without one.
        contact: Share of flights that met gas.
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
    causes: Causes
    n: int


@dataclass(frozen=True, kw_only=True)
class FailureGroup:
    """Flights that ended alike without success.

    Attributes:
        status: flown, or why there is no result.
        outcome: Of the referee; empty without a result.
        rows: Which flights, in the order of the suite.
        by_entry: How many of each entry, most first.
    """

    status: str
    outcome: str
    rows: Ints
    by_entry: tuple[tuple[int, int], ...]


def case_grades(material: Material, rooms: Sequence[DrawnRoom]) -> tuple[CaseGrade, ...]:
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
    causes = causes_of(material, rooms, cells)
    found: list[CaseGrade] = []
    for k, cell in enumerate(cells.tolist()):
        some = np.flatnonzero((rows.cells == cell) & ~rows.is_control)
        d, n = float(fit.difficulty[k]), int(trials[k].sum())
        found.append(
            CaseGrade(
                case=str(rows["case"][some[0]]), family=str(rows["family"][some[0]]), grade=graded[k],
                difficulty=Estimate(d, d - half[k], d + half[k], n), is_informative=bool(fit.is_informative[k]),
                success=wilson(int(successes[k].sum()), n), oracle_s=_time_of(material, some, oracle),
                walker=_rate_of(material, some, walker), contact=_contact(material, some),
                shortest_m=shortest_path_m(material, some), causes=causes[k], n=n,
            )
        )  # fmt: skip
    return tuple(found)


def _counts(material: Material, cells: Ints, entries: Sequence[int]) -> tuple[Ints, Ints]:
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


def _time_of(material: Material, some: Ints, entry: int | None) -> Estimate:
    own = some[material.rows.entry[some] == entry] if entry is not None else some[:0]
    rows = material.rows
    return restricted_mean(rows.time_s[own], rows["success"][own], rows["time_limit_s"][own]) if own.size else UNDEFINED


def _rate_of(material: Material, some: Ints, entry: int | None) -> Estimate:
    own = some[material.rows.entry[some] == entry] if entry is not None else some[:0]
    return wilson(int(material.rows["success"][own].sum()), own.size)


def _contact(material: Material, some: Ints) -> Estimate:
    return wilson(int(np.isfinite(material.rows["first_contact_s"][some]).sum()), some.size)


def failure_groups(material: Material) -> tuple[FailureGroup, ...]:
    """Return the flights with gas that did not succeed, and all without a result, largest group first."""
    rows = material.rows
    failed = np.flatnonzero((~rows["success"] & ~rows.is_control) | (rows["status"] != "flown"))
    keys = list(zip(rows["status"][failed].tolist(), rows["outcome"][failed].tolist()))
    groups: list[FailureGroup] = []
    for (status, outcome), _ in Counter(keys).most_common():
        some = failed[[key == (status, outcome) for key in keys]]
        by_entry = tuple(Counter(rows.entry[some].tolist()).most_common())
        groups.append(FailureGroup(status=status, outcome=outcome, rows=some, by_entry=by_entry))
    return tuple(groups)
