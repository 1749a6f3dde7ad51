"""HTML page of the report: everything in one file that needs nothing else."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup, escape

from gslcosim.base.untrusted_input import escape_json_text
from gslcosim_bench.report import number_formats
from gslcosim_bench.report.analysis import Analysis, ReportView
from gslcosim_bench.report.charts import RESPONSE_FIGURES, ChartAxis, ChartLine, LineChart, build_line_charts
from gslcosim_bench.report.conclusions import describe_conclusions, describe_units
from gslcosim_bench.report.curves import QUANTUM_M, RADII_M, PlanDrawing, encode_plan, limit_s
from gslcosim_bench.report.report_data import Floats, ReportEntry
from gslcosim_bench.report.tables import describe_provenance
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.store import TRIAL_COLUMNS

FOLDER = Path(__file__).parent / "page"
_FEW_ENTRIES, _SHOWN_AT_FIRST = 10, 8
_COLORS, _DASHES = 7, 4
MOST_LISTED = 40
_ABSCISSA_DIGITS, _MOST_POINTS = 6, 60


@dataclass(frozen=True)
class LineStyle:
    """Line style of an entry in all plots: number of its colour, -1 oracle, -2 walker; number of its dashes."""

    color: int
    dashes: int
    is_on: bool

    @property
    def css(self) -> str:
        """The colour as CSS knows it."""
        return {-1: "var(--lower)", -2: "var(--upper)"}.get(self.color, f"var(--e{self.color})")


def render_page(analysis: Analysis) -> str:
    """Return the page as HTML."""
    environment = build_environment([FOLDER])
    return environment.get_template("report.html").render(
        **build_page_values(analysis),
        css=Markup(read_page_file("report.css")),
        script=Markup(read_page_file("pieces.js") + read_page_file("report.js")),
    )


def build_environment(
    folders: Sequence[Path],
    *,
    entry_name: Callable[[ReportEntry], Markup] | None = None,
    case_name: Callable[[str, str], Markup] | None = None,
) -> jinja2.Environment:
    """Return the environment of templates of the report's style; all that they are given is escaped.

    Args:
        folders: Of templates; the first that has one counts.
        entry_name: Markup of an entry's name, for example a link; absent: the name.
        case_name: Markup of a case's name and, unless it is empty, one of its trials; absent: the name.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folders), autoescape=True, trim_blocks=True, lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    environment.filters |= {"duration": number_formats.format_duration}
    environment.globals |= {
        "entry_name": entry_name or (lambda entry: make_breakable(entry.name)),
        "case_name": case_name or (lambda case, _="": escape(case)),
        "sorts": True,
        "figure": _figure,
        "range": _range,
        "formats": number_formats,
        "isnan": math.isnan,
        "zip": zip,
    }
    return environment


def build_page_values(analysis: Analysis) -> dict[str, Any]:
    """Return what `report.html` shows, without its style and scripts."""
    looks = assign_line_styles(analysis)
    return {
        "analysis": analysis,
        "material": analysis.material,
        "manifest": analysis.material.manifest,
        "entries": analysis.material.entries,
        "looks": looks,
        "view": analysis.everything,
        "facts": describe_provenance(analysis),
        "conclusions": describe_conclusions(analysis, analysis.everything),
        "drawn": describe_units(analysis.material, analysis.everything),
        "columns": TRIAL_COLUMNS,
        "radii_m": RADII_M,
        "response_figures": RESPONSE_FIGURES,
        "most_listed": MOST_LISTED,
        "cases": None,
        "data": Markup(to_script_json(_data(analysis, looks))),
    }


def read_page_file(name: str) -> str:
    """Return the text of a style sheet or script of the page."""
    return (FOLDER / name).read_text(encoding="utf-8")


