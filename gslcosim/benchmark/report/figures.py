"""Pictures for papers: the plots of the page as SVG and PDF, by matplotlib."""

import importlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.benchmark.report.analysis import Analysis
from gslcosim.benchmark.report.curves import Line
from gslcosim.benchmark.report.page import Look, looks_of
from gslcosim.plotting.style import DASHES, FAINT, INK, OKABE_ITO, STYLE, matplotlib_for, safe_text

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


def _color(look: Look) -> str:
    return {-1: INK, -2: FAINT}.get(look.color) or OKABE_ITO[look.color]


# Entries are drawn in the order of the leaderboard.
def _drawn(analysis: Analysis) -> list[int]:
    return [row.entry for row in analysis.everything.standings][:_MOST_DRAWN]


def _lines(
    analysis: Analysis, axes: Any, lines: Sequence[Line], x: str, y: str, *, log: bool = False, step: bool = True
) -> None:
    looks, by_entry = looks_of(analysis), {line.entry: line for line in lines}
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
    looks = looks_of(analysis)
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
    looks = looks_of(analysis)
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
