"""Whole figures of one run or several, and curves over time."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.method_names import join_methods
from gslcosim_data.figures import plans
from gslcosim_data.figures.style import (
    FAINT,
    INK,
    OKABE_ITO,
    SOURCE,
    get_line_style,
    new_figure,
    safe_text,
    save,
    styled,
)
from gslcosim_data.run import RunData
from gslcosim_data.streams import RecordedSeries
from gslcosim_services.recorder.stream_table import BELIEF_MASS, DISTANCE, MIXING_RATIO, RESPONSE

Floats = NDArray[np.float64]
Curves = Sequence[tuple[Floats, Floats]]
_N_TIMES = 201
_MOST_THIN_LINES = 40
_N_BELIEFS = 4
# Of a figure without one axis for all: below it there is room for a legend of this many entries a line.
_LEGEND_COLUMNS = {1: 2, 2: 5}
SEVERAL_FIGURES: Mapping[str, str] = {
    "track": "tracks over plan and gas of the first run",
    "distance": "distances over time as a bundle with median and band, for each method",
}
"""Figures of several runs, by name."""


def distance(axes: Any, run: RunData) -> None:
    """Draw the distance of each agent to the nearest source, the success radius, and the first contact with gas."""
    is_one = len(run.agents) == 1
    for i, agent in enumerate(run.agents):
        curve = run.figure(agent, DISTANCE.name)
        if curve is None:
            continue
        axes.plot(curve.time_s, curve.value, **get_line_style(i), label="distance" if is_one else safe_text(agent),
                  gid=f"distance/{agent}")  # fmt: skip
        marks = run.marks[agent]
        at_s = [t for t, text in zip(marks.time_s, marks.label, strict=True) if text == "first gas"]
        if at_s:
            there = np.interp(at_s, curve.time_s, curve.value)
            axes.plot(at_s, there, ls="", marker="^", ms=5.5, color=OKABE_ITO[4], mec=INK, mew=0.7, zorder=5,
                      label="first contact with gas" if i == 0 else "_", gid=f"first_gas/{agent}")  # fmt: skip
    _radius(axes, run.scenario.referee.success.drawn_radius_m)
    _time_axis(axes, run, "distance to the source [m]")


def distance_bundle(
    axes: Any,
    bundles: Mapping[str, Curves],
    *,
    radius_m: float | None = None,
    looks: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Draw the distances of many runs: thin lines, their median bold, and a band from the 25th to 75th percentile.

    A run that has ended keeps its last distance.

    Args:
        bundles: By label the runs: times [s] and distances [m] of each.
        radius_m: The success radius [m].
        looks: By label colour and line style, where they are not those of `style.get_line_style`.
    """
    end_s = max((float(time_s[-1]) for curves in bundles.values() for time_s, _ in curves), default=1.0)
    at_s = np.linspace(0.0, end_s, _N_TIMES)
    for i, (label, curves) in enumerate(bundles.items()):
        style = (looks or {}).get(label) or get_line_style(i)
        for k, (time_s, distance_m) in enumerate(curves[:_MOST_THIN_LINES]):
            axes.plot(time_s, distance_m, color=style["color"], lw=0.5, alpha=0.35, gid=f"flight/{label}/{k}")
        held = np.stack([np.interp(at_s, time_s, distance_m) for time_s, distance_m in curves])
        low, middle, high = np.percentile(held, (25, 50, 75), axis=0)
        axes.fill_between(at_s, low, high, color=style["color"], alpha=0.18, lw=0, gid=f"band/{label}")
        n = "1 flight" if len(curves) == 1 else f"{len(curves)} flights"
        axes.plot(at_s, middle, **style, lw=1.8, label=f"{safe_text(label)}: median of {n}", gid=f"median/{label}")
    _radius(axes, radius_m)
    axes.set(xlim=(0, end_s), xlabel="time [s]", ylabel="distance to the source [m]")
    axes.set_ylim(bottom=0)


