"""Figures in space: plans from above, sections through wind and gas, tracks, and beliefs."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Cell
from gslcosim.environment.plan_view import Extent, PlanView, arrow_vectors, scale_of_arrows, space_arrows
from gslcosim_data.figures.style import (
    BELIEF_MAP,
    BELOW,
    FAINT,
    INK,
    OKABE_ITO,
    SOLID,
    SOURCE,
    SPEED_MAP,
    gas_map,
    get_line_style,
    part_of_matplotlib,
    safe_text,
)
from gslcosim_data.run import RunData
from gslcosim_data.streams import RecordedSlices

_START, _FIRST_GAS, _DECLARED = "start", "first gas", "declared"
_TIME_MARK_S = 10.0
_ARROWS_PER_SIDE = 18
_DECADES = 3


def plan(axes: Any, run: RunData) -> None:
    """Draw the room: what is solid at search height dark, what ends below it pale; openings as lines at the sides.

    Args:
        axes: Where to draw, x to the right and y up [m].
    """
    draw_plan(axes, PlanView.of(run.environment, run.scenario.slice_height_m))


def draw_plan(axes: Any, view: PlanView) -> None:
    """Draw a plan view, and set the axes to it; what ends below the height is seen by its edges through gas."""
    _shade(axes, view.solid, view.extent_m, SOLID, zorder=1.2, label="obstacle")
    _shade(axes, view.below, view.extent_m, BELOW, zorder=0.4, label="obstacle that ends below", edge=SOLID)
    edges = part_of_matplotlib("collections").LineCollection(
        view.outline_m(view.below), colors=SOLID, linewidths=0.6, zorder=0.8
    )
    axes.add_collection(edges)
    for seen in view.openings:
        ls = "-" if seen.is_inlet else (0, (1, 1))
        lw = 2.5 if seen.is_at_side else 1.0
        axes.plot(*zip(*seen.path_m(), strict=True), color=INK, lw=lw, ls=ls, solid_capstyle="butt", clip_on=False,
                  zorder=3, label=seen.opening.kind)  # fmt: skip
    x0, x1, y0, y1 = view.extent_m
    axes.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal")


def gas_on_plan(axes: Any, run: RunData, *, time_s: float | None = None, gas: str | None = None) -> Any:
    """Draw the gas at search height on a logarithmic scale.

    Args:
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
        _fill_cells(axes, cells, (x0, x0 + nx * d, y0, y0 + ny * d), SOLID, zorder=1)
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


def _shade(
    axes: Any, cells: NDArray[np.bool_], extent: Extent, color: str, *, zorder: float, label: str, edge: str = ""
) -> None:
    if cells.any():
        # A picture has no place in a legend.
        axes.plot([], [], ls="", marker="s", ms=5, color=color, mec=edge or color, mew=0.6, label=label)
        _fill_cells(axes, cells, extent, color, zorder=zorder)


def _fill_cells(axes: Any, cells: NDArray[np.bool_], extent: Extent, color: str, *, zorder: float) -> None:
    rgba = np.zeros((*cells.T.shape, 4))
    rgba[cells.T] = part_of_matplotlib("colors").to_rgba(color)
    axes.imshow(rgba, origin="lower", extent=extent, interpolation="none", zorder=zorder)


