"""Draws the picture of each bundled suite's README: a plan of every room at the height of search, with its places.

Run with `python docs/studies/draw_suite_cases.py [SUITE...]`; it needs the extra `report`. Dark is solid at the height
of search, grey what is solid below it. Blue lines are inlets and outlets, red crosses sources, black plus signs decoys,
dots starts. With `--wind` arrows show the mean wind at that height; rooms whose wind has not been solved yet are then
solved, which takes a minute or more for each.

`--out DIR` puts the pictures elsewhere than beside the suites.
"""

import argparse
import dataclasses
import io
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.base.bundled import bundled_suites
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.plan_view import PlanOpening, PlanView, space_arrows
from gslcosim.environment.store import load_environment
from gslcosim_bench.cases import build_plan, load_suite
from gslcosim_bench.cases.models import Trial
from gslcosim_bench.cases.suite_files import LoadedSuite

PICTURE = "cases.png"
COLUMNS, MOST_COLUMNS, FEW = 3, 6, 12
PANEL_PX, COLOURS = 250, 64
ARROWS_A_SIDE = 12
# Slower air has no arrow [m/s].
LEAST_WIND_M_S = 0.02


@dataclass
class Panel:
    """One room of a suite: a trial in it, and all places in it, world frame [m]."""

    title: str
    trial: Trial
    starts_m: set[tuple[float, ...]] = field(default_factory=set)
    sources_m: set[tuple[float, ...]] = field(default_factory=set)
    decoys_m: set[tuple[float, ...]] = field(default_factory=set)


def with_one_entry(loaded: LoadedSuite) -> LoadedSuite:
    """Return a suite with its first entry alone: all entries meet the same cases."""
    entry = loaded.suite.entries_with_anchors[:1]
    suite = loaded.suite.model_copy(update={"entries": entry, "anchors": ()})
    return dataclasses.replace(loaded, suite=suite)


def panels_of(name: str) -> list[Panel]:
    """Return the rooms of a suite in its order, each with the places that trials have in it."""
    panels: dict[tuple[str, str], Panel] = {}
    for trial in build_plan(with_one_entry(load_suite(name))).trials:
        panel = panels.setdefault((trial.scenario, trial.room), Panel(trial.scenario, trial))
        panel.starts_m.add(trial.resolved.agents[0].vehicle.start_m)
        gas = trial.resolved.gas
        panel.sources_m |= {source.position_m for source in gas.searched}
        panel.decoys_m |= {source.position_m for source in gas.sources if source not in gas.searched}
    found = list(panels.values())
    for panel in found:
        of_same = [other for other in found if other.trial.scenario == panel.trial.scenario]
        if len(of_same) > 1:
            panel.title += f", {of_same.index(panel) + 1}"
    return found