def true_gas(axes: Any, run: RunData, *, agent: str | None = None) -> None:
    """Draw the true mixing ratio at the gas sensors of an agent, by default of the first."""
    name = agent or run.agents[0]
    found = [one for one in run.samples if one.agent == name and one.quantity == MIXING_RATIO.name]
    several = len({one.gas for one in found}) > 1
    for i, one in enumerate(found):
        label = f"{one.sensor}, {one.gas}" if several else one.sensor
        axes.plot(one.time_s, one.value, **get_line_style(i), lw=0.8, label=safe_text(label),
                  gid=f"true_ppm/{name}/{one.sensor}/{one.gas}")  # fmt: skip
    _time_axis(axes, run, "true mixing\nratio [ppm]")


def sensor_response(axes: Any, run: RunData, *, agent: str | None = None) -> None:
    """Draw what the gas sensors of an agent reported, by default of the first, in the unit of the first sensor."""
    name = agent or run.agents[0]
    found = [one for one in run.readings if one.agent == name and one.quantity == RESPONSE.name]
    found = [one for one in found if one.unit == found[0].unit]
    for i, one in enumerate(found):
        axes.plot(one.time_s, one.value, **get_line_style(i), lw=0.8, label=safe_text(one.sensor),
                  gid=f"response/{name}/{one.sensor}")  # fmt: skip
    unit = found[0].unit if found else ""
    _time_axis(axes, run, f"reported\n[{ {'ohm': 'Ω', '1': '-'}.get(unit, unit) }]")


def belief_quality(axes: Any, run: RunData) -> None:
    """Draw the probability that each belief gives to the success radius around the sources."""
    for i, agent in enumerate(run.beliefs):
        curve = run.figure(agent, BELIEF_MASS.name)
        if curve is not None:
            _held(
                axes, curve, run, i, f"belief_mass_near/{agent}", agent if len(run.beliefs) > 1 else "near the source"
            )
    _time_axis(axes, run, "probability within\nthe success radius")
    axes.set_ylim(0, min(1.25 * axes.get_ylim()[1], 1.02))


def _held(axes: Any, curve: RecordedSeries, run: RunData, i: int, gid: str, label: str) -> None:
    end_s = run.tracks[curve.agent].time_s[-1]
    time_s, value = np.append(curve.time_s, end_s), np.append(curve.value, curve.value[-1])
    axes.plot(time_s, value, **get_line_style(i), drawstyle="steps-post", label=safe_text(label), gid=gid)


def _radius(axes: Any, radius_m: float | None) -> None:
    if radius_m:
        axes.axhline(radius_m, color=SOURCE, lw=0.8, ls=(0, (3, 2)), label="success radius")


def _time_axis(axes: Any, run: RunData, label: str) -> None:
    end_s = max(track.time_s[-1] for track in run.tracks.values())
    axes.set(xlim=(0, end_s), xlabel="time [s]", ylabel=label)
    axes.set_ylim(bottom=min(0, axes.get_ylim()[0]) if "reported" not in label else None)
    axes.grid(lw=0.3, color=FAINT, alpha=0.4)


@dataclass(frozen=True, kw_only=True)
class RunFigure:
    """A figure of one run.

    Attributes:
        title: What it shows.
        aspect: Height by width; of the room's plan where None.
        lacks: Says what there is no data of; empty where there is.
        draw: Draws into an empty figure; the last argument is over how many columns.
    """

    title: str
    aspect: float | None
    draw: Callable[[Any, RunData, int], None]
    lacks: Callable[[RunData], str] = lambda run: ""


def draw_run(run: RunData, name: str, *, columns: int = 1) -> Any:
    """Return one figure of a run; draw it within `style.styled()`.

    Raises:
        UsageError: there is no such figure, or no data for it.
    """
    figure_of = RUN_FIGURES.get(name)
    if figure_of is None:
        raise UsageError(f"--figure: expected some of {', '.join(RUN_FIGURES)}, was '{name}'.")
    lacks = figure_of.lacks(run)
    if lacks:
        raise UsageError(f"--figure {name}: expected a run with {lacks}, {run.run_id} has none.")
    aspect = _plan_aspect(run, columns) if figure_of.aspect is None else figure_of.aspect * (1 if columns == 1 else 0.6)
    figure = new_figure(columns, aspect)
    figure_of.draw(figure, run, columns)
    return figure


