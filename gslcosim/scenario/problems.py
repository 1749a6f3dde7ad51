"""Problems of a scenario with their places, and the one error that carries all of them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from gslcosim.base.errors import ScenarioError

_MAX_SHOWN = 400


class ProblemLike(Protocol):
    """Problem that a check reports: the place in the scenario, what it expected and found, and the remedy."""

    @property
    def path(self) -> str:
        """The place, for example `gas.sources[0].position_m`."""
        ...

    @property
    def expected(self) -> str:
        """Allowed values there, as the rest of a sentence."""
        ...

    @property
    def found(self) -> str:
        """Value found there."""
        ...

    @property
    def remedy(self) -> str:
        """Remedy, a whole sentence, or empty."""
        ...


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One thing that is wrong with a scenario; `path` is its place, for example `agents[0].vehicle.start_m`."""

    path: str
    expected: str
    found: str
    remedy: str = ""


@dataclass(frozen=True, kw_only=True)
class TextLocation:
    """Place where a value was written: a file with line and column, both from 1, or the option that gave it."""

    source: str
    line: int | None = None
    column: int | None = None

    def __str__(self) -> str:
        return self.source if self.line is None else f"{self.source}:{self.line}"


@dataclass(frozen=True, kw_only=True)
class LocatedProblem:
    """A problem with the place where its cause was written."""

    place: TextLocation
    problem: ProblemLike

    def __str__(self) -> str:
        problem = self.problem
        where = f"{self.place}: {_shortened(problem.path)}" if problem.path else f"{self.place}"
        remedy = f" {_shortened(problem.remedy)}" if problem.remedy else ""
        return _in_one_line(f"{where}: expected {problem.expected}, was {_shortened(problem.found)}.{remedy}")

    def as_fields(self) -> dict[str, str | int | None]:
        """Return everything but the column, as JSON can carry it."""
        problem = self.problem
        return {
            "source": self.place.source,
            "line": self.place.line,
            "path": problem.path,
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
        """Return where the value at a path, or the nearest of its parents that has a mark, was written."""
        while path:
            if path in self.places:
                return self.places[path]
            path = parent_path(path)
        return self.root


class InvalidScenarioError(ScenarioError):
    """A scenario has problems; the text lists all of them, one a line, in the order of the file."""

    def __init__(self, located: Sequence[LocatedProblem], *, name: str) -> None:
        self.problems = tuple(sorted(located, key=_reading_order))
        lines = [str(problem) for problem in self.problems]
        if len(lines) > 1:
            lines.insert(0, f"{name}: {len(lines)} problems")
        super().__init__("\n".join(lines))


def locate(problems: Iterable[ProblemLike], marks: TextLocations) -> tuple[LocatedProblem, ...]:
    """Return problems with the places where their causes were written."""
    return tuple(LocatedProblem(place=marks.place_of(problem.path), problem=problem) for problem in problems)


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


def _in_one_line(text: str) -> str:
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _reading_order(located: LocatedProblem) -> tuple[bool, int, str, str]:
    line = located.place.line
    return (line is None, line or 0, located.problem.path, located.problem.expected)
