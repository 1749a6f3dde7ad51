"""Line charts of the report, each described once: the page and the figures for papers draw the same."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from gslcosim_bench.report.analysis import ReportView
from gslcosim_bench.report.curves import LARGEST_ERROR_M, RADII_M, ChartLine
from gslcosim_bench.report.report_data import Floats
from gslcosim_bench.report.responses import ParameterResponse, ResponsePoint
from gslcosim_bench.statistics.roc import Roc

RESPONSE_FIGURES = ("success", "score", "time_s")
_MOST_LINES, _MOST_LETTERS = 12, 16
# From this ratio of largest to smallest on, values of a parameter are spread by their logarithms.
_LOG_FROM = 20.0


@dataclass(frozen=True, kw_only=True)
class ChartAxis:
    """One axis of a chart.

    Attributes:
        label: What is written beside it, with its unit.
        low: Where it begins.
        high: Where it ends.
        format: How values are read: `percent` stands for shares, which the vertical axis counts in hundredths.
        name: What precedes a value that is read from the page; empty: the label.
        is_log: Whether it is logarithmic; then it has ticks.
        ticks: Places with what is written there; without any, round numbers.
        default: Where the default of a parameter is marked.
    """

    label: str
    low: float
    high: float
    format: Literal["seconds", "percent", "metres", "times", "number"]
    name: str = ""
    is_log: bool = False
    ticks: tuple[tuple[float, str], ...] = ()
    default: float | None = None


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
        has_points: Whether values are points with intervals as bars.
        is_joined: Whether a line goes through its values.
    """

    title: str
    x: ChartAxis
    y: ChartAxis
    lines: tuple[ChartLine, ...]
    is_step: bool = False
    has_diagonal: bool = False
    has_points: bool = False
    is_joined: bool = True

    @property
    def shared_x(self) -> Floats | None:
        """The places of all lines, where they share them; otherwise None."""
        first = self.lines[0].x
        return first if all(line.x is first or np.array_equal(line.x, first) for line in self.lines) else None