def write_run_figures(
    run: RunData, folder: Path, *, names: Sequence[str] = (), formats: Sequence[str] = ("pdf",), columns: int = 1
) -> list[Path]:
    """Write figures of a run, by default all that there are data for; return their files.

    Raises:
        UsageError: a named figure does not exist or has no data, or matplotlib is not installed.
        MachineError: a file cannot be written.
    """
    chosen = names or [name for name, one in RUN_FIGURES.items() if not one.lacks(run)]
    written: list[Path] = []
    with styled():
        for name in chosen:
            written += save(draw_run(run, name, columns=columns), folder / name, formats)
    return written


def draw_runs(runs: Mapping[str, RunData], name: str, *, columns: int = 1) -> Any:
    """Return one figure of several runs, by label; draw it within `style.styled()`.

    Raises:
        UsageError: there is no such figure of several runs, or they were run in different rooms.
    """
    if name not in SEVERAL_FIGURES:
        known = ", ".join(SEVERAL_FIGURES)
        raise UsageError(f"--figure: expected some of {known} for several runs, was '{name}'. Give one run for others.")
    first = next(iter(runs.values()))
    if name == "distance":
        figure = new_figure(columns, 0.75 if columns == 1 else 0.42)
        _bundle(figure, runs, columns)
        return figure
    strange = next((run for run in runs.values() if _room(run) != _room(first)), None)
    if strange is not None:
        raise UsageError(
            f"--figure {name}: expected runs of one room, {strange.run_id} was flown in another than {first.run_id}. "
            "Draw them one by one, or their distances: --figure distance."
        )
    figure = new_figure(columns, _plan_aspect(first, columns))
    _draw_with_gas(figure, runs, columns, draw=plans.tracks_of_runs)
    return figure


def write_figures_of_several(
    runs: Mapping[str, RunData], folder: Path, *, names: Sequence[str] = (), formats: Sequence[str] = ("pdf",),
    columns: int = 1,
) -> list[Path]:  # fmt: skip
    """Write figures of several runs, by default distances, and tracks where they share a room.

    Raises:
        UsageError: a named figure does not exist, or matplotlib is not installed.
        MachineError: a file cannot be written.
    """
    share_room = len({_room(run) for run in runs.values()}) == 1
    chosen = names or [name for name in SEVERAL_FIGURES if name == "distance" or share_room]
    written: list[Path] = []
    with styled():
        for name in chosen:
            written += save(draw_runs(runs, name, columns=columns), folder / name, formats)
    return written


def _room(run: RunData) -> object:
    return run.manifest.get("environment_hash")


def _plan_aspect(run: RunData, columns: int) -> float:
    grid = run.environment.grid
    width_m, depth_m = grid.shape[0], grid.shape[1]
    # Beside the plan are labels and the colour bar, below it the legend.
    return min(0.72 * depth_m / width_m + (0.34 if columns == 1 else 0.14), 1.4 if columns == 1 else 1.0)


def _bundle(figure: Any, runs: Mapping[str, RunData], columns: int) -> None:
    bundles: dict[str, list[Any]] = {}
    for run in runs.values():
        curves = [one for agent in run.agents if (one := run.figure(agent, DISTANCE.name)) is not None]
        # A team is as near as its nearest member.
        ends = min(len(one.tick) for one in curves)
        nearest = np.min([one.value[:ends] for one in curves], axis=0)
        bundles.setdefault(join_methods(run.methods.values()), []).append((curves[0].time_s[:ends], nearest))
    radii = {run.scenario.referee.success.drawn_radius_m for run in runs.values()}
    distance_bundle(figure.subplots(), bundles, radius_m=radii.pop() if len(radii) == 1 else None)
    _legend(figure, columns)


def _legend(figure: Any, columns: int) -> None:
    handles, labels = [], []
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            if label not in labels:
                handles.append(handle)
                labels.append(label)
    if handles:
        n = min(_LEGEND_COLUMNS[columns], len(labels))
        figure.legend(handles, labels, loc="outside lower center", ncols=n, handlelength=2.2, columnspacing=1.2)


# What is drawn in the room has a bar of the gas beside it and a legend below.
def _draw_with_gas(figure: Any, run: Any, columns: int, *, draw: Callable[[Any, Any], Any]) -> None:
    axes = figure.subplots()
    image = draw(axes, run)
    if image is not None:
        figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02, label="mixing ratio [ppm]").outline.set_linewidth(0.4)
    _legend(figure, columns)


