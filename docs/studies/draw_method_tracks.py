"""Draws the picture of each bundled search method for docs/methods.md: its tracks over the gas, all in one case.

Run with `python docs/studies/draw_method_tracks.py [METHOD...]`; it needs the extra `report`. The case is the bundled
`warehouse_empty` with the young wind, flown in this process: the same room, gas, start and seed for all, PIDs as noses
(a MOX sensor where a method asks for ohms), and three vehicles for a swarm, or as many as it needs. Shades are the gas
at the height of search at the end of the flight.

A picture that is newer than all files of its method is not drawn again, so that the script goes on where it was
stopped; `--all` draws them again. Several may run at once with `--share 1/2` and `--share 2/2`.

The script is at the same time the agent that a run of it flies: `Tracked` makes the method that its name says, asks it,
and notes where the vehicle was.
"""

import argparse
import io
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.agent_kit import Agent, Briefing, Command, Observation
from gslcosim.base.bundled import bundled_agents
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.store import load_environment
from gslcosim.methods.card import CARD_FILE, MethodCard, load_card
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim.runtime.run import run_scenario
from gslcosim.scenario import load_scenario
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.models.scenario import Scenario
from gslcosim_formats.field_samplers import GroundTruth, compute_ground_truth

HERE = Path(__file__).parent
PICTURES = HERE.parent / "images" / "methods"
CASE, SEED = "warehouse_empty", 7
N_ROBOTS = 3
# Enough for the largest of the smallest swarms.
STARTS_M = (
    (12.0, 12.0, 0.2), (12.0, 9.0, 0.2), (9.0, 12.0, 0.2), (9.0, 9.0, 0.2), (12.0, 6.0, 0.2), (6.0, 12.0, 0.2),
    (6.0, 9.0, 0.2),
)  # fmt: skip
SEPARATION_M = 1.0
SENSORS = {
    "gas": {"model": "pid", "name": "nose"},
    "gas_ppm": {"model": "pid", "name": "nose"},
    "gas_ohm": {"model": "tgs2600", "name": "mox"},
    "wind": {"model": "anemometer", "name": "wind"},
    "range": {"model": "four_range_finders", "name": "ranges"},
    "camera": {"model": "camera", "name": "eye"},
}
# Left and right of the vehicle, where a method wants two of a kind [m].
ASIDE_M = 0.25
SIZE_PX, COLOURS = 420, 96
TRACK_COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:orange", "tab:purple", "tab:brown", "tab:cyan")
SLICE_M = 0.1


@dataclass
class Track:
    """Where a vehicle was, tick by tick, and what it declared, world frame [m]."""

    places_m: list[tuple[float, float, float]] = field(default_factory=list)
    declared_m: list[tuple[float, float, float]] = field(default_factory=list)


# By the names of agents; those of the run that was begun last. A run imports this file once more for each agent: all
# of them write into the one that was started as a script.
TRACKS: dict[str, Track] = {}


class Tracked(Agent):
    """A method by its name, before the first `__` of the agent's, whose track is noted in `TRACKS`."""

    def __init__(self, briefing: Briefing) -> None:
        self.track = sys.modules["__main__"].TRACKS.setdefault(briefing.agent, Track())
        self.method = load_python_agent(bundled_agents()[briefing.agent.split("__")[0]])(briefing)

    def observe(self, observation: Observation) -> None:
        """Note the place."""
        self.track.places_m.append(observation.position_world_m)
        self.method.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Note what is declared."""
        command = self.method.decide(observation)
        if command.declaration is not None:
            self.track.declared_m.append(command.declaration.position_world_m)
        return command

    def end(self, reason: str) -> None:
        """Tell the method."""
        self.method.end(reason)


def case_of(name: str, card: MethodCard) -> Scenario:
    """Return the scenario of a method's picture."""
    n_robots = card.robots if isinstance(card.robots, int) else min(max(N_ROBOTS, card.robots[0]), card.robots[1])
    loaded = load_scenario(CASE, overrides=("gas.turbulence.kind=none",))
    fields = loaded.scenario.model_dump(by_alias=True, exclude_unset=True)
    vehicle = fields["agents"][0]["vehicle"]
    fields["agents"] = [
        {
            "name": name if i == 0 else f"{name}__{i + 1}",
            "start": {"python": Path(__file__).name},
            "vehicle": vehicle | {"start_m": STARTS_M[i], "separation_m": SEPARATION_M if n_robots > 1 else 0.0},
            "sensors": sensors_of(card),
            "knows": {item: ("3d" if card.dimensions == 3 else True) if item == "map" else True
                      for item in card.needs.knows},
        }
        for i in range(n_robots)
    ]  # fmt: skip
    fields["channels"] = [{"name": "radio"}] if card.needs.radio else []
    fields["recording"] = {"enabled": False}
    fields["seed"] = SEED
    return Scenario.model_validate(fields)


def sensors_of(card: MethodCard) -> list[dict[str, Any]]:
    """Return the sensors that a method needs; a PID where it needs none, for a vehicle must have one."""
    found: dict[str, dict[str, Any]] = {}
    for kind, n in (card.needs.sensors or {"gas": 1}).items():
        for i in range(n):
            sensor: dict[str, Any] = dict(SENSORS[kind])
            if n > 1:
                sensor["name"] += f"_{i + 1}"
                sensor["mount_m"] = (0.1, ASIDE_M * (1 - 2 * i), 0.0)
            found[sensor["name"]] = sensor
    return list(found.values())


