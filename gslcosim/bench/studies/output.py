"""Sweeps and tunings as JSON and CSV, parameters as YAML to paste, and response curves as SVG."""

import csv
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any

from gslcosim.bench.statistics.estimates import Estimate
from gslcosim.bench.store import write_at_once
from gslcosim.bench.studies.sweep import SettingFigures, SweepPoint, SweepResult
from gslcosim.bench.studies.tuning import BATCH, EvaluatedSetting, TuningResult

SWEEP_SCHEMA, TUNING_SCHEMA = "gslcosim/sweep/1", "gslcosim/tuning/1"


def sweep_to_json(sweep: SweepResult) -> dict[str, Any]:
    """Return a sweep as JSON has it: equal for equal runs."""
    return {
        "schema": SWEEP_SCHEMA,
        "suite": sweep.suite,
        "entry": sweep.entry,
        "seed": sweep.seed,
        "varied": {name: [_plain(value) for value in values] for name, values in sweep.varied.items()},
        "units": dict(sweep.units),
        "reference": sweep.reference.name,
        "is_reference_default": sweep.is_reference_default,
        "points": [
            {
                "entry": point.setting.name,
                "parameters": _values(point.setting.parameters),
                **_figure_fields(point.figures),
                "difference": _estimate_fields(point.difference),
            }
            for point in sweep.points
        ],
    }


def sweep_to_csv(sweep: SweepResult) -> str:
    """Return a line for each setting of a sweep: its values, and figures with the ends of their intervals."""
    names = list(sweep.varied)
    rows = (
        [
            point.setting.name,
            *(_cell(point.setting.parameters[name]) for name in names),
            *_figure_cells(point.figures),
            *_ends(point.difference),
        ]
        for point in sweep.points
    )
    return _csv(["entry", *names, *_FIGURE_HEADS, *_heads("difference")], rows)


def tuning_to_json(tuning: TuningResult) -> dict[str, Any]:
    """Return a tuning as JSON has it: equal for equal calls, whatever the workers and interruptions."""
    budget, checked = tuning.budget, tuning.validation
    return {
        "schema": TUNING_SCHEMA,
        "suite": tuning.suite,
        "entry": tuning.entry,
        "seed": tuning.seed,
        "sampler": {"name": "TPE", "batch": BATCH},
        "ranges": [
            {"parameter": r.name, "low": r.low, "high": r.high, "whole": r.is_whole, "log": r.is_log}
            for r in tuning.ranges
        ],
        "budget": {
            "flights": budget.flights,
            "per_setting": budget.per_setting,
            "per_validation": budget.per_validation,
            "search": tuning.n_search,
            "validation": tuning.n_validation,
            "used": tuning.n_search + tuning.n_validation,
        },
        "n_asked": tuning.n_asked,
        "training_seed": tuning.training_seed,
        "best": _tried_fields(tuning.best) | {"difference": _estimate_fields(tuning.difference)},
        "default": _tried_fields(tuning.default),
        "validation": None
        if checked is None
        else {
            "seed": checked.seed,
            "best": _figure_fields(checked.best),
            "default": _figure_fields(checked.default),
            "difference": _estimate_fields(checked.difference),
            "p": checked.p,
        },
        "parameters": parameters_to_paste(tuning),
        "settings": [_tried_fields(tried) for tried in tuning.tried],
    }


def tuning_to_csv(tuning: TuningResult) -> str:
    """Return a line for each setting that was run in training; the default's values are those it was entered with."""
    names = [each.name for each in tuning.ranges]
    rows = (
        [
            tried.setting.name,
            *(_cell(tried.setting.parameters.get(name, tuning.parameters.get(name, ""))) for name in names),
            *_figure_cells(tried.figures),
        ]
        for tried in tuning.tried
    )
    return _csv(["setting", *names, *_FIGURE_HEADS], rows)


def parameters_to_paste(tuning: TuningResult) -> dict[str, Any]:
    """Return the parameters of the best setting, with those that the entry had and that were not searched."""
    return _values({**tuning.parameters, **tuning.best.setting.parameters})