def _draw_distance(figure: Any, run: RunData, columns: int) -> None:
    distance(figure.subplots(), run)
    _legend(figure, columns)


def _draw_gas(figure: Any, run: RunData, columns: int) -> None:
    del columns
    above, below = figure.subplots(2, 1, sharex=True)
    true_gas(above, run)
    sensor_response(below, run)
    above.set_xlabel("")
    for axes in (above, below):
        if len(axes.get_lines()) > 1:
            axes.legend(loc="best")


def _draw_track_3d(figure: Any, run: RunData, columns: int) -> None:
    plans.track_3d(figure.add_subplot(projection="3d"), run)
    _legend(figure, columns)


def _draw_wind(figure: Any, run: RunData, columns: int) -> None:
    _, ny, nz = run.environment.grid.shape
    panels = figure.subplots(2, 1, height_ratios=[ny, nz]) if columns == 1 else figure.subplots(1, 2)
    plans.wind_section(panels[0], run, normal="z")
    image = plans.wind_section(panels[1], run, normal="y")
    figure.colorbar(image, ax=list(panels), shrink=0.7, pad=0.02, label="speed [m/s]").outline.set_linewidth(0.4)


def _draw_belief(figure: Any, run: RunData, columns: int) -> None:
    agent = next(iter(run.beliefs))
    n = len(run.beliefs[agent].tick)
    some = np.unique(np.linspace(0, n - 1, min(_N_BELIEFS, n)).round().astype(int))
    n_across = 2 if columns == 1 else 4
    n_down = -(-len(some) // n_across)
    upper, lower = figure.subfigures(2, 1, height_ratios=[n_down * 2.6, 1.9] if columns == 1 else [1.7, 1])
    panels = np.atleast_1d(upper.subplots(n_down, n_across, squeeze=False)).ravel()
    most = max(float(run.beliefs[agent].in_plane(i).max()) for i in some.tolist())
    shown = [plans.belief(axes, run, agent, i, most=most) for axes, i in zip(panels, some.tolist(), strict=False)]
    for axes in panels:
        axes.label_outer()
    bar = upper.colorbar(shown[-1], ax=list(panels), shrink=0.8, pad=0.02, label="probability of a cell")
    bar.outline.set_linewidth(0.4)
    for axes in panels[len(some) :]:
        axes.set_visible(False)
    curve = lower.subplots()
    belief_quality(curve, run)
    for i in some.tolist():
        curve.axvline(run.beliefs[agent].time_s[i], color=INK, lw=0.5, ls=(0, (1, 2)))


RUN_FIGURES: Mapping[str, RunFigure] = {
    "track": RunFigure(
        title="ground track over plan and gas", aspect=None, draw=partial(_draw_with_gas, draw=plans.ground_track),
    ),
    "distance": RunFigure(title="distance to the source over time", aspect=0.68, draw=_draw_distance),
    "gas": RunFigure(
        title="true mixing ratio at the sensor, and what it reported", aspect=0.8,
        lacks=lambda run: "" if any(one.quantity == MIXING_RATIO.name for one in run.samples) else "a gas sensor",
        draw=_draw_gas,
    ),
    "track_3d": RunFigure(title="track in space", aspect=0.85, draw=_draw_track_3d),
    "wind": RunFigure(title="sections through the wind", aspect=1.25, draw=_draw_wind),
    "gas_section": RunFigure(
        title="vertical section through the gas", aspect=0.72,
        lacks=lambda run: "" if len(run.filaments.tick) else "filaments of gas",
        draw=partial(_draw_with_gas, draw=plans.gas_section),
    ),
    "belief": RunFigure(
        title="belief over time", aspect=None,
        lacks=lambda run: "" if run.beliefs else "an agent that publishes beliefs", draw=_draw_belief,
    ),
    "swarm": RunFigure(
        title="tracks of a swarm", aspect=None,
        lacks=lambda run: "" if len(run.agents) > 1 else "several agents",
        draw=partial(_draw_with_gas, draw=plans.swarm_tracks),
    ),
}  # fmt: skip
"""Figures of one run, by name."""
