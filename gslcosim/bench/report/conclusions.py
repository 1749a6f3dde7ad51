"""Conclusions of a report in words: what its comparison of entries shows, for which rooms, and what it does not."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from gslcosim.bench.report.analysis import Analysis, ReportView, find_beaten
from gslcosim.bench.report.report_data import ReportData

# Names listed in a sentence; of more their number is given.
_MAX_LISTED = 6


@dataclass(frozen=True, kw_only=True)
class Conclusions:
    """Sentences on what a reader may conclude (`holds`) and may not (`limits`)."""

    holds: tuple[str, ...]
    limits: tuple[str, ...]


def describe_conclusions(analysis: Analysis, view: ReportView) -> Conclusions:
    """Return what the figures over some of the cases allow to say.

    Args:
        analysis: Of the results.
        view: All cases, or some of them.
    """
    if not view.pairs:
        return Conclusions(holds=(), limits=("There are no two entries with flights in common to compare.",))
    material = analysis.material
    return Conclusions(
        holds=(_describe_best(material, view), _describe_pairs(material, view), _describe_certainty(view)),
        limits=(_describe_scope(view), *_describe_open_pairs(view), *_describe_success(material, view)),
    )


# The anchor that knows the source is no method.
def _describe_best(material: ReportData, view: ReportView) -> str:
    oracle = material.index_of_anchor("lower")
    methods = [row.entry for row in view.standings if row.entry != oracle]
    beaten = {loser for entry in methods for loser in find_beaten(view, entry)}
    best = [material.entries[entry].name for entry in methods if entry not in beaten]
    if not best:
        return "Each entry is beaten by another: they flew different cases."
    if len(methods) == 1:
        return f"{best[0]} is the only entry that does not know the source."
    others = f" but {material.entries[oracle].name}, which knows the source," if oracle is not None else ""
    if len(best) == 1:
        rest = find_beaten(view, next(entry for entry in methods if entry not in beaten))
        n_beaten = len([entry for entry in rest if entry != oracle])
        return f"{best[0]} is beaten by no entry{others} and beats {n_beaten} of the {len(methods) - 1} others."
    return f"No entry{others} beats {_listed(best)}: each of them may be the best."


def _describe_pairs(material: ReportData, view: ReportView) -> str:
    points = f"{100 * material.smallest_difference:g} points of success"
    n, apart = len(view.pairs), sum(pair.verdict != 0 for pair in view.pairs)
    same = sum(pair.is_same for pair in view.pairs)
    return (
        f"Of {n} pairs of entries, {apart} {'is' if apart == 1 else 'are'} told apart by score, {same} "
        f"{'is' if same == 1 else 'are'} the same (not told apart, and less than {points} apart), and "
        f"{n - apart - same} {'is' if n - apart - same == 1 else 'are'} open."
    )


def _describe_certainty(view: ReportView) -> str:
    drawn = {
        "rooms": f"It draws whole rooms ({view.units.n_rooms}), each with all its plumes and flights.",
        "plumes": f"It draws whole plumes ({view.units.n_plumes}) within rooms, each with all its flights.",
        "flights": "It draws flights within cases.",
    }[view.units.level]
    return (
        "These statements follow from one comparison of all pairs and are all true together in 95 of 100 such "
        f"comparisons. {drawn}"
    )


def _describe_scope(view: ReportView) -> str:
    rooms, plumes = (_count(n, word) for n, word in ((view.units.n_rooms, "room"), (view.units.n_plumes, "plume")))
    if view.units.level == "rooms":
        return (
            f"They hold for rooms like these {view.units.n_rooms}, with these sensors, winds and time limits; of rooms "
            "of another kind they say nothing."
        )
    if view.units.level == "plumes":
        return (
            f"They hold in {rooms}, for other plumes there: rooms are too few to speak of others, for which at least "
            "six are needed."
        )
    return (
        f"They hold for {rooms} and {plumes}, with other noise: both are too few to speak of others, for which six "
        "at least are needed."
    )


def _describe_open_pairs(view: ReportView) -> list[str]:
    is_open = [pair for pair in view.pairs if not pair.verdict and not pair.is_same]
    if not is_open:
        return []
    reaches = [0.5 * (p.success.high - p.success.low) for p in is_open if not math.isnan(p.success.low)]
    about = (
        f": differences below some {100 * median(reaches):.0f} points of success were hidden there" if reaches else ""
    )
    return [f"An open pair is not shown to be equal, even where both have one rank{about}. More cases would tell."]


def _describe_success(material: ReportData, view: ReportView) -> list[str]:
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
    return found


def _count(n: int, word: str) -> str:
    return f"this one {word}" if n == 1 else f"these {n} {word}s"


def _listed(names: Sequence[str]) -> str:
    if len(names) > _MAX_LISTED:
        return f"{len(names)} entries ({', '.join(names[:_MAX_LISTED])}, …)"
    return " or ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