def picture_of(panels: list[Panel], *, has_wind: bool) -> bytes:
    """Return the plans of rooms side by side, as PNG."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from PIL import Image

    n_columns = min(len(panels), COLUMNS if len(panels) <= FEW else MOST_COLUMNS)
    if len(panels) == FEW:
        n_columns = 4
    n_rows = -(-len(panels) // n_columns)
    size = (n_columns * PANEL_PX / 100, n_rows * PANEL_PX / 100)
    figure, axes = plt.subplots(n_rows, n_columns, figsize=size, dpi=100, squeeze=False)
    for axis in axes.flat[len(panels) :]:
        axis.set_axis_off()
    for axis, panel in zip(axes.flat, panels, strict=False):
        draw_panel(axis, panel, has_wind=has_wind)
    figure.tight_layout(pad=0.5)
    full, small = io.BytesIO(), io.BytesIO()
    figure.savefig(full)
    plt.close(figure)
    Image.open(full).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(small, "PNG", optimize=True)
    return small.getvalue()


def draw_panel(axis: Any, panel: Panel, *, has_wind: bool) -> None:
    """Draw the plan of a room with its places."""
    scenario = panel.trial.resolved
    room = build_geometry(scenario.environment, scenario.wind, scenario_dir=panel.trial.directory)
    vehicle = scenario.agents[0].vehicle
    plan = PlanView.of(room, vehicle.search_height_m)
    x_m, to_x_m, y_m, to_y_m = plan.extent_m
    shades = np.where(plan.solid, 2, np.where(plan.below, 1, 0))
    axis.imshow(shades.T, origin="lower", extent=plan.extent_m, cmap="Greys", vmin=0, vmax=3, interpolation="nearest")
    if has_wind:
        draw_wind(axis, panel)
    for seen in plan.openings:
        draw_opening(axis, seen)
    starts_m = np.array(sorted(panel.starts_m))
    axis.plot(starts_m[:, 0], starts_m[:, 1], "o", ms=4, color="black", mec="white", mew=0.6, clip_on=False)
    for places_m, marker, colour in ((panel.decoys_m, "+", "black"), (panel.sources_m, "x", "tab:red")):
        # Without any, a plot would have no bounds to lay out.
        if places_m:
            x_m_of, y_m_of = np.array(sorted(places_m)).T[:2]
            axis.plot(x_m_of, y_m_of, marker, ms=7, mew=1.8, color=colour, clip_on=False)
    axis.set_title(f"{panel.title}, {vehicle.search_height_m:g} m up", fontsize=8)
    axis.set_aspect("equal")
    axis.set_xlim(x_m, to_x_m)
    axis.set_ylim(y_m, to_y_m)
    axis.tick_params(labelsize=6, length=2)


def draw_opening(axis: Any, seen: PlanOpening) -> None:
    """Draw an inlet or outlet at a side as a line, and an arrow at an inlet."""
    if not seen.is_at_side:
        return
    colour = "tab:blue" if seen.is_inlet else "tab:cyan"
    axis.plot(*zip(*seen.path_m(), strict=True), lw=4, color=colour, clip_on=False, solid_capstyle="butt")
    if seen.is_inlet:
        x_m, y_m = np.mean(seen.corners_m, axis=0)
        u, v = seen.opening.velocity_m_s[:2]
        speed = max(np.hypot(u, v), 1e-9)
        axis.annotate(
            "", xytext=(x_m, y_m), xy=(x_m + 1.5 * u / speed, y_m + 1.5 * v / speed),
            arrowprops={"arrowstyle": "-|>", "color": "tab:blue", "lw": 1.5, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip


def draw_wind(axis: Any, panel: Panel) -> None:
    """Draw the mean wind at the height of search, solved now if it has not been before."""
    scenario = panel.trial.resolved
    environment = load_environment(prepare_environment(scenario, scenario_dir=panel.trial.directory))
    plan = PlanView.of(environment, scenario.agents[0].vehicle.search_height_m)
    mean_m_s = environment.wind.velocity_m_s[:, :, :, plan.layer, :2].mean(axis=0)
    cells, spacing = space_arrows(~plan.solid, ARROWS_A_SIDE)
    x_m, y_m = (np.array(plan.grid.origin_m[:2]) + (cells + spacing / 2 - spacing // 2) * plan.grid.cell_m).T
    u, v = mean_m_s[cells[:, 0], cells[:, 1]].T
    speed = np.hypot(u, v)
    # Roots, so that slow air has arrows that can be seen.
    shown = np.where(speed > LEAST_WIND_M_S, 1.0 / np.sqrt(np.maximum(speed, LEAST_WIND_M_S)), np.nan)
    axis.quiver(x_m, y_m, u * shown, v * shown, color="tab:blue", alpha=0.6, scale=ARROWS_A_SIDE, width=0.006)


def main() -> None:
    """Draw the pictures of the suites that are named, or of all."""
    parser = argparse.ArgumentParser(description="Draws the pictures of the bundled suites' READMEs.")
    parser.add_argument("names", nargs="*", help="suites (default: all)")
    parser.add_argument("--wind", action="store_true", help="with arrows of wind; solves what is not solved yet")
    parser.add_argument("--out", type=Path, help="folder for the pictures, as SUITE.png")
    arguments = parser.parse_args()
    for name in arguments.names or sorted(bundled_suites()):
        picture = picture_of(panels_of(name), has_wind=arguments.wind)
        path = arguments.out / f"{name}.png" if arguments.out else bundled_suites()[name].parent / PICTURE
        path.write_bytes(picture)
        sys.stdout.write(f"{path} {len(picture) / 1000:.0f} kB\n")


if __name__ == "__main__":
    main()