def build_line_charts(view: ReportView, limit_s: float) -> Mapping[str, LineChart]:
    """Return the charts of a view that there are data for, in the order of the page.

    `success_over_time`, `profile`, `runtime` with `runtime_5` to `runtime_05` for each radius, `roc` and
    `localisation_roc`, `beliefs` and `belief_distance`, and `response_PARAMETER_FIGURE` for parameters that vary.

    Args:
        limit_s: The longest time limit [s].
    """
    time = ChartAxis(label="time [s]", name="by", low=0.0, high=limit_s, format="seconds")
    share = _share("found the source [%]")
    charts: dict[str, LineChart] = {}
    if view.curves:
        charts["success_over_time"] = LineChart(
            title="Share of trials that have found the source, over time",
            x=time, y=share, lines=view.curves, is_step=True,
        )  # fmt: skip
    if view.profiles:
        factors = view.profiles[0].x
        charts["profile"] = LineChart(
            title="Share of trials within a multiple of the oracle's time",
            x=ChartAxis(
                label="multiple of the oracle's time", name="within", low=float(factors[0]), high=float(factors[-1]),
                format="times", is_log=True, ticks=_log_ticks(float(factors[0]), float(factors[-1])),
            ),
            y=_share("of all cases [%]"), lines=view.profiles, is_step=True,
        )  # fmt: skip
    for radius, lines in view.runtimes.items():
        if lines:
            within = "5, 2, 1 and 0.5 m" if radius == "all" else f"{RADII_M[radius]:g} m"
            charts["runtime" if radius == "all" else f"runtime_{radius}"] = LineChart(
                title=f"Share of trials that had come within {within} of the source, over time",
                x=time, y=_share(f"within {within} [%]"), lines=lines, is_step=True,
            )  # fmt: skip
    if view.errors:
        charts["errors"] = LineChart(
            title="Share of trials declared within a distance of the source",
            x=ChartAxis(label="error of the declared place [m]", name="within", low=0.0, high=LARGEST_ERROR_M,
                        format="metres"),
            y=_share("declared so near [%]"), lines=view.errors, is_step=True,
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
        highs = (line.high for line in distances if line.high is not None)
        highest_m = max((float(np.nanmax(high, initial=0.0)) for high in highs), default=0.0)
        charts["beliefs"] = LineChart(
            title="Probability within the success radius over time", x=at,
            y=_share("probability within the radius [%]"), lines=view.beliefs["mass"],
        )  # fmt: skip
        charts["belief_distance"] = LineChart(
            title="Expected distance of the belief to the source over time", x=at,
            y=ChartAxis(label="distance [m]", low=0.0, high=max(1.0, highest_m), format="metres"),
            lines=distances,
        )  # fmt: skip
    for response in view.responses:
        for parameter in response.units:
            charts |= _response_charts(response, parameter, limit_s)
    return charts


# Settings that differ in this parameter alone are a line; where few do, as in a search, all are points.
def _response_charts(response: ParameterResponse, parameter: str, limit_s: float) -> dict[str, LineChart]:
    points = [point for point in response.points if point.values[parameter] is not None]
    if not points:
        return {}
    x, place = _parameter_axis(parameter, response, [point.values[parameter] for point in points])
    lines: dict[str, list[ResponsePoint]] = {}
    for point in points:
        others = [f"{name} {_word(value)}" for name, value in point.values.items() if name != parameter]
        lines.setdefault(", ".join(others) or response.title, []).append(point)
    is_joined = not x.ticks or x.is_log
    if len(lines) > _MOST_LINES or max(map(len, lines.values())) == 1:
        lines, is_joined = {response.title: points}, False
    for some in lines.values():
        some.sort(key=lambda point: place(point.values[parameter]))
    axes = {
        "success": _share("success [%]"),
        "score": ChartAxis(label="mean score", low=0.0, high=1.0, format="number"),
        "time_s": ChartAxis(label="restricted mean time [s]", low=0.0, high=limit_s, format="seconds"),
    }
    return {
        f"{response.key}_{parameter}_{figure}": LineChart(
            title=f"{response.title}: {axes[figure].label} over {parameter}", x=x, y=axes[figure], has_points=True,
            is_joined=is_joined,
            lines=tuple(
                ChartLine.of_estimates(
                    some[0].entry,
                    np.array([place(p.values[parameter]) for p in some]),
                    [getattr(p.figures, figure) for p in some],
                    sum(getattr(p.figures, figure).n for p in some),
                    label,
                )
                for label, some in lines.items()
            ),
        )
        for figure in RESPONSE_FIGURES
    }  # fmt: skip


# Numbers are placed to scale, other values evenly.
def _parameter_axis(
    parameter: str, response: ParameterResponse, values: Sequence[Any]
) -> tuple[ChartAxis, Callable[[Any], float]]:
    unit, default = response.units[parameter], response.defaults.get(parameter)
    label = parameter if unit == "1" else f"{parameter} [{unit}]"
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        words = list(dict.fromkeys(map(_word, values)))
        ticks = tuple((float(i), word[:_MOST_LETTERS]) for i, word in enumerate(words))
        axis = ChartAxis(label=label, name=parameter, low=-0.5, high=len(words) - 0.5, format="number", ticks=ticks)
        return axis, lambda value: float(words.index(_word(value)))
    low, high = float(min(values)), float(max(values))
    is_log = low > 0 and high >= _LOG_FROM * low
    edge = 0.04 * (high - low) or 0.5 * abs(high) or 1.0
    low, high = (low / 1.2, high * 1.2) if is_log else (low - edge, high + edge)
    axis = ChartAxis(
        label=label, name=parameter, low=low, high=high, format="number", is_log=is_log,
        ticks=_log_ticks(low, high) if is_log else (),
        default=float(default) if isinstance(default, int | float) and low <= default <= high else None,
    )  # fmt: skip
    return axis, float


def _log_ticks(low: float, high: float) -> tuple[tuple[float, str], ...]:
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = (1, 2, 5) if len(decades) <= 4 else (1,)
    places = (step * 10.0**decade for decade in decades for step in steps)
    return tuple((place, f"{place:g}") for place in places if 0.999 * low <= place <= 1.001 * high)


def _word(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else json.dumps(value).strip('"')


def _share(label: str) -> ChartAxis:
    return ChartAxis(label=label, low=0.0, high=1.0, format="percent")


# From the origin on.
def _roc(entry: int, curve: Roc) -> ChartLine:
    x, y = (np.concatenate([[0.0], part]) for part in (curve.false_positive, curve.true_positive))
    return ChartLine(entry=entry, x=x, value=y, n=curve.n_positive + curve.n_negative, area=curve.area)
