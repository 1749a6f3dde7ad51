"""Results of cases: figures of ours beside their goals and anchors, each with an interval, and drawings."""

import importlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from gslcosim_bench.statistics.estimates import Estimate, bootstrap
from gslcosim_validation.readers.folder import MeasuredData
from gslcosim_validation.release_pairs import ReleasePairs

Effort = Literal["quick", "full"]
# Receives the progress: a text, and the fraction done or None.
Progress = Callable[[str, float | None], None]
# A text, or texts by what they depend on; see the head of `cases.yaml`.
Text = str | Mapping[str, str]


@dataclass(frozen=True)
class Goal:
    """Goal of a figure: not less than `low`, not more than `high`; `text` gives it in words and symbols."""

    low: float
    high: float
    text: str

    @classmethod
    def parse(cls, text: str) -> "Goal":
        """Return the goal of a text: `≥ 0.5`, `≥ 7 of 8`, a share `≥ 16/18 of 9`, `≤ 3`, `0.5 to 2`, `1 ± 20 %`."""
        if text.startswith("≥ "):
            low, _, n = text.removeprefix("≥ ").partition(" of ")
            if "/" in low:
                low = str(math.ceil(Fraction(low) * int(n)))
            return cls(float(low), math.inf, f"≥ {low} of {n}" if n else text)
        if text.startswith("≤ "):
            return cls(-math.inf, float(text.removeprefix("≤ ")), text)
        middle, is_band, width = text.partition(" ± ")
        if is_band:
            centre = float(Fraction(middle))
            half = float(width.removesuffix(" %"))
            half *= abs(centre) / 100.0 if width.endswith(" %") else 1.0
            return cls(centre - half, centre + half, text)
        low, _, high = text.partition(" to ")
        return cls(float(low), float(high), text)

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
    """Results of a case: rows, drawings, remarks for the page (one paragraph each), and releases at instruments."""

    rows: Sequence[Comparison]
    drawings: Sequence[Drawing] = ()
    remarks: Sequence[str] = ()
    pairs: Sequence[ReleasePairs] = ()


class Figure:
    """One of our figures, for a row of the table of cases.

    Attributes:
        row: Name of the row.
        ours: The figure with its interval.
        of: What it is of, where texts of the row depend on that.
        words: Values of what stands in braces in the row.
    """

    def __init__(self, row: str, ours: Estimate, of: str = "", **words: object) -> None:
        """Make a figure."""
        self.row, self.ours, self.of, self.words = row, ours, of, words


@dataclass(frozen=True, kw_only=True)
class Findings:
    """Findings of a case about one measured set.

    Attributes:
        figures: In the order of the page.
        drawings: By the names that the table of cases has: each gets an empty figure of matplotlib and fills it.
        remarks: Words of the remarks that are shown, by their names; None: all, none of which has any.
        pairs: Releases at the instruments of the set, from which the errors that a run may have are computed.
    """

    figures: Sequence[Figure] = ()
    drawings: Mapping[str, Callable[[Any], None]] = field(default_factory=dict[str, Callable[[Any], None]])
    remarks: Mapping[str, Mapping[str, object]] | None = None
    pairs: Sequence[ReleasePairs] = ()