def to_inline_yaml(parameters: Mapping[str, Any]) -> str:
    """Return parameters as a YAML map in one line."""
    return "{" + ", ".join(f"{name}: {json.dumps(_plain(value))}" for name, value in parameters.items()) + "}"


def write_text(path: Path, text: str) -> None:
    """Write a file of the results in one go."""
    write_at_once(path, lambda beside: beside.write_text(text, encoding="utf-8"))


def write_fields(path: Path, fields: Mapping[str, Any]) -> None:
    """Write a JSON file of the results in one go."""
    write_text(path, json.dumps(fields, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def _tried_fields(tried: EvaluatedSetting) -> dict[str, Any]:
    return {
        "setting": tried.setting.name,
        "parameters": _values(tried.setting.parameters),
        **_figure_fields(tried.figures),
    }


def _figure_fields(figures: SettingFigures) -> dict[str, Any]:
    return {
        "n": figures.n,
        "n_without_result": figures.n_without_result,
        "success": _estimate_fields(figures.success),
        "score": _estimate_fields(figures.score),
        "time_s": _estimate_fields(figures.time_s),
    }


# JSON knows no nan: what is undefined is null.
def _estimate_fields(estimate: Estimate | None) -> dict[str, float | None] | None:
    if estimate is None:
        return None
    parts = {"value": estimate.value, "low": estimate.low, "high": estimate.high}
    return {key: value if math.isfinite(value) else None for key, value in parts.items()}


def _heads(name: str) -> list[str]:
    return [name, f"{name}_low", f"{name}_high"]


_FIGURE_HEADS = ["n", "n_without_result", *_heads("success"), *_heads("score"), *_heads("time_s")]


def _figure_cells(figures: SettingFigures) -> list[Any]:
    estimates = (figures.success, figures.score, figures.time_s)
    return [figures.n, figures.n_without_result, *(end for each in estimates for end in _ends(each))]


def _ends(estimate: Estimate | None) -> list[float | str]:
    if estimate is None:
        return ["", "", ""]
    return [end if math.isfinite(end) else "" for end in (estimate.value, estimate.low, estimate.high)]


def _cell(value: Any) -> Any:
    return json.dumps(_plain(value)) if isinstance(value, bool | tuple | list) else value


def _values(parameters: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _plain(value) for name, value in parameters.items()}


def _plain(value: Any) -> Any:
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value


def _csv(heads: list[str], rows: Iterable[list[Any]]) -> str:
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(rows)
    return text.getvalue()


_BLUE, _INK, _SOFT, _GRID, _AXIS = "#0072b2", "#1c1d20", "#5b5e66", "#ebebe4", "#b9bab4"
_STYLE = (
    "text{font-family:system-ui,'Segoe UI',Roboto,Arial,sans-serif;font-size:12px;fill:#5b5e66}"
    ".title{font-size:14px;font-weight:600;fill:#1c1d20}.head{font-weight:600;fill:#1c1d20}"
)
_WIDTH, _HEIGHT = 300.0, 190.0
_LEFT, _TOP, _GAP, _BOTTOM = 50.0, 98.0, 62.0, 58.0
_CELL_W, _CELL_H = 92.0, 46.0
_LINE_H = 24.0
# From this ratio of largest to smallest on, values are spread by their logarithms.
_LOG_FROM = 20.0
_MOST_TICK_WORDS = 12


@dataclass(frozen=True, kw_only=True)
class _Figure:
    """A figure of a sweep: its name, how it is read, and the scale of its values; None: from 0 to the largest."""

    name: str
    unit: str
    of: Callable[[SweepPoint], Estimate]
    factor: float
    most: float | None
    digits: int

    def shown(self, value: float) -> str:
        return f"{self.factor * value:.{self.digits}f}"


_FIGURES = (
    _Figure(name="success", unit="%", of=lambda p: p.figures.success, factor=100.0, most=1.0, digits=0),
    _Figure(name="mean score", unit="", of=lambda p: p.figures.score, factor=1.0, most=1.0, digits=2),
    _Figure(name="restricted mean time", unit="s", of=lambda p: p.figures.time_s, factor=1.0, most=None, digits=0),
)


def draw_response_svg(sweep: SweepResult) -> str:
    """Return a sweep as SVG.

    One parameter: success, mean score and restricted mean time over its values, with 95 % intervals. Two: a map of
    each of the three. More: a line for each setting.
    """
    if len(sweep.varied) == 1:
        return _curves(sweep)
    return _maps(sweep) if len(sweep.varied) == 2 else _list(sweep)


def _curves(sweep: SweepResult) -> str:
    ((name, values),) = sweep.varied.items()
    xs = _places(values)
    reference = sweep.points.index(next(p for p in sweep.points if p.setting is sweep.reference))
    parts: list[str] = []
    for i, figure in enumerate(_FIGURES):
        left = _LEFT + i * (_WIDTH + _GAP)
        most, x = _top_of(sweep, figure), [left + 14 + place * (_WIDTH - 28) for place in xs]
        parts += _frame(left, figure, most)
        parts += _tick_words(x, values)
        axis = _axis_name(name, sweep.units[name]) + (", logarithmic" if _is_log(values) else "")
        parts.append(_text(left + _WIDTH / 2, _TOP + _HEIGHT + 40, axis, "middle"))
        if sweep.is_reference_default:
            parts.append(
                f'<line x1="{x[reference]:.1f}" x2="{x[reference]:.1f}" y1="{_TOP}" y2="{_TOP + _HEIGHT}" '
                f'stroke="{_AXIS}" stroke-dasharray="3 3"/>'
            )
            parts.append(_text(x[reference], _TOP - 4, "default", "middle"))
        parts += _curve(x, [figure.of(point) for point in sweep.points], most, is_joined=_are_numbers(values))
    width = _LEFT + len(_FIGURES) * _WIDTH + (len(_FIGURES) - 1) * _GAP + 16
    return _document(sweep, width, _TOP + _HEIGHT + _BOTTOM, parts)


# Where values stand, 0 to 1: numbers to scale, by logarithms where they span much; other values evenly.
def _places(values: Sequence[Any]) -> list[float]:
    if len(values) == 1:
        return [0.5]
    if not _are_numbers(values):
        return [i / (len(values) - 1) for i in range(len(values))]
    numbers = [math.log(v) if _is_log(values) else float(v) for v in values]
    low, high = min(numbers), max(numbers)
    return [(v - low) / (high - low) for v in numbers]


def _is_log(values: Sequence[Any]) -> bool:
    return _are_numbers(values) and min(values) > 0 and max(values) / min(values) >= _LOG_FROM


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _top_of(sweep: SweepResult, figure: _Figure) -> float:
    if figure.most is not None:
        return figure.most
    ends = [end for point in sweep.points for end in (figure.of(point).value, figure.of(point).high)]
    return _rounded_up(max((end for end in ends if math.isfinite(end)), default=1.0))


def _rounded_up(value: float) -> float:
    if value <= 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if value <= step * power * (1 + 1e-9))


def _frame(left: float, figure: _Figure, most: float) -> list[str]:
    unit = f" [{figure.unit}]" if figure.unit else ""
    parts = [_text(left, _TOP - 20, f"{figure.name}{unit}", "start", "head")]
    for k in range(5):
        y = _TOP + _HEIGHT * (1 - k / 4)
        parts.append(
            f'<line x1="{left}" x2="{left + _WIDTH}" y1="{y:.1f}" y2="{y:.1f}" stroke="{_GRID if k else _AXIS}"/>'
        )
        parts.append(_text(left - 7, y + 4, f"{figure.factor * most * k / 4:g}", "end"))
    return parts


# Words that would stand on top of each other are left out.
def _tick_words(x: Sequence[float], values: Sequence[Any]) -> list[str]:
    parts: list[str] = []
    free_from = -math.inf
    for place, value in sorted(zip(x, map(_word, values), strict=True)):
        word = value if len(value) <= _MOST_TICK_WORDS else f"{value[: _MOST_TICK_WORDS - 1]}…"
        half = 3.4 * len(word)
        if place - half >= free_from:
            parts.append(_text(place, _TOP + _HEIGHT + 18, word, "middle"))
            free_from = place + half + 5
    return parts


def _curve(x: Sequence[float], estimates: Sequence[Estimate], most: float, *, is_joined: bool) -> list[str]:
    def y(value: float) -> float:
        return _TOP + _HEIGHT * (1 - min(max(value / most, 0.0), 1.0))

    pairs = sorted(zip(x, estimates, strict=True), key=lambda pair: pair[0])
    known = [(place, each) for place, each in pairs if math.isfinite(each.value)]
    line = " ".join(f"{place:.1f},{y(each.value):.1f}" for place, each in known)
    parts: list[str] = []
    if is_joined:
        parts.append(f'<polyline points="{line}" fill="none" stroke="{_BLUE}" stroke-width="1.5" opacity="0.55"/>')
    for place, each in known:
        if math.isfinite(each.low) and math.isfinite(each.high):
            low, high = y(each.low), y(each.high)
            parts.append(
                f'<path d="M{place:.1f} {low:.1f}V{high:.1f}M{place - 4:.1f} {low:.1f}h8M{place - 4:.1f} {high:.1f}h8" '
                f'stroke="{_BLUE}" stroke-width="1.3" fill="none"/>'
            )
        title = f"{each.value:.3g} ({each.low:.3g} to {each.high:.3g}), n {each.n}"
        parts.append(
            f'<circle cx="{place:.1f}" cy="{y(each.value):.1f}" r="3.6" fill="{_BLUE}">'
            f"<title>{escape(title)}</title></circle>"
        )
    return parts


def _maps(sweep: SweepResult) -> str:
    (row_name, rows), (column_name, columns) = sweep.varied.items()
    longest = max(len(_word(value)) for value in rows)
    left, width = 30 + 7.2 * longest, _CELL_W * len(columns)
    height = _CELL_H * len(rows)
    parts: list[str] = []
    for i, figure in enumerate(_FIGURES):
        x0 = left + i * (width + left + 10)
        unit = f" [{figure.unit}]" if figure.unit else ""
        parts.append(_text(x0, _TOP - 20, f"{figure.name}{unit}", "start", "head"))
        most = _top_of(sweep, figure)
        for k, point in enumerate(sweep.points):
            r, c = divmod(k, len(columns))
            is_reference = point.setting is sweep.reference
            parts += _draw_cell(
                x0 + c * _CELL_W, _TOP + r * _CELL_H, figure, figure.of(point), most, is_outlined=is_reference
            )
        parts += [_text(x0 - 8, _TOP + (r + 0.5) * _CELL_H + 4, _word(value), "end") for r, value in enumerate(rows)]
        parts += [
            _text(x0 + (c + 0.5) * _CELL_W, _TOP + height + 18, _word(value), "middle")
            for c, value in enumerate(columns)
        ]
        parts.append(
            _text(x0 + width / 2, _TOP + height + 40, _axis_name(column_name, sweep.units[column_name]), "middle")
        )
        middle = _TOP + height / 2
        parts.append(
            f'<text x="{x0 - left + 16:.1f}" y="{middle:.1f}" text-anchor="middle" '
            f'transform="rotate(-90 {x0 - left + 16:.1f} {middle:.1f})">'
            f"{escape(_axis_name(row_name, sweep.units[row_name]))}</text>"
        )
    return _document(sweep, left + 3 * width + 2 * (left + 10) + 16, _TOP + height + _BOTTOM, parts)


def _draw_cell(x: float, y: float, figure: _Figure, each: Estimate, most: float, *, is_outlined: bool) -> list[str]:
    share = min(max(each.value / most, 0.0), 1.0) if math.isfinite(each.value) else 0.0
    # Between a pale and the deep blue of the curves; white words where they stand out more than dark ones.
    ends_of_scale = zip((0xED, 0xF4, 0xF9), (0x00, 0x72, 0xB2), strict=True)
    colour = "#" + "".join(f"{round(pale + share * (deep - pale)):02x}" for pale, deep in ends_of_scale)
    ink = "#ffffff" if share > 0.85 else _INK
    outline = f'stroke="{_INK}" stroke-width="2"' if is_outlined else 'stroke="#ffffff" stroke-width="1"'
    value = figure.shown(each.value) if math.isfinite(each.value) else "-"
    has_ends = math.isfinite(each.low) and math.isfinite(each.high)
    ends = f"{figure.shown(each.low)} to {figure.shown(each.high)}" if has_ends else ""
    return [
        f'<rect x="{x + 1:.1f}" y="{y + 1:.1f}" width="{_CELL_W - 2}" height="{_CELL_H - 2}" fill="{colour}" '
        f"{outline}/>",
        f'<text x="{x + _CELL_W / 2:.1f}" y="{y + 20:.1f}" text-anchor="middle" style="fill:{ink};font-weight:600">'
        f"{value}</text>",
        f'<text x="{x + _CELL_W / 2:.1f}" y="{y + 36:.1f}" text-anchor="middle" style="fill:{ink};font-size:10.5px">'
        f"{ends}</text>",
    ]


def _list(sweep: SweepResult) -> str:
    words = [to_inline_yaml(point.setting.parameters)[1:-1] for point in sweep.points]
    left = 24 + 6.4 * max(map(len, words))
    height = _LINE_H * len(words)
    parts: list[str] = [_text(left - 10, _TOP + (i + 0.5) * _LINE_H + 4, word, "end") for i, word in enumerate(words)]
    for k, figure in enumerate(_FIGURES):
        x0, most = left + k * (_WIDTH * 0.7 + 30), _top_of(sweep, figure)
        unit = f" [{figure.unit}]" if figure.unit else ""
        parts.append(_text(x0, _TOP - 20, f"{figure.name}{unit}", "start", "head"))
        for j in range(5):
            x = x0 + 0.7 * _WIDTH * j / 4
            parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{_TOP}" y2="{_TOP + height}" stroke="{_GRID}"/>')
            parts.append(_text(x, _TOP + height + 18, f"{figure.factor * most * j / 4:g}", "middle"))
        for i, point in enumerate(sweep.points):
            parts += _bar(x0, _TOP + (i + 0.5) * _LINE_H, figure.of(point), most)
    return _document(sweep, left + 3 * (_WIDTH * 0.7 + 30), _TOP + height + _BOTTOM - 20, parts)


def _bar(x0: float, y: float, each: Estimate, most: float) -> list[str]:
    def x(value: float) -> float:
        return x0 + 0.7 * _WIDTH * min(max(value / most, 0.0), 1.0)

    if not math.isfinite(each.value):
        return []
    dot = f'<circle cx="{x(each.value):.1f}" cy="{y:.1f}" r="3.6" fill="{_BLUE}"/>'
    if not (math.isfinite(each.low) and math.isfinite(each.high)):
        return [dot]
    return [f'<line x1="{x(each.low):.1f}" x2="{x(each.high):.1f}" y1="{y:.1f}" y2="{y:.1f}" stroke="{_BLUE}"/>', dot]


def _document(sweep: SweepResult, width: float, height: float, parts: Sequence[str]) -> str:
    n = sweep.points[0].figures.n
    title = f"{sweep.entry} in {sweep.suite}"
    subtitle = f"{n} flights for each setting, the same cases, seeds and plumes; 95 % intervals"
    if len(sweep.varied) == 2 and sweep.is_reference_default:
        subtitle += "; outlined: default"
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
            f'viewBox="0 0 {width:.0f} {height:.0f}" role="img">',
            f"<title>{escape(title)}: response to {escape(', '.join(sweep.varied))}</title>",
            f"<style>{_STYLE}</style>",
            f'<rect width="{width:.0f}" height="{height:.0f}" fill="#ffffff"/>',
            _text(14, 22, title, "start", "title"),
            _text(14, 40, subtitle, "start"),
            *parts,
            "</svg>\n",
        ]
    )


def _text(x: float, y: float, text: str, anchor: str, kind: str = "") -> str:
    style = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{style}>{escape(text)}</text>'


def _axis_name(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"


def _word(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else to_inline_yaml({"v": value})[4:-1].strip('"')
