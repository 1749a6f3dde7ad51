"""Line charts of the report, each described once: the page and the figures for papers draw the same."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gslcosim.bench.report.analysis import ReportView
from gslcosim.bench.report.curves import RADII_M, CurveWithBand
from gslcosim.bench.report.report_data import Floats
from gslcosim.bench.statistics.estimates import Estimate
from gslcosim.bench.statistics.roc import Roc


@dataclass(frozen=True, kw_only=True)
class ChartAxis:
    """One axis of a chart.

    Attributes:
        label: What is written beside it, with its unit.
        low: Where it begins.
        high: Where it ends.
        format: How values are read: `percent` stands for shares, which the vertical axis counts in hundredths.
        name: What precedes a value that is read from the page; empty: the label.
        is_log: Whether it is logarithmic.
    """

    label: str
    low: float
    high: float
    format: Literal["seconds", "percent", "metres", "times"]
    name: str = ""
    is_log: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class ChartLine:
    """The line of an entry: (m,) each, with the ends of its band where it has one; `area` is that below it."""

    entry: int
    x: Floats
    value: Floats
    low: Floats | None = None
    high: Floats | None = None
    n: int
    area: Estimate | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class LineChart:
    """Lines of entries over one axis.

    Attributes:
        title: What it shows, in a sentence.
        x: Horizontal axis.
        y: Vertical axis.
        lines: One for each entry that has data; not empty.
        is_step: Whether a value holds until the next.
        has_diagonal: Whether chance is drawn as the diagonal.
    """

    title: str
    x: ChartAxis
    y: ChartAxis
    lines: tuple[ChartLine, ...]
    is_step: bool = False
    has_diagonal: bool = False

    @property
    def shared_x(self) -> Floats | None:
        """The places of all lines, where they share them; otherwise None."""
        first = self.lines[0].x
        return first if all(line.x is first or np.array_equal(line.x, first) for line in self.lines) else None


def build_line_charts(view: ReportView, limit_s: float) -> Mapping[str, LineChart]:
    """Return the charts of a view that there are data for, in the order of the page.

    `success_over_time`, `profile`, `runtime` with `runtime_5` to `runtime_05` for each radius, `roc` and
    `localisation_roc`, `beliefs` and `belief_distance`.

    Args:
        view: What they show.
        limit_s: The longest time limit [s].
    """
    time = ChartAxis(label="time [s]", name="by", low=0.0, high=limit_s, format="seconds")
    share = _share("found the source [%]")
    charts: dict[str, LineChart] = {}
    if view.curves:
        charts["success_over_time"] = LineChart(
            title="Share of trials that have found the source, over time",
            x=time, y=share, lines=_lines(view.curves), is_step=True,
        )  # fmt: skip
    if view.profiles:
        factors = view.profiles[0].x
        charts["profile"] = LineChart(
            title="Share of trials within a multiple of the oracle's time",
            x=ChartAxis(
                label="multiple of the oracle's time", name="within", low=float(factors[0]), high=float(factors[-1]),
                format="times", is_log=True,
            ),
            y=_share("of all cases [%]"), lines=_lines(view.profiles), is_step=True,
        )  # fmt: skip
    for radius, lines in view.runtimes.items():
        if lines:
            within = "5, 2, 1 and 0.5 m" if radius == "all" else f"{RADII_M[radius]:g} m"
            charts["runtime" if radius == "all" else f"runtime_{radius}"] = LineChart(
                title=f"Share of trials that had come within {within} of the source, over time",
                x=time, y=_share(f"within {within} [%]"), lines=_lines(lines), is_step=True,
            )  # fmt: skip
    alarms = ChartAxis(
        label="false alarms: share of flights without gas", name="false alarms", low=0.0, high=1.0, format="percent"
    )
    curves = [(d.entry, d.curve, d.place_curve) for d in view.declarations if d.curve and d.place_curve]
    if curves:
        charts["roc"] = LineChart(
            title="ROC over declared confidence", x=alarms, y=_share("declared, gas present [%]"),
            lines=tuple(_roc(entry, curve) for entry, curve, _ in curves), has_diagonal=True,
        )  # fmt: skip
        charts["localisation_roc"] = LineChart(
            title="Localisation ROC over declared confidence", x=alarms, y=_share("declared within the radius [%]"),
            lines=tuple(_roc(entry, curve) for entry, _, curve in curves),
        )  # fmt: skip
    if view.beliefs.get("mass"):
        at = ChartAxis(label="time [s]", name="at", low=0.0, high=limit_s, format="seconds")
        distances = view.beliefs["distance"]
        highest_m = max((float(np.nanmax(line.high, initial=0.0)) for line in distances), default=0.0)
        charts["beliefs"] = LineChart(
            title="Probability within the success radius over time", x=at,
            y=_share("probability within the radius [%]"), lines=_lines(view.beliefs["mass"]),
        )  # fmt: skip
        charts["belief_distance"] = LineChart(
            title="Expected distance of the belief to the source over time", x=at,
            y=ChartAxis(label="distance [m]", low=0.0, high=max(1.0, highest_m), format="metres"),
            lines=_lines(distances),
        )  # fmt: skip
    return charts


def _share(label: str) -> ChartAxis:
    return ChartAxis(label=label, low=0.0, high=1.0, format="percent")


def _lines(curves: Sequence[CurveWithBand]) -> tuple[ChartLine, ...]:
    return tuple(ChartLine(entry=c.entry, x=c.x, value=c.value, low=c.low, high=c.high, n=c.n) for c in curves)


# From the origin on.
def _roc(entry: int, curve: Roc) -> ChartLine:
    x, y = (np.concatenate([[0.0], part]) for part in (curve.false_positive, curve.true_positive))
    return ChartLine(entry=entry, x=x, value=y, n=curve.n_positive + curve.n_negative, area=curve.area)
