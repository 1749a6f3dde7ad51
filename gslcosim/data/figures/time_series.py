"""Curves over time: distance, gas and sensor, belief; single, and as bundles of many runs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.data.figures.style import FAINT, INK, OKABE_ITO, SOURCE, get_line_style, safe_text
from gslcosim.data.run import RunData
from gslcosim.data.streams import RecordedSeries

Floats = NDArray[np.float64]
Curves = Sequence[tuple[Floats, Floats]]
_N_TIMES = 201
_MOST_THIN_LINES = 40


def distance(axes: Any, run: RunData) -> None:
    """Draw the distance of each agent to the nearest source, the success radius, and the first contact with gas."""
    is_one = len(run.agents) == 1
    for i, agent in enumerate(run.agents):
        curve = run.figure(agent, "distance")
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
        axes: Where to draw.
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
    found = [one for one in run.samples if one.agent == name and one.quantity == "mixing_ratio"]
    several = len({one.gas for one in found}) > 1
    for i, one in enumerate(found):
        label = f"{one.sensor}, {one.gas}" if several else one.sensor
        axes.plot(one.time_s, one.value, **get_line_style(i), lw=0.8, label=safe_text(label),
                  gid=f"true_ppm/{name}/{one.sensor}/{one.gas}")  # fmt: skip
    _time_axis(axes, run, "true mixing\nratio [ppm]")


def sensor_response(axes: Any, run: RunData, *, agent: str | None = None) -> None:
    """Draw what the gas sensors of an agent reported, by default of the first, in the unit of the first sensor."""
    name = agent or run.agents[0]
    found = [one for one in run.readings if one.agent == name and one.quantity == "response"]
    found = [one for one in found if one.unit == found[0].unit]
    for i, one in enumerate(found):
        axes.plot(one.time_s, one.value, **get_line_style(i), lw=0.8, label=safe_text(one.sensor),
                  gid=f"response/{name}/{one.sensor}")  # fmt: skip
    unit = found[0].unit if found else ""
    _time_axis(axes, run, f"reported\n[{ {'ohm': 'Ω', '1': '-'}.get(unit, unit) }]")


def belief_quality(axes: Any, run: RunData) -> None:
    """Draw the probability that each belief gives to the success radius around the sources."""
    for i, agent in enumerate(run.beliefs):
        curve = run.figure(agent, "belief_mass_near")
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