@dataclass(frozen=True, kw_only=True)
class Case:
    """One comparison with measurements, or with published figures: a block of `cases.yaml`, which describes the fields.

    Its module has `measure(content, effort, progress)`, which returns `Findings`. The content is a set as its reader
    returns it, or the values of a published entry. With `from_pairs` it is `measure(pairs)`, of the releases at
    instruments that all other cases have left. `quick` is for tests and a first look: coarser, fewer cases, the
    same code.
    """

    name: str
    title: str
    what: str
    rows: Mapping[str, Mapping[str, Text]]
    drawings: Mapping[str, Mapping[str, Any]]
    formats: Sequence[str] = ()
    published: str = ""
    set: str = ""
    from_pairs: bool = False
    reasons: Mapping[str, str] = field(default_factory=dict[str, str])
    remarks: Mapping[str, Text] = field(default_factory=dict[str, Text])

    def can_run_on(self, data: MeasuredData) -> bool:
        """Return whether a folder has what the case needs."""
        return any(data.of_format(name) for name in self.formats) or bool(self.published and data.has_published)

    def run(self, data: MeasuredData, effort: Effort, progress: Progress = lambda text, fraction: None) -> CaseResult:
        """Return the figures of a folder of measured data beside their goals and anchors."""
        if self.published:
            found = self._module.measure(data.published(self.published), effort, progress)
            return self._compare(found, self.set, "")
        results: list[CaseResult] = []
        for each in (each for name in self.formats for each in data.of_format(name)):
            progress(f"{each.name}: reading", None)

            def tell(text: str, fraction: float | None, name: str = each.name) -> None:
                progress(f"{name}: {text}", fraction)

            found = self._module.measure(data.read(each, object), effort, tell)
            results.append(self._compare(found, each.name, each.campaign))
        return CaseResult(
            rows=[row for result in results for row in result.rows],
            drawings=[drawing for result in results for drawing in result.drawings],
            remarks=list(dict.fromkeys(remark for result in results for remark in result.remarks)),
            pairs=[pairs for result in results for pairs in result.pairs],
        )

    def summarise(self, pairs: Sequence[ReleasePairs]) -> CaseResult:
        """Return the figures of a case that is `from_pairs`, from those of all other cases."""
        return self._compare(self._module.measure(pairs), self.set, "")

    @property
    def _module(self) -> Any:
        return importlib.import_module(f"gslcosim_validation.cases.{self.name.replace('-', '_')}")

    def _compare(self, found: Findings, set_name: str, campaign: str) -> CaseResult:
        stem, begin = ("", "") if self.set else (f"{set_name}-", f"{set_name}: ")
        remarks = {name: {} for name in self.remarks} if found.remarks is None else found.remarks
        texts = (choose_text(self.remarks[name], campaign).format(set=set_name, **remarks[name]) for name in remarks)
        return CaseResult(
            rows=[self._row(figure, set_name, campaign) for figure in found.figures],
            drawings=[
                Drawing(
                    name=f"{stem}{name}",
                    caption=f"{begin}{self.drawings[name]['caption']}",
                    draw=draw,
                    aspect=self.drawings[name]["aspect"],
                )
                for name, draw in found.drawings.items()
            ],
            remarks=[text for text in texts if text],
            pairs=[{**pairs, "measured_set": set_name} for pairs in found.pairs],
        )

    def _row(self, figure: Figure, set_name: str, campaign: str) -> Comparison:
        row = self.rows[figure.row]

        def fill(name: str) -> str:
            return choose_text(row.get(name, ""), campaign, figure.of).format(n=figure.ours.n, **figure.words)

        goal, reason = fill("goal"), choose_text(row.get("if_missed", ""), campaign, figure.of)
        return Comparison(
            measured_set=set_name,
            quantity=fill("quantity"),
            ours=figure.ours,
            unit=fill("unit"),
            anchor=fill("anchor"),
            goal=Goal.parse(goal) if goal else None,
            if_missed=self.reasons.get(reason, reason),
        )


def choose_text(text: Text, campaign: str, of: str = "") -> str:
    """Return the text for a campaign and for what a figure is of; empty where there is none."""
    if isinstance(text, str):
        return text
    keys = (f"{campaign} {of}", of, campaign, "others")
    return next((text[key] for key in keys if key in text), "")


def median_estimate(values: Iterable[float]) -> Estimate:
    """Return the median of the finite values with its bootstrap interval; undefined without any."""
    finite = np.array([value for value in values if math.isfinite(value)])
    return bootstrap(len(finite), lambda rows: np.median(finite[rows], axis=-1))


def plain_estimate(value: float, n: int = 1) -> Estimate:
    """Return a figure without an interval, such as a count or what one deterministic run gives."""
    return Estimate(float(value), math.nan, math.nan, n)
