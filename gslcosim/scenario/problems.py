"""Problems of a scenario with their places, and suggestions for unknown words."""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from gslcosim.base.errors import ScenarioError
from gslcosim.base.problems import Problem
from gslcosim.base.units_of_measure import UNIT_SUFFIXES, unit_suffix

_MAX_SHOWN = 400


@dataclass(frozen=True, kw_only=True)
class TextLocation:
    """Place where a value was written: a file with line and column, both from 1, or an option."""

    source: str
    line: int | None = None
    column: int | None = None

    def __str__(self) -> str:
        return self.source if self.line is None else f"{self.source}:{self.line}"


@dataclass(frozen=True, kw_only=True)
class LocatedProblem:
    """A problem with the place where its cause was written."""

    place: TextLocation
    problem: Problem

    def __str__(self) -> str:
        problem = self.problem
        where = f"{self.place}: {_shortened(problem.where)}" if problem.where else f"{self.place}"
        remedy = f" {_shortened(problem.remedy)}" if problem.remedy else ""
        text = f"{where}: expected {problem.expected}, was {_shortened(problem.found)}.{remedy}"
        return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)

    def as_fields(self) -> dict[str, str | int | None]:
        """Return all fields but the column, for JSON."""
        problem = self.problem
        return {
            "source": self.place.source,
            "line": self.place.line,
            "path": problem.where,
            "expected": problem.expected,
            "found": problem.found,
            "remedy": problem.remedy,
        }


@dataclass(frozen=True)
class TextLocations:
    """Places where the values of a scenario were written, by path; a value without a mark has that of its parent."""

    root: TextLocation
    places: dict[str, TextLocation] = field(default_factory=dict[str, TextLocation])

    def place_of(self, path: str) -> TextLocation:
        """Return the place of the value at a path, or of the nearest of its parents that has a mark."""
        while path:
            if path in self.places:
                return self.places[path]
            path = parent_path(path)
        return self.root


class ProblemsError(ScenarioError):
    """Something is impossible for the reasons in `problems`, whose places in a file are not known yet."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, problems)))


class InvalidScenarioError(ScenarioError):
    """A scenario has problems; the text lists all of them, one per line, in the order of the file."""

    def __init__(self, located: Sequence[LocatedProblem], *, name: str) -> None:
        self.problems = tuple(sorted(located, key=_reading_order))
        lines = [str(problem) for problem in self.problems]
        if len(lines) > 1:
            lines.insert(0, f"{name}: {len(lines)} problems")
        super().__init__("\n".join(lines))


def locate(problems: Iterable[Problem], marks: TextLocations) -> tuple[LocatedProblem, ...]:
    """Return problems with the places where their causes were written."""
    return tuple(LocatedProblem(place=marks.place_of(problem.where), problem=problem) for problem in problems)


def child_path(parent: str, key: str | int) -> str:
    """Return the path of a key or list index inside the value at `parent`."""
    if isinstance(key, int):
        return f"{parent}[{key}]"
    return f"{parent}.{key}" if parent else key


def parent_path(path: str) -> str:
    """Return the path of the value that holds the one at `path`; empty for a top-level key."""
    if path.endswith("]"):
        return path[: path.rindex("[")]
    return path.rpartition(".")[0]


# Keys and texts of a file may be of any length.
def _shortened(text: str) -> str:
    return text if len(text) <= _MAX_SHOWN else f"{text[: _MAX_SHOWN - 3]}..."


def _reading_order(located: LocatedProblem) -> tuple[bool, int, str, str]:
    line = located.place.line
    return (line is None, line or 0, located.problem.where, located.problem.expected)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that was most likely meant, or None if none is near."""
    by_folded = {name.lower().replace("-", "_"): name for name in known}
    folded = word.lower().replace("-", "_").replace(" ", "_")
    if folded in by_folded:
        return by_folded[folded]
    matches = difflib.get_close_matches(folded, by_folded, n=1, cutoff=0.6)
    return by_folded[matches[0]] if matches else None


def nearest_key(word: str, known: Iterable[str]) -> str | None:
    """Return the key that was most likely meant: `hold` and `hold_ms` both mean `hold_s`."""
    keys = list(known)
    stem = word.removesuffix(unit_suffix(word)).lower()
    for key in keys:
        if unit_suffix(key) and key.removesuffix(unit_suffix(key)) == stem:
            return key
    for key in keys:
        if stem and any(key == f"{stem}{ending}" for ending in UNIT_SUFFIXES):
            return key
    return nearest(word, keys)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `Did you mean x?` for the nearest known word, or an empty text."""
    match = nearest(word, known)
    return f"Did you mean {match}?" if match else ""