def assign_line_styles(analysis: Analysis) -> tuple[LineStyle, ...]:
    """Return the line style of each entry: colours in the order of the leaderboard, the plainest first."""
    entries = analysis.material.entries
    order = [row.entry for row in analysis.everything.standings]
    order += [i for i in range(len(entries)) if i not in order]
    colored = [i for i in order if not entries[i].anchor]
    many = len(entries) > _FEW_ENTRIES
    looks = {
        i: LineStyle(-1 if entries[i].anchor == "lower" else -2, 1, is_on=True) for i in order if entries[i].anchor
    }
    looks |= {
        i: LineStyle(k % _COLORS, k // _COLORS % _DASHES, is_on=not many or k < _SHOWN_AT_FIRST)
        for k, i in enumerate(colored)
    }
    return tuple(looks[i] for i in range(len(entries)))


def make_breakable(name: str) -> Markup:
    """Return a name as markup: a long one may go on in the next line after an underscore."""
    return Markup("_<wbr>").join(escape(part) for part in name.split("_"))


def to_script_json(value: Any) -> str:
    """Return a value as JSON in which nothing looks like markup, for a script element."""
    return escape_json_text(json.dumps(value, separators=(",", ":"), allow_nan=False), is_embedded=True)


# A cell of a table: figure, interval, and how many runs it stands on.
def _figure(estimate: Estimate, form: number_formats.Format, n: int | None = None) -> Markup:
    if math.isnan(estimate.value):
        return Markup('<td data-v=""><span class="none">{}</span></td>').format(number_formats.ABSENT)
    cell = Markup('<td data-v="{}" title="n = {}">{}<span class="ci">{}{}</span></td>')
    small = f" n {estimate.n}" if n is not None and estimate.n != n else ""
    v = f"{estimate.value:.6g}" if math.isfinite(estimate.value) else "1e300"
    return cell.format(
        v,
        estimate.n,
        number_formats.format_value(estimate, form),
        number_formats.format_interval(estimate, form),
        small,
    )


# A small picture of a score and its interval, from 0 to 1.
def _range(estimate: Estimate, look: LineStyle) -> Markup:
    if math.isnan(estimate.value):
        return Markup("")
    at = [4 + 60 * min(1.0, max(0.0, x)) for x in (estimate.low, estimate.value, estimate.high)]
    low, value, high = (f"{x:.1f}" for x in (at if not math.isnan(at[0]) else [at[1]] * 3))
    return Markup(
        '<svg width="68" height="14" viewBox="0 0 68 14" aria-hidden="true"><path class="axis" d="M4 12.5H64"/>'
        '<path d="M{}  6H{}" stroke="{}" stroke-width="3"/><circle cx="{}" cy="6" r="4" fill="{}"/></svg>'
    ).format(low, high, look.css, value, look.css)


def _data(analysis: Analysis, looks: Sequence[LineStyle]) -> dict[str, Any]:
    material, rows = analysis.material, analysis.material.rows
    return {
        "entries": [
            {
                "name": entry.name, "title": entry.name, "c": look.color, "d": look.dashes, "on": look.is_on,
                "command": material.command_of(i),
            }
            for i, (entry, look) in enumerate(zip(material.entries, looks, strict=True))
        ],
        "order": [row.entry for row in analysis.everything.standings],
        "limit": limit_s(rows),
        "quantum": QUANTUM_M,
        "views": [_view(view, limit_s(rows)) for view in analysis.views],
        "rooms": [_room(room) for room in analysis.rooms],
        "starts": [[s.room, s.entry, _number(s.x_m), _number(s.y_m), _to_list(s.success)] for s in analysis.starts],
        "tracks": [
            {
                "r": track.room, "e": int(rows.entry[track.row]), "s": int(rows["success"][track.row]),
                "o": rows["outcome"][track.row] or rows["status"][track.row], "t": _number(rows["end_s"][track.row]),
                "c": f"{rows['case'][track.row]}, repetition {rows['repetition'][track.row]}",
                "id": rows["trial"][track.row], "p": track.steps.ravel().tolist(),
            }
            for track in analysis.tracks
        ],
    }  # fmt: skip


def _view(view: ReportView, limit: float) -> dict[str, Any]:
    return {
        "key": view.key,
        "label": view.label,
        "scenarios": view.scenarios,
        "charts": {name: _chart(chart) for name, chart in build_line_charts(view, limit).items()},
        "times": [
            {
                "e": t.entry, "rmst": _to_list(t.restricted_s), "median": _to_list(t.median_s),
                "ert": _to_list(t.expected_s), "found": _to_list(t.found_s), "bins": t.bins.tolist(),
                "missed": t.n_missed, "n": t.n,
            }
            for t in view.times
        ],
        "pairs": {
            "order": [row.entry for row in view.standings],
            "cells": [
                [
                    p.a, p.b, p.verdict, _to_list(p.score), _to_list(p.success), _to_list(p.a_better), _number(p.p),
                    int(p.is_same),
                ]
                for p in view.pairs
            ],
        }
        if view.pairs
        else None,
    }  # fmt: skip


def _chart(chart: LineChart) -> dict[str, Any]:
    shared_x = chart.shared_x
    return {
        "title": chart.title, "x": _axis(chart.x), "y": _axis(chart.y), "step": chart.is_step,
        "diagonal": chart.has_diagonal, "points": chart.has_points, "joined": chart.is_joined,
        "at": None if shared_x is None else _list(shared_x, _ABSCISSA_DIGITS),
        "lines": [_line(line, chart) for line in chart.lines],
    }  # fmt: skip


# Lines with places of their own are thinned to what a page of bounded size can hold; points are few.
def _line(line: ChartLine, chart: LineChart) -> dict[str, Any]:
    has_own_x = chart.shared_x is None
    n_points = min(_MOST_POINTS, len(line.x)) if has_own_x and not chart.has_points else len(line.x)
    keep = np.unique(np.linspace(0, len(line.x) - 1, n_points).round().astype(int))
    digits = _ABSCISSA_DIGITS if chart.has_points else 3
    return {
        "e": line.entry, "label": line.label, "n": line.n, "v": _list(line.value[keep]),
        "x": _list(line.x[keep], digits) if has_own_x else None,
        "l": None if line.low is None else _list(line.low[keep]),
        "h": None if line.high is None else _list(line.high[keep]),
    }  # fmt: skip


def _axis(axis: ChartAxis) -> dict[str, Any]:
    return {
        "label": axis.label, "name": axis.name or axis.label, "min": _number(axis.low), "max": _number(axis.high),
        "format": axis.format, "log": axis.is_log, "ticks": axis.ticks,
        "default": None if axis.default is None else _number(axis.default, _ABSCISSA_DIGITS),
    }  # fmt: skip


def _room(room: PlanDrawing) -> dict[str, Any]:
    return {
        "scenario": room.scenario, "label": room.label, "origin": room.origin_m, "extent": room.extent_m,
        "box": room.box_m, "sources": room.sources_m, "ppm": _number(room.greatest_ppm),
        "height": None if room.height_m is None else _number(room.height_m),
        "shape": None if room.cells is None else room.cells.shape,
        "cells": None if room.cells is None else encode_plan(room.cells),
    }  # fmt: skip


def _to_list(estimate: Estimate) -> list[float | int | None]:
    return [_number(estimate.value), _number(estimate.low), _number(estimate.high), estimate.n]


def _list(values: Floats, digits: int = 3) -> list[float | int | None]:
    return [_number(value, digits) for value in values.tolist()]


def _number(value: float, digits: int = 4) -> float | int | None:
    if not math.isfinite(value):
        return None
    short = float(f"{value:.{digits}g}")
    return int(short) if short.is_integer() else short
