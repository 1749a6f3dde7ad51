"""Conclusions of a report in words: what its comparison of entries shows, for which rooms, and what it does not."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from gslcosim_bench.report.analysis import Analysis, ReportView, find_beaten
from gslcosim_bench.report.report_data import ReportData

CONCLUDED, NOT_CONCLUDED = "What may be concluded", "What may not be concluded"
"""Headings of the two lists."""

# Names listed in a sentence; more are hinted at.
_MAX_LISTED = 6


@dataclass(frozen=True, kw_only=True)
class Conclusions:
    """Sentences on what a reader may conclude (`holds`) and may not (`limits`)."""

    holds: tuple[str, ...]
    limits: tuple[str, ...]


def describe_conclusions(analysis: Analysis, view: ReportView) -> Conclusions:
    """Return what the figures over some of the cases allow to say."""
    if not view.pairs:
        return Conclusions(holds=(), limits=("There are no two entries with flights in common to compare.",))
    material = analysis.material
    rows = material.rows
    found: list[str] = []
    if "source" in rows["success_of"].tolist():
        found.append(
            "Success is coming near the source, which needs no declaration: a method that flies past without noticing "
            "succeeds too."
        )
    numbers = {row.n for row in view.standings}
    if len(numbers) > 1:
        found.append("Not all entries flew all cases: pairs are compared over those that both flew.")
    return Conclusions(
        holds=(_describe_best(material, view), _describe_pairs(material, view), _describe_certainty(material, view)),
        limits=(_describe_scope(material, view), *_describe_open_pairs(view), *found),
    )


# The anchor that knows the source is no method.
def _describe_best(material: ReportData, view: ReportView) -> str:
    oracle = material.index_of_anchor("lower")
    methods = [row.entry for row in view.standings if row.entry != oracle]
    beaten = {loser for entry in methods for loser in find_beaten(view, entry)}
    best = [entry for entry in methods if entry not in beaten]
    names = [entry.name for entry in material.entries]
    if not best:
        return "Each method is beaten by another: they flew different cases."
    worse = [] if oracle is None else [entry for entry in find_beaten(view, oracle) if entry in best]
    if len(methods) == 1:
        said = f"{names[best[0]]} is the only entry that does not know the source."
    elif len(best) == 1:
        n_beaten = len([entry for entry in find_beaten(view, best[0]) if entry != oracle])
        said = f"{names[best[0]]} is beaten by no other method and beats {n_beaten} of the {len(methods) - 1} others."
    else:
        said = (
            f"{len(best)} entries are beaten by no other method: {_listed([names[entry] for entry in best])}; any of "
            "them may be the best."
        )
    if oracle is None or not worse:
        return said
    whom = "it" if len(best) == 1 else f"{len(worse)} of them ({_listed([names[entry] for entry in worse])})"
    return f"{said} The anchor {names[oracle]}, which knows the source, beats {whom}."


def _describe_pairs(material: ReportData, view: ReportView) -> str:
    alike = f"(not told apart, and less than {100 * material.smallest_difference:g} points of success apart)"
    n, apart = len(view.pairs), sum(pair.verdict != 0 for pair in view.pairs)
    same = sum(pair.is_same for pair in view.pairs)
    if n == 1:
        found = "told apart by score" if apart else f"equally successful {alike}" if same else "open"
        return f"The one pair of entries is {found}."
    return (
        f"Of {n} pairs of entries, {apart} {_is(apart)} told apart by score, {same} {_is(same)} equally successful "
        f"{alike}, and {n - apart - same} {_is(n - apart - same)} open."
    )


def _is(n: int) -> str:
    return "is" if n == 1 else "are"


def _describe_certainty(material: ReportData, view: ReportView) -> str:
    return (
        "These statements follow from one comparison of all pairs and are all true together in 95 of 100 such "
        f"comparisons. It draws {describe_units(material, view)}."
    )


def describe_units(material: ReportData, view: ReportView) -> str:
    """Return what intervals of a view draw, in words: whole rooms, whole plumes or flights, and within what."""
    units, within = view.units, _find_stratum(material, view)
    place = f"within {within}" if within else "of all cases together"
    if units.level == "rooms":
        return f"whole rooms ({units.n_rooms}), each with all its plumes and flights"
    if units.level == "plumes":
        return f"whole plumes ({units.n_plumes}) {place}, each with all its flights"
    return f"single flights {place}"


# Strata are nested, so their number tells which they are; none: all units are drawn together.
def _find_stratum(material: ReportData, view: ReportView) -> str:
    rows, units = material.rows, view.units
    if units.stratum is None:
        return ""
    flown = ~rows.is_control & np.isin(rows["scenario"], view.scenarios)
    numbers = {
        "cases": np.unique(rows.cells[flown]).size,
        "plumes": units.n_plumes,
        "rooms": units.n_rooms,
    }
    kinds = ("rooms",) if units.level == "plumes" else tuple(numbers)
    n_strata = np.unique(units.stratum).size
    return next((kind for kind in kinds if numbers[kind] == n_strata), kinds[-1])


def _describe_scope(material: ReportData, view: ReportView) -> str:
    rooms, plumes = (_count(n, word) for n, word in ((view.units.n_rooms, "room"), (view.units.n_plumes, "plume")))
    if view.units.level == "rooms":
        return (
            f"The conclusions hold for rooms like these {view.units.n_rooms}, with these sensors, winds and time "
            "limits; of rooms of another kind they say nothing."
        )
    if view.units.level == "plumes":
        return (
            f"The conclusions hold in {rooms}, for other plumes there: rooms are too few to speak of others, for which "
            "at least six are needed."
        )
    others = {
        "cases": "for other noise in the same cases",
        "plumes": "for other flights like these in the same gas",
        "rooms": "for other flights like these in the same air",
        "": "for other flights like these",
    }[_find_stratum(material, view)]
    return (
        f"The conclusions hold for {rooms} and {plumes}, {others}: rooms and plumes are too few to speak of others, "
        "for which at least six are needed."
    )


# An interval that ends at the largest possible difference reaches as far on its other side as it would there.
def _describe_open_pairs(view: ReportView) -> list[str]:
    is_open = [pair.score for pair in view.pairs if not pair.verdict and not pair.is_same]
    if not is_open:
        return []
    reaches = [max(d.high - d.value, d.value - d.low) for d in is_open if not math.isnan(d.low)]
    about = (
        f": their intervals reach some {median(reaches):.2f} of score to each side, so smaller differences stayed "
        "hidden"
        if reaches
        else ""
    )
    return [f"Open pairs are not shown to be equal, even where both have one rank{about}. More cases would tell."]


def _count(n: int, word: str) -> str:
    return f"this one {word}" if n == 1 else f"these {n} {word}s"


def _listed(names: Sequence[str]) -> str:
    if len(names) > _MAX_LISTED:
        return f"{', '.join(names[:_MAX_LISTED])}, …"
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
