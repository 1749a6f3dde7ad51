"""HTML page of the report: everything in one file that needs nothing else."""

import base64
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup, escape

from gslcosim.base.untrusted_input import escape_json_text
from gslcosim_bench.report import number_formats
from gslcosim_bench.report.analysis import Analysis
from gslcosim_bench.report.charts import RESPONSE_FIGURES, LineChart, build_line_charts
from gslcosim_bench.report.conclusions import describe_conclusions, describe_units
from gslcosim_bench.report.curves import RADII_M, limit_s
from gslcosim_bench.report.plans import PlanDrawing
from gslcosim_bench.report.report_data import ReportData, ReportEntry
from gslcosim_bench.report.tables import describe_provenance
from gslcosim_bench.report.templates import build_environment
from gslcosim_bench.report.tracks import QUANTA
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.store import TRIAL_COLUMNS

FOLDER = Path(__file__).parent / "page"
_FEW_ENTRIES, _SHOWN_AT_FIRST = 10, 8
_COLORS, _DASHES = 7, 4
MOST_LISTED = 40
_MOST_POINTS = 60


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
    environment = build_page_environment([FOLDER])
    return environment.get_template("report.html").render(
        **build_page_values(analysis),
        css=Markup(read_page_file("report.css")),
        script=Markup(read_page_file("pieces.js") + read_page_file("report.js")),
    )


def build_page_environment(
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
    environment = build_environment(folders)
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


def describe_entry(material: ReportData, entry: int, look: LineStyle) -> dict[str, Any]:
    """Return an entry as scripts read it: its name, its look, and the beginning of the command that repeats a run."""
    return {"name": material.entries[entry].name, **asdict(look), "command": material.command_of(entry)}


def describe_room(room: PlanDrawing) -> dict[str, Any]:
    """Return the fields of a room for scripts; the caller adds the address of its picture (`href`)."""
    picture, plan = room.picture, room.plan
    return {
        "scenario": room.scenario,
        "label": room.label,
        "box_m": to_plain(room.box_m),
        "sources_m": to_plain(room.sources_m),
        "height_m": to_plain(plan and plan.height_m),
        "greatest_ppm": to_plain(picture.greatest_ppm if picture else 0.0),
        "picture": picture and {"origin_m": to_plain(picture.origin_m), "extent_m": to_plain(picture.extent_m)},
    }


def to_plain(value: Any, digits: int = 6) -> Any:
    """Return a value as JSON has it: fields of dataclasses by name, an estimate as a list, null for what is undefined.

    Args:
        digits: Of numbers.
    """
    if isinstance(value, np.ndarray):
        return to_plain(value.tolist(), digits)
    if isinstance(value, float | np.floating):
        short = float(f"{value:.{digits}g}")
        return None if not math.isfinite(value) else int(short) if short.is_integer() else short
    if isinstance(value, Estimate):
        return to_plain([value.value, value.low, value.high, value.n], 4)
    if is_dataclass(value):
        return {field.name: to_plain(getattr(value, field.name), digits) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: to_plain(each, digits) for key, each in value.items()}
    return [to_plain(each, digits) for each in value] if isinstance(value, list | tuple) else value


def _data(analysis: Analysis, looks: Sequence[LineStyle]) -> dict[str, Any]:
    material, rows = analysis.material, analysis.material.rows
    return {
        "entries": [describe_entry(material, i, look) for i, look in enumerate(looks)],
        "order": [row.entry for row in analysis.everything.standings],
        "limit": limit_s(rows),
        "quanta": QUANTA,
        "views": [
            {
                "label": view.label,
                "scenarios": view.scenarios,
                "charts": {name: _chart(chart) for name, chart in build_line_charts(view, limit_s(rows)).items()},
                "times": to_plain(view.times),
                "pairs": None
                if not view.pairs
                else {"order": [row.entry for row in view.standings], "cells": to_plain(view.pairs)},
            }
            for view in analysis.views
        ],
        "rooms": [_embed_picture(room, describe_room(room)) for room in analysis.rooms],
        "starts": to_plain(analysis.starts),
        "tracks": [
            {
                "room": track.room, "entry": int(rows.entry[track.row]), "found": bool(rows["success"][track.row]),
                "outcome": rows["outcome"][track.row] or rows["status"][track.row],
                "end_s": to_plain(rows["end_s"][track.row]), "packed": track.packed, "id": rows["trial"][track.row],
                "case": f"{rows['case'][track.row]}, repetition {rows['repetition'][track.row]}",
            }
            for track in analysis.tracks
        ],
    }  # fmt: skip


def _embed_picture(room: PlanDrawing, described: dict[str, Any]) -> dict[str, Any]:
    if room.picture is not None:
        described["picture"]["href"] = f"data:image/png;base64,{base64.b64encode(room.picture.to_png()).decode()}"
    return described


# Places that all lines share stand once; lines with places of their own are thinned to what a page can hold.
def _chart(chart: LineChart) -> dict[str, Any]:
    shared_x, lines = chart.shared_x, []
    for line in chart.lines:
        n = len(line.x) if shared_x is not None or chart.has_points else min(_MOST_POINTS, len(line.x))
        keep = np.unique(np.linspace(0, len(line.x) - 1, n).round().astype(int))
        ends = {"value": line.value, "low": line.low, "high": line.high}
        values = {name: None if part is None else part[keep] for name, part in ends.items()}
        x = None if shared_x is not None else to_plain(line.x[keep])
        lines.append({"entry": line.entry, "label": line.label, "n": line.n, "x": x, **to_plain(values, 3)})
    return to_plain(replace(chart, lines=())) | {"shared_x": to_plain(shared_x), "lines": lines}
