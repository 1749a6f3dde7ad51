"""Figures for papers: the plots of the page, distance bundles, and success by start, by matplotlib."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim_bench.report.analysis import Analysis
from gslcosim_bench.report.charts import LineChart, build_line_charts
from gslcosim_bench.report.curves import limit_s, rows_by_entry
from gslcosim_bench.report.number_formats import format_ranks
from gslcosim_bench.report.page import LineStyle, assign_line_styles
from gslcosim_bench.report.plans import PlanDrawing, build_plan_drawings, compute_start_success
from gslcosim_bench.report.report_data import Ints, ReportData, load_report_data, read_samples
from gslcosim_data.figures.plans import success_by_start
from gslcosim_data.figures.run_figures import distance_bundle
from gslcosim_data.figures.style import (
    DASHES,
    FAINT,
    INK,
    OKABE_ITO,
    get_line_style,
    matplotlib_for,
    new_figure,
    part_of_matplotlib,
    safe_text,
    save,
    styled,
)

_MOST_DRAWN = 12
_LINE_CHARTS = ("success_over_time", "profile", "runtime", "errors", "beliefs", "roc")
RESULT_FIGURES = ("distance", "starts")
_MOST_ENTRIES = 6
_MOST_ACROSS = {1: 2, 2: 3}


def write_figures(analysis: Analysis, folder: Path) -> list[Path]:
    """Write the plots that there are data for; each as SVG and as PDF. The same rows give the same bytes.

    Args:
        analysis: What they show; of many entries the best twelve.
        folder: Where to; made if need be.
    """
    otherwise = ", or leave figures out: the page has them too"
    matplotlib_for("figures", install="gslcosim-bench[report]", otherwise=otherwise)
    folder.mkdir(exist_ok=True)
    view, written = analysis.everything, list[Path]()
    charts = build_line_charts(view, limit_s(analysis.material.rows))
    drawings: dict[str, Callable[[Any], None]] = {
        name: partial(_line_chart, analysis, chart)
        for name, chart in charts.items()
        if name in _LINE_CHARTS or chart.has_points
    }
    if view.standings:
        drawings["leaderboard"] = partial(_leaderboard, analysis)
    if view.pairs:
        drawings["pairs"] = partial(_pairs, analysis)
    with styled():
        for name, draw in drawings.items():
            figure = part_of_matplotlib("figure").Figure(figsize=(5.2, 3.2))
            draw(figure.subplots())
            written += save(figure, folder / name, ("svg", "pdf"))
    return written


def _color(look: LineStyle) -> str:
    return {-1: INK, -2: FAINT}.get(look.color) or OKABE_ITO[look.color]


# Entries are drawn in the order of the leaderboard.
def _drawn(analysis: Analysis) -> list[int]:
    return [row.entry for row in analysis.everything.standings][:_MOST_DRAWN]


def _line_chart(analysis: Analysis, chart: LineChart, axes: Any) -> None:
    looks, drawn = assign_line_styles(analysis), _drawn(analysis)
    # Lines of several entries are few; of others, those of the best entries, in the order of the leaderboard.
    lines = [line for line in chart.lines if line.label or line.entry in drawn]
    # Shares in per cent, as the label says.
    scale = 100.0 if chart.y.format == "percent" else 1.0
    step = {"drawstyle": "steps-post"} if chart.is_step else {}
    for line in lines if chart.has_points else sorted(lines, key=lambda line: drawn.index(line.entry)):
        look, label = looks[line.entry], safe_text(line.label or analysis.material.entries[line.entry].name)
        if chart.has_points:
            low, high = (line.value if end is None else end for end in (line.low, line.high))
            ends = np.nan_to_num(np.maximum([line.value - low, high - line.value], 0.0))
            axes.errorbar(
                line.x, scale * line.value, scale * ends, fmt="o", ms=3, lw=1, color=_color(look), label=label,
                ls=DASHES[look.dashes] if chart.is_joined else "none",
            )  # fmt: skip
            continue
        if line.area is not None:
            label += f", area {line.area.value:.2f} ({line.area.low:.2f} to {line.area.high:.2f})"
        axes.plot(line.x, scale * line.value, color=_color(look), ls=DASHES[look.dashes], label=label, **step)
        if line.low is not None and line.high is not None:
            axes.fill_between(
                line.x, scale * line.low, scale * line.high, step="post" if chart.is_step else None,
                color=_color(look), alpha=0.12, linewidth=0,
            )  # fmt: skip
    if chart.has_diagonal:
        axes.plot([0, 1], [0, scale], color="#999999", lw=0.6, ls=":")
        axes.set_box_aspect(1)
    axes.set(xlabel=chart.x.label, ylabel=chart.y.label, xlim=(chart.x.low, chart.x.high),
             ylim=(scale * chart.y.low, 1.02 * scale * chart.y.high))  # fmt: skip
    if chart.x.is_log:
        axes.set_xscale("log")
        axes.minorticks_off()
    if chart.x.ticks:
        axes.set_xticks([at for at, _ in chart.x.ticks], [safe_text(word) for _, word in chart.x.ticks])
    if chart.x.default is not None:
        axes.axvline(chart.x.default, color="#999999", lw=0.6, ls=":")
    # Below the diagonal is room, and what stands there is long.
    place = {"loc": "lower right"} if chart.has_diagonal else {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
    axes.legend(**place)


def _leaderboard(analysis: Analysis, axes: Any) -> None:
    looks = assign_line_styles(analysis)
    rows = analysis.everything.standings[:_MOST_DRAWN]
    for place, row in enumerate(rows):
        color, e = _color(looks[row.entry]), row.score
        axes.plot([e.low, e.high], [place, place], color=color, lw=2)
        axes.plot([e.value], [place], "o", color=color, ms=4)
    names = [
        f"{format_ranks(row.rank, row.last_rank)}  {safe_text(analysis.material.entries[row.entry].name)}"
        for row in rows
    ]
    axes.set(xlim=(0, 1), xlabel="score: mean of q over cases, with 95 % interval")
    axes.set_yticks(range(len(rows)), names)
    axes.invert_yaxis()
    axes.grid(axis="x", lw=0.4, color="#dddddd")


def _pairs(analysis: Analysis, axes: Any) -> None:
    drawn = _drawn(analysis)
    place = {entry: k for k, entry in enumerate(drawn)}
    shade = np.full((len(drawn), len(drawn)), np.nan)
    for p in analysis.everything.pairs:
        if p.a not in place or p.b not in place:
            continue
        a, b = place[p.a], place[p.b]
        shade[a, b], shade[b, a] = (max(0, p.verdict) * (2 * p.a_better.value - 1),
                                    max(0, -p.verdict) * (1 - 2 * p.a_better.value))  # fmt: skip
        for i, j, sign in ((a, b, 1), (b, a, -1)):
            white = {"color": "white"} if shade[i, j] > 0.5 else {}
            axes.text(j, i, f"{sign * 100 * p.success.value:+.0f}", ha="center", va="center", fontsize=7, **white)
    names = [safe_text(analysis.material.entries[entry].name) for entry in drawn]
    axes.imshow(shade, cmap="Purples", vmin=0, vmax=1)
    axes.set_xticks(range(len(drawn)), names, rotation=40, ha="right")
    axes.set_yticks(range(len(drawn)), names)
    axes.spines[:].set_visible(False)
    axes.set_title("shaded: row is better; difference in success, points", fontsize=8)


def write_result_figures(
    results: Path, folder: Path, *, names: Sequence[str] = (), formats: Sequence[str] = ("pdf",), columns: int = 1
) -> list[Path]:
    """Write figures of results, for each room: of the first six entries; return their files."""
    unknown = next((name for name in names if name not in RESULT_FIGURES), None)
    if unknown is not None:
        raise UsageError(f"--figure: expected some of {', '.join(RESULT_FIGURES)} for results, was '{unknown}'.")
    material = load_report_data(results)
    if "distance" in names and material.tracks is None:
        raise UsageError(f"--figure distance: expected results with tracks.parquet, {results} has none.")
    written: list[Path] = []
    with styled():
        for room in build_plan_drawings(material):
            label = room.label.replace(" ", "_")
            if "starts" in (names or RESULT_FIGURES):
                down, across = _shape(material, room, columns)
                x0, y0, x1, y1 = room.box_m
                figure = new_figure(columns, min((y1 - y0) / max(x1 - x0, 1e-9) * down / across + 0.1 * down, 2.0))
                _starts(figure, material, room, columns)
                written += save(figure, folder / f"starts_{label}", formats)
            if "distance" in (names or RESULT_FIGURES) and material.tracks is not None:
                figure = new_figure(columns, 0.85 if columns == 1 else 0.45)
                _distances(figure, material, room)
                written += save(figure, folder / f"distance_{label}", formats)
    return written


def _entries(material: ReportData, room: PlanDrawing) -> list[tuple[int, Ints]]:
    everything = np.ones(len(material.rows), dtype=bool)
    found = [(entry, np.intersect1d(flown, room.rows)) for entry, flown in rows_by_entry(material, everything)]
    return [(entry, some) for entry, some in found if some.size][:_MOST_ENTRIES]


def _shape(material: ReportData, room: PlanDrawing, columns: int) -> tuple[int, int]:
    n = max(1, len(_entries(material, room)))
    across = min(n, _MOST_ACROSS[columns])
    return -(-n // across), across


def _starts(figure: Any, material: ReportData, room: PlanDrawing, columns: int) -> None:
    panels = np.atleast_1d(figure.subplots(*_shape(material, room, columns), squeeze=False)).ravel()
    found = compute_start_success(material, [room])
    entries = _entries(material, room)
    solid = None if room.plan is None else (room.plan.occupied, room.plan.origin_m, room.plan.cell_m)
    for axes, (entry, _) in zip(panels, entries, strict=False):
        of_entry = [start for start in found if start.entry == entry]
        x0, y0, x1, y1 = room.box_m
        axes.set(xlim=(x0, x1), ylim=(y0, y1))
        success_by_start(
            axes,
            np.array([(start.x_m, start.y_m) for start in of_entry]),
            np.array([start.success.value for start in of_entry]),
            np.array([start.success.n for start in of_entry]),
            solid=solid,
            sources_m=np.array(room.sources_m),
            gid=f"starts/{material.entries[entry].name}",
        )
        axes.set(xlim=(x0, x1), ylim=(y0, y1))
        axes.set_title(safe_text(material.entries[entry].name), loc="left")
        axes.label_outer()
    for axes in panels[len(entries) :]:
        axes.set_visible(False)


def _distances(figure: Any, material: ReportData, room: PlanDrawing) -> None:
    curves = _curves(material, room)
    axes = figure.subplots()
    radii = {float(radius_m) for radius_m in material.rows["within_m"][room.rows]}
    bundles = {material.entries[entry].name: curves[entry] for entry, _ in _entries(material, room) if entry in curves}
    # As in the report.
    anchors = {"lower": {"color": INK, "ls": DASHES[1]}, "upper": {"color": FAINT, "ls": DASHES[1]}}
    looks = {entry.name: anchors[entry.anchor] for entry in material.entries if entry.anchor}
    others = [name for name in bundles if name not in looks]
    looks |= {name: get_line_style(i) for i, name in enumerate(others)}
    distance_bundle(axes, bundles, radius_m=radii.pop() if len(radii) == 1 else None, looks=looks)
    axes.set_title(safe_text(room.label), loc="left")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=1, handlelength=2.2)


# Of a team the nearest member at each time.
def _curves(material: ReportData, room: PlanDrawing) -> dict[int, list[Any]]:
    rows = [row for _, some in _entries(material, room) for row in some.tolist()]
    curves: dict[int, list[Any]] = {}
    for row, team in read_samples(material, ("t_s", "distance_m"), rows).items():
        n = min(samples.shape[1] for samples in team)
        if n:
            distance_m = np.min([samples[1, :n] for samples in team], axis=0)
            curves.setdefault(int(material.rows.entry[row]), []).append((team[-1][0, :n], distance_m))
    return curves