def wind_section(axes: Any, run: RunData, *, normal: Literal["y", "z"] = "z", time_s: float = 0.0) -> Any:
    """Draw speed and direction of the wind in a plane through the first source.

    Args:
        normal: `z`: the layer at search height; `y`: the vertical plane along x.
        time_s: When [s].

    Returns:
        What a colour bar of the speed [m/s] is made of.
    """
    grid, wind_m_s = run.environment.grid, run.wind_m_s(time_s)
    axis = {"y": 1, "z": 2}[normal]
    at_m = run.scenario.slice_height_m if normal == "z" else run.scenario.gas.sources[0].position_m[1]
    i = grid.index_at(axis, at_m)
    plane = np.take(wind_m_s, i, axis=axis).astype(np.float64)
    solid = np.take(run.environment.occupancy, i, axis=axis) == Cell.SOLID
    across = 1 if normal == "z" else 2
    speed = np.ma.array(np.linalg.norm(plane, axis=-1), mask=solid)
    extent = (grid.origin_m[0], grid.max_m[0], grid.origin_m[across], grid.max_m[across])
    top = float(np.percentile(np.linalg.norm(wind_m_s, axis=-1), 99.5))
    image = axes.imshow(speed.T, origin="lower", extent=extent, cmap=SPEED_MAP, vmin=0, vmax=2.2 * max(top, 1e-9),
                        interpolation="none", zorder=0)  # fmt: skip
    _fill_cells(axes, solid, extent, SOLID, zorder=1)
    cells, spacing = space_arrows(~solid, _ARROWS_PER_SIDE)
    i_x, i_y = cells.T
    winds_m_s, spacing_m = plane[i_x, i_y][:, (0, across)], spacing * grid.cell_m
    arrows_m = arrow_vectors(winds_m_s, spacing_m, scale_of_arrows(np.linalg.norm(winds_m_s, axis=-1), spacing_m))
    corner_m = np.array([grid.origin_m[0], grid.origin_m[across]])
    middles_m = corner_m + (cells + spacing / 2 - spacing // 2) * grid.cell_m
    axes.quiver(*middles_m.T, *arrows_m.T, color=OKABE_ITO[0], pivot="mid", angles="xy", scale_units="xy", scale=1.0,
                width=0.0045, zorder=2, gid="wind")  # fmt: skip
    x_m, y_m, z_m = run.scenario.gas.sources[0].position_m
    axes.plot([x_m], [y_m if normal == "z" else z_m], ls="", marker="*", ms=8, color=SOURCE, mec="white", mew=0.5,
              zorder=3, label="source")  # fmt: skip
    axes.set(xlabel="x [m]", ylabel="y [m]" if normal == "z" else "z [m]", xlim=extent[:2], ylim=extent[2:])
    axes.set_aspect("equal")
    axes.set_title(f"{'z' if normal == 'z' else 'y'} = {at_m:g} m, {time_s:g} s", loc="left")
    return image


def gas_section(axes: Any, run: RunData, *, time_s: float | None = None) -> Any:
    """Draw the gas in the vertical plane along x through the first source, from the recorded filaments.

    A filament of standard deviation sigma is a Gaussian puff whose mixing ratio at the centre is ppm0 (sigma0/sigma)^3
    (Farrell et al. 2002), as in `gslcosim_services.fields`; what lies behind walls is drawn as if they were not there.

    Args:
        time_s: When [s]; by default the last snapshot.

    Returns:
        What a colour bar [ppm] is made of; None where there are no filaments.
    """
    filaments = run.filaments
    if not len(filaments.tick):
        return None
    end_s = float(filaments.time_s[-1])
    k = max(int(np.searchsorted(filaments.time_s, (end_s if time_s is None else time_s) + 1e-9, side="right")) - 1, 0)
    source, grid = run.scenario.gas.sources[0], run.environment.grid
    y_m = source.position_m[1]
    x, z = grid.axis_centres_m(0), grid.axis_centres_m(2)
    ppm = _puffs_ppm(*filaments.snapshot(k), source.ppm, source.sigma_m, x, z, y_m)
    solid = np.take(run.environment.occupancy, grid.index_at(1, y_m), axis=1) == Cell.SOLID
    extent = (grid.origin_m[0], grid.max_m[0], grid.origin_m[2], grid.max_m[2])
    colors = part_of_matplotlib("colors")
    image = axes.imshow(
        np.ma.masked_less(ppm, source.ppm / 10**_DECADES).T, origin="lower", extent=extent, cmap=gas_map(),
        norm=colors.LogNorm(source.ppm / 10**_DECADES, source.ppm), interpolation="none", zorder=0,
    )  # fmt: skip
    _fill_cells(axes, solid, extent, SOLID, zorder=1)
    axes.plot([source.position_m[0]], [source.position_m[2]], ls="", marker="*", ms=8, color=SOURCE, mec="white",
              mew=0.5, zorder=3, label="source")  # fmt: skip
    axes.set(xlabel="x [m]", ylabel="z [m]", xlim=extent[:2], ylim=extent[2:])
    axes.set_aspect("equal")
    axes.set_title(f"y = {y_m:g} m, {filaments.time_s[k]:g} s", loc="left")
    return image


def track_3d(axes: Any, run: RunData) -> None:
    """Draw the tracks in space, with their shadows on the floor; `axes` are of `projection="3d"`."""
    grid = run.environment.grid
    for i, agent in enumerate(run.agents):
        x, y, z = run.tracks[agent].position_world_m.T
        label = "track" if len(run.agents) == 1 else safe_text(agent)
        axes.plot(
            x,
            y,
            np.full_like(z, grid.origin_m[2]),
            color=FAINT,
            lw=0.6,
            label="shadow on the floor" if i == 0 else "_",
        )
        axes.plot(x, y, z, **get_line_style(i), label=label, gid=f"track_3d/{agent}")
        axes.plot(x[:1], y[:1], z[:1], ls="", marker="s", ms=4, color="white", mec=INK, mew=0.7,
                  label="start" if i == 0 else "_")  # fmt: skip
    for i, source in enumerate(run.scenario.gas.sources):
        x_m, y_m, z_m = source.position_m
        axes.plot([x_m], [y_m], [z_m], ls="", marker="*", ms=8, color=SOURCE, mec="white", mew=0.5,
                  label="source" if i == 0 else "_")  # fmt: skip
        axes.plot([x_m, x_m], [y_m, y_m], [grid.origin_m[2], z_m], color=SOURCE, lw=0.5)
    _boxes(axes, run)
    axes.set(
        xlim=(grid.origin_m[0], grid.max_m[0]), ylim=(grid.origin_m[1], grid.max_m[1]),
        zlim=(grid.origin_m[2], grid.max_m[2]), xlabel="x [m]", ylabel="y [m]", zlabel="z [m]",
    )  # fmt: skip
    axes.locator_params(nbins=4)
    axes.set_box_aspect(np.subtract(grid.max_m, grid.origin_m), zoom=0.82)


def belief(axes: Any, run: RunData, agent: str, i: int, *, most: float | None = None) -> Any:
    """Draw an agent's i-th belief over the plan, and where the agent was.

    Args:
        most: The probability of a cell that is darkest; by default the belief's greatest. Colours go with the square
            root, as in the recording.

    Returns:
        What a colour bar of the probability is made of.
    """
    beliefs = run.beliefs[agent]
    one, p = beliefs.belief[i], beliefs.in_plane(i)
    (x0, y0, _), d, (nx, ny) = one.origin_m, one.cell_m, p.shape
    norm = part_of_matplotlib("colors").PowerNorm(0.5, vmin=0, vmax=most or p.max())
    image = axes.imshow(p.T, origin="lower", extent=(x0, x0 + nx * d, y0, y0 + ny * d), cmap=BELIEF_MAP, norm=norm,
                        interpolation="none", zorder=0.5)  # fmt: skip
    plan(axes, run)
    track = run.tracks[agent]
    passed = track.tick <= beliefs.tick[i]
    x, y, _ = track.position_world_m[passed].T
    axes.plot(x, y, color=OKABE_ITO[1], lw=0.9, zorder=4, gid=f"belief_track/{agent}/{i}", label="track so far")
    axes.plot(x[-1:], y[-1:], ls="", marker="o", ms=3.5, color=OKABE_ITO[1], mec=INK, mew=0.6, zorder=5)
    for source in run.scenario.gas.sources:
        axes.plot(*source.position_m[:2], ls="", marker="*", ms=7, color=SOURCE, mec="white", mew=0.5, zorder=6)
    axes.set_title(f"{beliefs.time_s[i]:.0f} s", loc="left")
    return image


def _puffs_ppm(
    centres_m: NDArray[np.float64], sigmas_m: NDArray[np.float64], ppm0: float, sigma0_m: float,
    x_m: NDArray[np.float64], z_m: NDArray[np.float64], y_m: float,
) -> NDArray[np.float64]:  # fmt: skip
    ppm = np.zeros((len(x_m), len(z_m)))
    for (x, y, z), sigma in zip(centres_m, sigmas_m, strict=True):
        if abs(y - y_m) > 4 * sigma:
            continue
        i0, i1 = np.searchsorted(x_m, (x - 4 * sigma, x + 4 * sigma))
        k0, k1 = np.searchsorted(z_m, (z - 4 * sigma, z + 4 * sigma))
        squared = (x_m[i0:i1, None] - x) ** 2 + (y_m - y) ** 2 + (z_m[None, k0:k1] - z) ** 2
        ppm[i0:i1, k0:k1] += ppm0 * (sigma0_m / sigma) ** 3 * np.exp(-squared / (2 * sigma**2))
    return ppm


# As outlines: solid boxes would hide what is behind them.
def _boxes(axes: Any, run: RunData) -> None:
    for box in run.environment.boxes:
        if box.kind != "obstacle":
            continue
        (x0, y0, z0), (x1, y1, z1) = box.min_m, box.max_m
        for z in (z0, z1):
            axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], [z] * 5, color=SOLID, lw=0.4, alpha=0.45)
        for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)):
            axes.plot([x, x], [y, y], [z0, z1], color=SOLID, lw=0.4, alpha=0.45)