def flown(scenario: Scenario) -> tuple[dict[str, Track], dict[str, Any]]:
    """Fly a case; return the tracks by agent, and the run's result."""
    TRACKS.clear()
    loaded = LoadedScenario(scenario=scenario, path=Path(__file__), directory=HERE, text="")
    with tempfile.TemporaryDirectory() as runs_dir:
        result = run_scenario(loaded, runs_dir=Path(runs_dir), processes="one").result
    if not result["valid"]:
        raise RuntimeError(f"expected a valid run, was {result}")
    return dict(TRACKS), result


def gas_of(scenario: Scenario, time_s: float) -> GroundTruth:
    """Return the true gas of a case at a time."""
    folder = prepare_environment(scenario, scenario_dir=HERE)
    return compute_ground_truth(scenario, load_environment(folder), time_s=time_s, spacing_m=SLICE_M)


def draw(name: str, card: MethodCard) -> Path:
    """Fly a method and draw its picture; return the file, which appears whole or not at all."""
    scenario = case_of(name, card)
    tracks, result = flown(scenario)
    picture = _picture(scenario, card, tracks, result, gas_of(scenario, result["sim_time_s"]))
    PICTURES.mkdir(parents=True, exist_ok=True)
    path = PICTURES / f"{name}.png"
    part = path.with_suffix(f".{time.monotonic_ns()}.part")
    part.write_bytes(picture)
    return part.replace(path)


def _picture(
    scenario: Scenario, card: MethodCard, tracks: dict[str, Track], result: dict[str, Any], gas: GroundTruth
) -> bytes:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from PIL import Image

    figure, axis = plt.subplots(figsize=(SIZE_PX / 100, SIZE_PX / 100), dpi=100)
    _draw_gas(axis, scenario, gas)
    for i, track in enumerate(tracks.values()):
        places_m = np.array(track.places_m)
        axis.plot(places_m[:, 0], places_m[:, 1], lw=1.2, color=TRACK_COLOURS[i % len(TRACK_COLOURS)])
        axis.plot(*places_m[0, :2], "o", ms=5, color="black")
        if track.declared_m:
            axis.plot(*np.array(track.declared_m)[-1, :2], "o", ms=12, mfc="none", mec="tab:red", mew=1.5)
    source_m = scenario.gas.sources[0].position_m
    axis.plot(source_m[0], source_m[1], "x", ms=9, mew=2, color="black")
    axis.set_title(f"{card.title}: {_ending(result)}", fontsize=9)
    axis.set_aspect("equal")
    axis.tick_params(labelsize=7)
    figure.tight_layout(pad=0.4)
    full, small = io.BytesIO(), io.BytesIO()
    figure.savefig(full)
    plt.close(figure)
    Image.open(full).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(small, "PNG", optimize=True)
    return small.getvalue()


def _ending(result: dict[str, Any]) -> str:
    outcomes = {agent["outcome"] for agent in result["agents"]}
    if "agent_failed" in outcomes:
        raise RuntimeError(f"expected agents that fly to the end, was {result['faults']}")
    after = f"after {result['sim_time_s']:.0f} s"
    if "success" in outcomes:
        return f"at the source {after}"
    return f"collided {after}" if "collision" in outcomes else f"not found {after}"


def _draw_gas(axis: Any, scenario: Scenario, gas: GroundTruth) -> None:
    x_m, y_m, z_m = gas.grid.axes_m()
    level = int(np.argmin(np.abs(z_m - scenario.agents[0].vehicle.search_height_m)))
    shown = np.log10(np.maximum(gas.mixing_ratio_ppm[0, :, :, level], 1e-2))
    extent = (x_m[0], x_m[-1], y_m[0], y_m[-1])
    axis.imshow(shown.T, origin="lower", extent=extent, cmap="Greys", vmin=-2.0, vmax=1.5, interpolation="bilinear")
    axis.set_xlim(extent[:2])
    axis.set_ylim(extent[2:])


def methods() -> dict[str, MethodCard]:
    """Return the cards of the bundled Python methods by name."""
    paths = {name: path.with_name(CARD_FILE) for name, path in bundled_agents().items()}
    return {name: load_card(path) for name, path in paths.items() if path.is_file()}


def is_current(name: str) -> bool:
    """Return whether a method's picture is newer than all its files."""
    picture = PICTURES / f"{name}.png"
    newest = max(path.stat().st_mtime for path in bundled_agents()[name].parent.glob("*.*"))
    return picture.is_file() and picture.stat().st_mtime > newest


def main() -> None:
    """Draw what is to be drawn; the exit code is 1 when one failed."""
    parser = argparse.ArgumentParser(description="Draws the pictures of docs/methods.md.")
    parser.add_argument("names", nargs="*", help="methods to draw (default: those without a current picture)")
    parser.add_argument("--all", action="store_true", help="draw all of them anew")
    parser.add_argument("--share", default="1/1", metavar="I/N", help="take only the I-th of N shares of them")
    arguments = parser.parse_args()
    i, n = map(int, arguments.share.split("/"))
    cards, n_failed = methods(), 0
    wanted = arguments.names or [name for name in cards if arguments.all or not is_current(name)]
    for name in wanted[i - 1 :: n]:
        began = time.perf_counter()
        try:
            path = draw(name, cards[name])
            said = f"{path.stat().st_size / 1000:.0f} kB"
        except Exception as error:  # the others are drawn all the same
            n_failed, said = n_failed + 1, f"FAILED: {str(error)[:300]}"
        sys.stdout.write(f"{name:<24} {said} ({time.perf_counter() - began:.0f} s)\n")
        sys.stdout.flush()
    sys.exit(1 if n_failed else 0)


if __name__ == "__main__":
    main()
