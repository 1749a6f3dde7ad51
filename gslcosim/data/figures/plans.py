"""Figures seen from above: plan, gas, tracks, waypoints and events."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.data.figures.style import (
    BELOW,
    INK,
    OKABE_ITO,
    SOLID,
    SOURCE,
    gas_map,
    get_line_style,
    part_of_matplotlib,
    safe_text,
)
from gslcosim.data.run import RunData
from gslcosim.data.streams import RecordedSlices
from gslcosim.environment.model import Cell

_START, _FIRST_GAS, _DECLARED = "start", "first gas", "declared"
_TIME_MARK_S = 10.0


def plan(axes: Any, run: RunData) -> None:
    """Draw the room: what is solid at search height dark, what ends below it pale; inlets and outlets at the sides.

    Args:
        axes: Where to draw, x to the right and y up [m].
        run: The run.
    """
    environment, height_m = run.environment, run.scenario.slice_height_m
    grid = environment.grid
    layer = min(max(int((height_m - grid.origin_m[2]) / grid.cell_m), 0), grid.shape[2] - 1)
    solid = environment.occupancy == Cell.SOLID
    at, below = solid[:, :, layer], solid[:, :, :layer].any(axis=2)
    _shade(axes, run, at, SOLID, zorder=1.2, label="obstacle")
    _shade(axes, run, below & ~at, BELOW, zorder=0.8, label="obstacle that ends below")
    for opening in environment.openings:
        (x0, y0, _), (x1, y1, _) = opening.min_m, opening.max_m
        is_inlet = opening.kind == "inlet"
        ls = "-" if is_inlet else (0, (1, 1))
        axes.plot([x0, x1], [y0, y1], color=INK, lw=2.5, ls=ls, solid_capstyle="butt", clip_on=False, zorder=3,
                  label=opening.kind)  # fmt: skip
    axes.set(
        xlim=(grid.origin_m[0], grid.max_m[0]), ylim=(grid.origin_m[1], grid.max_m[1]), xlabel="x [m]", ylabel="y [m]"
    )
    axes.set_aspect("equal")


def gas_on_plan(axes: Any, run: RunData, *, time_s: float | None = None, gas: str | None = None) -> Any:
    """Draw the gas at search height on a logarithmic scale.

    Args:
        axes: Where to draw.
        run: The run.
        time_s: When [s]; by default the mean over all snapshots is drawn.
        gas: Which gas; by default the one that is searched for.

    Returns:
        What a colour bar is made of; None where the recording has no gas.
    """
    slices = run.gas_slices.get(gas or run.scenario.gas.gas)
    if slices is None or not len(slices.tick):
        return None
    ppm = slices.at(time_s) if time_s is not None else mean_ppm(slices)
    colors = part_of_matplotlib("colors")
    (x0, y0), (nx, ny), d = slices.origin_m, slices.shape, slices.cell_m
    seen = np.ma.masked_less(ppm, slices.min_ppm)
    norm = colors.LogNorm(slices.min_ppm, slices.max_ppm)
    return axes.imshow(
        seen.T, origin="lower", extent=(x0, x0 + nx * d, y0, y0 + ny * d), cmap=gas_map(), norm=norm, alpha=0.9,
        interpolation="none", zorder=0.5,
    )  # fmt: skip


def mean_ppm(slices: RecordedSlices) -> NDArray[np.float64]:
    """Return the (nx, ny) mean over all snapshots [ppm]."""
    total = np.zeros(slices.shape)
    for i in range(len(slices.tick)):
        total += slices.mixing_ratio_ppm(i)
    return total / len(slices.tick)


def ground_track(axes: Any, run: RunData, *, gas: bool = True) -> Any:
    """Draw plan, gas, sources with the success radius, and of each agent track, waypoints, start and first contact.

    Args:
        axes: Where to draw.
        run: The run.
        gas: Whether to draw the gas, its mean over the run.

    Returns:
        What a colour bar of the gas is made of, or None.
    """
    plan(axes, run)
    image = gas_on_plan(axes, run) if gas else None
    sources(axes, run)
    is_one = len(run.agents) == 1
    for i, agent in enumerate(run.agents):
        _track(axes, run, agent, i, label="track" if is_one else agent)
        _places(axes, run, agent, i, is_named=i == 0)
    return image


def swarm_tracks(axes: Any, run: RunData) -> Any:
    """Draw plan, gas and sources, and each agent's track with a dot every 10 s and a large one where it ends.

    Returns:
        What a colour bar of the gas is made of, or None.
    """
    plan(axes, run)
    image = gas_on_plan(axes, run)
    sources(axes, run)
    for i, agent in enumerate(run.agents):
        track = run.tracks[agent]
        _track(axes, run, agent, i, label=agent)
        every = np.searchsorted(track.time_s, np.arange(_TIME_MARK_S, track.time_s[-1], _TIME_MARK_S))
        x_m, y_m, _ = track.position_world_m.T
        color = get_line_style(i)["color"]
        axes.plot(x_m[every], y_m[every], ls="", marker="o", ms=2.2, color=color, zorder=5, gid=f"every_10_s/{agent}")
        axes.plot(x_m[-1:], y_m[-1:], ls="", marker="o", ms=5, color=color, mec=INK, mew=0.6, zorder=6)
        axes.plot(x_m[:1], y_m[:1], ls="", marker="s", ms=3.5, color="white", mec=color, zorder=6)
    return image


def tracks_of_runs(axes: Any, runs: Mapping[str, RunData]) -> Any:
    """Draw the tracks of several runs of one room over the plan and the gas of the first; each method has a look.

    Args:
        axes: Where to draw.
        runs: By label.

    Returns:
        What a colour bar of the gas is made of, or None.
    """
    first = next(iter(runs.values()))
    plan(axes, first)
    image = gas_on_plan(axes, first)
    sources(axes, first)
    methods = [run.methods[agent] for run in runs.values() for agent in run.agents]
    order = list(dict.fromkeys(methods))
    named: set[str] = set()
    for label, run in runs.items():
        for agent in run.agents:
            method = run.methods[agent]
            n = methods.count(method)
            text = "_" if method in named else method if n == 1 else f"{method}: {n} tracks"
            _track(axes, run, agent, order.index(method), label=text, gid=f"track/{label}/{agent}")
            named.add(method)
    return image


def sources(axes: Any, run: RunData) -> None:
    """Draw each source as a star, and around it the success radius where there is one."""
    patches = part_of_matplotlib("patches")
    radius_m = run.scenario.referee.success.drawn_radius_m
    for i, source in enumerate(run.scenario.gas.sources):
        x_m, y_m, _ = source.position_m
        axes.plot([x_m], [y_m], ls="", marker="*", ms=8, color=SOURCE, mec="white", mew=0.5, zorder=7,
                  label="source" if i == 0 else "_", gid=f"source/{i}")  # fmt: skip
        if radius_m:
            dashed = {"ec": SOURCE, "lw": 0.8, "ls": (0, (3, 2)), "label": "success radius" if i == 0 else "_"}
            axes.add_patch(patches.Circle((x_m, y_m), radius_m, fill=False, zorder=4, **dashed))


def success_by_start(
    axes: Any,
    xy_m: NDArray[np.floating],
    rate: NDArray[np.floating],
    n: NDArray[np.integer],
    *,
    solid: tuple[NDArray[np.bool_], tuple[float, float], float] | None = None,
    sources_m: NDArray[np.floating] | None = None,
    gid: str = "starts/all",
) -> None:
    """Draw how often the source was found from each start: the share of each disc that is filled, and the per cent.

    Args:
        axes: Where to draw.
        xy_m: (k, 2) starts [m].
        rate: (k,) shares of runs that found the source.
        n: (k,) runs.
        solid: (nx, ny) cells of the plan, the corner of the first [m], and their size [m].
        sources_m: (s, 2) sources [m].
        gid: Name of the starts in the figure's file.
    """
    patches = part_of_matplotlib("patches")
    if solid is not None:
        cells, (x0, y0), d = solid
        nx, ny = cells.shape
        rgba = _rgba(cells, SOLID)
        axes.imshow(rgba, origin="lower", extent=(x0, x0 + nx * d, y0, y0 + ny * d), interpolation="none", zorder=1)
    span_m = float(np.ptp(np.asarray(axes.get_xlim()))) if solid is not None else float(np.ptp(xy_m, axis=0).max() + 4)
    radius_m = 0.028 * span_m
    for (x_m, y_m), share, flights in zip(np.asarray(xy_m), rate, n, strict=True):
        axes.add_patch(patches.Circle((x_m, y_m), radius_m, fc="white", ec=INK, lw=0.6, zorder=3))
        if share > 0:
            axes.add_patch(patches.Wedge((x_m, y_m), radius_m, 90 - 360 * share, 90, fc=OKABE_ITO[0], lw=0, zorder=4))
        text = f"{100 * share:.0f} %" + (f" of {flights}" if len(n) < 10 else "")
        axes.annotate(
            text, (x_m, y_m), (0, -7), textcoords="offset points", ha="center", va="top", fontsize=6, zorder=5
        )
    axes.plot(*np.asarray(xy_m).T, ls="", marker=".", ms=0.1, color=OKABE_ITO[0], zorder=2, gid=gid)
    for x_m, y_m in sources_m if sources_m is not None else ():
        axes.plot([x_m], [y_m], ls="", marker="*", ms=8, color=SOURCE, mec="white", mew=0.5, zorder=7)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal")


def _track(axes: Any, run: RunData, agent: str, i: int, *, label: str, gid: str = "") -> None:
    x_m, y_m, _ = run.tracks[agent].position_world_m.T
    effects = part_of_matplotlib("patheffects")
    halo = effects.withStroke(linewidth=2.2, foreground="white", alpha=0.8)
    axes.plot(x_m, y_m, **get_line_style(i), lw=1.1, zorder=4.5, label=safe_text(label), gid=gid or f"track/{agent}",
              path_effects=[halo])  # fmt: skip


def _places(axes: Any, run: RunData, agent: str, i: int, *, is_named: bool) -> None:
    color, marks, waypoints = get_line_style(i)["color"], run.marks[agent], run.waypoints[agent].position_world_m
    if len(waypoints):
        axes.plot(*waypoints.T[:2], ls="", marker="o", ms=2.4, color="white", mec=color, mew=0.7, zorder=5,
                  label="waypoint" if is_named else "_", gid=f"waypoints/{agent}")  # fmt: skip
    shapes = {_START: ("s", "white", "start"), _FIRST_GAS: ("^", OKABE_ITO[4], "first contact with gas"),
              _DECLARED: ("X", "white", "declared")}  # fmt: skip
    for text, (shape, fill, label) in shapes.items():
        at = [k for k, found in enumerate(marks.label) if found == text]
        if at:
            axes.plot(*marks.position_world_m[at].T[:2], ls="", marker=shape, ms=5.5, color=fill, mec=INK, mew=0.7,
                      zorder=6, label=label if is_named else "_", gid=f"{text.replace(' ', '_')}/{agent}")  # fmt: skip


def _shade(axes: Any, run: RunData, cells: NDArray[np.bool_], color: str, *, zorder: float, label: str) -> None:
    if cells.any():
        # A picture has no place in a legend.
        axes.plot([], [], ls="", marker="s", ms=5, color=color, label=label)
        (x0, y0, _), (x1, y1, _) = run.environment.grid.origin_m, run.environment.grid.max_m
        axes.imshow(_rgba(cells, color), origin="lower", extent=(x0, x1, y0, y1), interpolation="none", zorder=zorder)


def _rgba(cells: NDArray[np.bool_], color: str) -> NDArray[np.float64]:
    colors = part_of_matplotlib("colors")
    rgba = np.zeros((*cells.T.shape, 4))
    rgba[cells.T] = colors.to_rgba(color)
    return rgba
