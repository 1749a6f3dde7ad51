"""Results of cases: figures of ours beside their goals and anchors, each with an interval, and drawings."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from gslcosim_bench.statistics.estimates import Estimate, bootstrap
from gslcosim_validation.readers.folder import MeasuredData

Effort = Literal["quick", "full"]


@dataclass(frozen=True)
class Goal:
    """Goal of a figure: not less than `low`, not more than `high`; `text` gives it in words and symbols."""

    low: float
    high: float
    text: str

    @classmethod
    def at_least(cls, low: float, *, of: int | None = None) -> "Goal":
        """Return a goal with a least value; `of` how many there are, for counts."""
        return cls(low, math.inf, f"≥ {low:g}" + (f" of {of}" if of is not None else ""))

    @classmethod
    def at_most(cls, high: float) -> "Goal":
        """Return a goal with a greatest value."""
        return cls(-math.inf, high, f"≤ {high:g}")

    @classmethod
    def between(cls, low: float, high: float) -> "Goal":
        """Return a goal with both."""
        return cls(low, high, f"{low:g} to {high:g}")

    def is_met(self, value: float) -> bool:
        """Return whether a value reaches the goal."""
        return bool(self.low <= value <= self.high)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One row of the table.

    Attributes:
        measured_set: Name of the set, or of the published figures.
        quantity: What is compared, in words.
        ours: Our figure with its interval; nan ends where none can be given.
        unit: Of the figure; empty for none.
        anchor: Figure of others, or the measured one.
        goal: What is to be reached; None: for information.
        if_missed: Why the goal is missed and what is left to do, a paragraph; needed where it is.
    """

    measured_set: str
    quantity: str
    ours: Estimate
    unit: str = ""
    anchor: str = ""
    goal: Goal | None = None
    if_missed: str = ""

    @property
    def is_met(self) -> bool | None:
        """True if the value reaches the goal; None where there is no goal, or no value to judge."""
        return None if self.goal is None or math.isnan(self.ours.value) else self.goal.is_met(self.ours.value)


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """A figure of the page: the end of its file's name, a caption, and what draws it.

    `draw` gets an empty figure of matplotlib, two columns of a paper wide, and fills it; `aspect` is height by width.
    """

    name: str
    caption: str
    draw: Callable[[Any], None]
    aspect: float = 0.4


@dataclass(frozen=True, kw_only=True)
class CaseResult:
    """Results of a case: rows, drawings, and remarks for the page (one paragraph each)."""

    rows: Sequence[Comparison]
    drawings: Sequence[Drawing] = ()
    remarks: Sequence[str] = ()


# Receives the progress: a text, and the fraction done or None.
Progress = Callable[[str, float | None], None]


def ignore_progress(text: str, fraction: float | None) -> None:
    """Discard progress."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One comparison with measurements, or with published figures.

    Attributes:
        name: Of the command line.
        title: Heading on the page.
        what: What of ours is compared with what, in a sentence or two, for the page.
        formats: Formats of measured data, of which a folder needs one at least; empty: none is needed.
        needs_published: Whether it needs `published.json`.
        run: From the data, the effort and a receiver of progress to the result. `quick` is for tests and a
            first look: coarser, fewer cases, the same code.
    """

    name: str
    title: str
    what: str
    run: Callable[[MeasuredData, Effort, Progress], CaseResult]
    formats: tuple[str, ...] = ()
    needs_published: bool = False

    def can_run_on(self, data: MeasuredData) -> bool:
        """Return whether a folder has what the case needs."""
        has_format = not self.formats or any(data.of_format(name) for name in self.formats)
        return has_format and (data.has_published or not self.needs_published)


def median_estimate(values: Iterable[float]) -> Estimate:
    """Return the median of the finite values with its bootstrap interval; undefined without any."""
    finite = np.array([value for value in values if math.isfinite(value)])
    return bootstrap(len(finite), lambda rows: np.median(finite[rows], axis=-1))


def plain_estimate(value: float, n: int = 1) -> Estimate:
    """Return a figure without an interval, such as a count or what one deterministic run gives."""
    return Estimate(float(value), math.nan, math.nan, n)
