"""Figures for papers: the plots of the page, distance bundles, and success by start, by matplotlib."""

import importlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim.bench.report.analysis import Analysis
from gslcosim.bench.report.curves import (
    CurveWithBand,
    PlanDrawing,
    build_plan_drawings,
    compute_start_success,
    rows_by_entry,
)
from gslcosim.bench.report.page import LineStyle, assign_line_styles
from gslcosim.bench.report.report_data import Ints, ReportData, load_report_data
from gslcosim.data.figures.plans import success_by_start
from gslcosim.data.figures.run_figures import distance_bundle
from gslcosim.data.figures.style import (
    DASHES,
    FAINT,
    INK,
    OKABE_ITO,
    STYLE,
    get_line_style,
    matplotlib_for,
    new_figure,
    safe_text,
    save,
    styled,
)

_MOST_DRAWN = 12


def write_figures(analysis: Analysis, folder: Path) -> list[Path]:
    """Write the plots that there are data for; each as SVG and as PDF. The same rows give the same bytes.

    Args:
        analysis: What they show; of many entries the best twelve.
        folder: Where to; made if need be.

    Raises:
        UsageError: matplotlib is not installed.
    """
    otherwise = ", or leave figures out: the page has them too"
    matplotlib = matplotlib_for("figures", extra="report", otherwise=otherwise)
    folder.mkdir(exist_ok=True)
    view, written = analysis.everything, list[Path]()
    drawings: dict[str, tuple[bool, Callable[[Any], None]]] = {
        "leaderboard": (bool(view.standings), lambda axes: _leaderboard(analysis, axes)),
        "success_over_time": (
            bool(view.curves),
            lambda axes: _lines(analysis, axes, view.curves, "time [s]", "found the source"),
        ),
        "profile": (
            bool(view.profiles),
            lambda axes: _lines(analysis, axes, view.profiles, "times the oracle's time", "of all cases", log=True),
        ),
        "runtime": (
            bool(view.runtimes.get("all")),
            lambda axes: _lines(analysis, axes, view.runtimes["all"], "time [s]", "within 5, 2, 1 and 0.5 m"),
        ),
        "beliefs": (
            bool(view.beliefs.get("mass")),
            lambda axes: _lines(analysis, axes, view.beliefs["mass"], "time [s]", "probability within the radius",
                                step=False),
        ),
        "roc": (any(d.curve for d in view.declarations), lambda axes: _roc(analysis, axes)),
        "pairs": (bool(view.pairs), lambda axes: _pairs(analysis, axes)),
    }  # fmt: skip
    with matplotlib.rc_context(STYLE):
        for name, (has_data, draw) in drawings.items():
            if has_data:
                written += _written(folder / name, draw)
    return written


def _written(stem: Path, draw: Callable[[Any], None]) -> list[Path]:
    figure = importlib.import_module("matplotlib.figure").Figure(figsize=(5.2, 3.2))
    draw(figure.subplots())
    paths = [stem.with_suffix(suffix) for suffix in (".svg", ".pdf")]
    for path in paths:
        # No date: the same rows give the same file.
        undated = {"Date": None} if path.suffix == ".svg" else {"CreationDate": None}
        figure.savefig(path, metadata=undated)
    return paths


def _color(look: LineStyle) -> str:
    return {-1: INK, -2: FAINT}.get(look.color) or OKABE_ITO[look.color]


# Entries are drawn in the order of the leaderboard.
def _drawn(analysis: Analysis) -> list[int]:
    return [row.entry for row in analysis.everything.standings][:_MOST_DRAWN]


def _lines(
    analysis: Analysis,
    axes: Any,
    lines: Sequence[CurveWithBand],
    x: str,
    y: str,
    *,
    log: bool = False,
    step: bool = True,
) -> None:
    looks, by_entry = assign_line_styles(analysis), {line.entry: line for line in lines}
    for entry in _drawn(analysis):
        if (line := by_entry.get(entry)) is None:
            continue
        look, kind = looks[entry], "post" if step else None
        style = {"drawstyle": "steps-post"} if step else {}
        name = analysis.material.entries[entry].name
        axes.plot(line.x, 100 * line.value, color=_color(look), ls=DASHES[look.dashes], label=safe_text(name), **style)
        axes.fill_between(
            line.x, 100 * line.low, 100 * line.high, step=kind, color=_color(look), alpha=0.12, linewidth=0
        )
    axes.set(xlabel=x, ylabel=f"{y} [%]", ylim=(0, 102), xlim=(lines[0].x[0], lines[0].x[-1]))
    if log:
        axes.set_xscale("log")
        axes.set_xticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
        axes.minorticks_off()
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _leaderboard(analysis: Analysis, axes: Any) -> None:
    looks = assign_line_styles(analysis)
    rows = analysis.everything.standings[:_MOST_DRAWN]
    for place, row in enumerate(rows):
        color, e = _color(looks[row.entry]), row.score
        axes.plot([e.low, e.high], [place, place], color=color, lw=2)
        axes.plot([e.value], [place], "o", color=color, ms=4)
    names = [f"{row.rank}  {safe_text(analysis.material.entries[row.entry].name)}" for row in rows]
    axes.set(xlim=(0, 1), xlabel="score: interquartile mean of q, with 95 % interval")
    axes.set_yticks(range(len(rows)), names)
    axes.invert_yaxis()
    axes.grid(axis="x", lw=0.4, color="#dddddd")


def _roc(analysis: Analysis, axes: Any) -> None:
    looks = assign_line_styles(analysis)
    for d in analysis.everything.declarations:
        if d.curve is not None and d.entry in _drawn(analysis):
            look, name = looks[d.entry], safe_text(analysis.material.entries[d.entry].name)
            label = f"{name}, area {d.curve.area.value:.2f} ({d.curve.area.low:.2f} to {d.curve.area.high:.2f})"
            axes.plot(d.curve.false_positive, d.curve.true_positive, color=_color(look), ls=DASHES[look.dashes],
                      label=label)  # fmt: skip
    axes.plot([0, 1], [0, 1], color="#999999", lw=0.6, ls=":")
    axes.set(xlim=(0, 1), ylim=(0, 1.02), xlabel="declared without gas", ylabel="declared with gas")
    axes.set_aspect("equal")
    axes.legend(loc="lower right")


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


RESULT_FIGURES = ("distance", "starts")
_MOST_ENTRIES = 6
_MOST_ACROSS = {1: 2, 2: 3}


def write_result_figures(
    results: Path, folder: Path, *, names: Sequence[str] = (), formats: Sequence[str] = ("pdf",), columns: int = 1
) -> list[Path]:
    """Write figures of results, for each room: of the first six entries; return their files.

    Raises:
        UsageError: it is no folder of results, a named figure does not exist or has no data, or there is no matplotlib.
        MachineError: a file cannot be written.
    """
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
                figure = new_figure(columns, _starts_aspect(material, room, columns))
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


def _starts_aspect(material: ReportData, room: PlanDrawing, columns: int) -> float:
    down, across = _shape(material, room, columns)
    x0, y0, x1, y1 = room.box_m
    return min((y1 - y0) / max(x1 - x0, 1e-9) * down / across + 0.1 * down, 2.0)


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
    assert material.tracks is not None
    rows = material.rows
    wanted = {str(rows["trial"][row]): int(row) for _, some in _entries(material, room) for row in some.tolist()}
    found: dict[str, Any] = {}
    for batch in material.tracks.select(["trial", "t_s", "distance_m"]).to_batches(max_chunksize=512):
        for k, trial in enumerate(batch.column(0).to_pylist()):
            if trial not in wanted:
                continue
            t_s, distance_m = (np.asarray(batch.column(i)[k].values, dtype=np.float64) for i in (1, 2))
            if trial in found:
                n = min(len(t_s), len(found[trial][0]))
                t_s, distance_m = t_s[:n], np.minimum(distance_m[:n], found[trial][1][:n])
            found[trial] = (t_s, distance_m)
    curves: dict[int, list[Any]] = {}
    for trial, curve in found.items():
        if len(curve[0]):
            curves.setdefault(int(rows.entry[wanted[trial]]), []).append(curve)
    return curves
