"""Rooms crossed from nine starts by a scripted agent, judged by the referee: `make crossings` prints the table.

Every crossing is a whole run in one process: world, gas, sensing, referee, and an agent that is asked at its waypoints
and answers with the place of the source. An Iris starts at (3, 7.5, 12)² m in the height of search, beside what stands
there, and has crossed the room when the referee says so: within a metre of the source and without a contact. Lengths
are relative to the referee's shortest way; of nine flights the median is shown. The air stands still, so that no wind
has to be solved.

Run with `python docs/studies/crossings.py`; with folders of GSL-Bench environments as arguments it takes these too.
"""

import itertools
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.model import Environment
from gslcosim.environment.paths.planner import free_space
from gslcosim.environment.store import load_environment
from gslcosim.runtime.run import run_scenario
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.models.scenario import Scenario

HERE = Path(__file__).parent
STARTS = tuple(itertools.product((3.0, 7.5, 12.0), repeat=2))
DIMENSIONS = ("2d", "3d")
SOURCE_M = (5.0, 1.0, 2.0)
HEIGHT_M = 2.0
# An Iris, and what it wants around its first place to hover [m].
RADIUS_M, ROOM_TO_HOVER_M = 0.38, 0.1


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """One run: how it ended after what time [s], and its way relative to the shortest where it succeeded."""

    start_m: tuple[float, float, float]
    outcome: str
    time_s: float
    way: float


def warehouse(seed: int) -> dict[str, Any]:
    """Return the environment of a scenario: a generated complex warehouse."""
    return {"layout": {"kind": "warehouse_complex", "size_m": [15.0, 15.0, 8.0], "seed": seed}}


def scenario(environment: dict[str, Any], start_m: tuple[float, ...], avoidance: str) -> Scenario:
    """Return the scenario of one crossing."""
    source = {"position_m": SOURCE_M, "filaments_per_s": 1}
    agent = {
        "name": "crosser",
        "start": {"python": "sent_to_the_source.py"},
        "vehicle": {"start_m": start_m, "search_height_m": HEIGHT_M, "hold_s": 0.0, "avoidance": avoidance},
        "sensors": [{"model": "tgs2600", "name": "nose"}],
    }
    fields = {
        "schema": "gslcosim/scenario/1",
        "name": "crossing",
        "environment": environment,
        "wind": {"solver": "uniform", "inlet_velocity_m_s": [0.0, 0.0, 0.0]},
        "gas": {"sources": [source], "warm_up_s": 0.0},
        "agents": [agent],
        "recording": {"enabled": False},
    }
    return Scenario.model_validate(fields)


def start_beside(
    environment: Environment, x_m: float, y_m: float, height_m: float = HEIGHT_M
) -> tuple[float, float, float]:
    """Return the nearest place to a start where the vehicle can hover, in the largest part of the room."""
    space = free_space(environment, radius_m=RADIUS_M, margin_m=ROOM_TO_HOVER_M).slab(height_m, height_m)
    largest = int(np.bincount(space.parts[space.parts > 0]).argmax())
    if space.part_of((x_m, y_m, 0.0)) == largest:
        return x_m, y_m, height_m
    near_m = space.nearest_m((x_m, y_m, 0.0), part=largest)
    if near_m is None:
        raise RuntimeError(f"expected free places {height_m:g} m high, was none.")
    return near_m[0], near_m[1], height_m


def cross(environment: dict[str, Any], avoidance: str, runs_dir: Path) -> list[Crossing]:
    """Fly from all nine starts of a room; its folder is made once and found again by each run."""
    folder = prepare_environment(scenario(environment, (3.0, 3.0, HEIGHT_M), avoidance), scenario_dir=HERE)
    room = load_environment(folder)
    return [_cross_from(start_beside(room, *start), environment, avoidance, runs_dir) for start in STARTS]


def _cross_from(
    start_m: tuple[float, float, float], environment: dict[str, Any], avoidance: str, runs_dir: Path
) -> Crossing:
    crossed = scenario(environment, start_m, avoidance)
    loaded = LoadedScenario(scenario=crossed, path=Path(__file__), directory=HERE, text="")
    result = run_scenario(loaded, runs_dir=runs_dir, processes="one").result
    if not result["valid"]:
        raise RuntimeError(f"expected a valid run, was {result}")
    [agent] = result["agents"]
    return Crossing(
        start_m=start_m,
        outcome=agent["outcome"],
        time_s=result["sim_time_s"],
        way=1.0 + (agent["movement_overhead"] or 0.0),
    )


def main() -> None:
    """Print a line for each room and number of dimensions; the exit code is 1 when a crossing failed."""
    rooms = {Path(folder).name: {"gsl_bench": str(Path(folder).absolute())} for folder in sys.argv[1:]}
    rooms |= {f"complex warehouse {seed}": warehouse(seed) for seed in (1, 2, 3)}
    is_missed = False
    sys.stdout.write(f"{'room':<20} {'avoids':>6} {'crossed':>8} {'way/shortest':>13} {'flight':>8} {'wall':>8}\n")
    for (name, environment), avoidance in itertools.product(rooms.items(), DIMENSIONS):
        began = time.perf_counter()
        with tempfile.TemporaryDirectory() as runs_dir:
            crossings = cross(environment, avoidance, Path(runs_dir))
        done = [crossing for crossing in crossings if crossing.outcome == "success"]
        is_missed |= len(done) < len(crossings)
        way, flight_s = (statistics.median(getattr(c, key) for c in crossings) for key in ("way", "time_s"))
        figures = f"{way:13.2f} {flight_s:6.1f} s {time.perf_counter() - began:6.1f} s"
        sys.stdout.write(f"{name:<20} {avoidance:>6} {len(done):>3} of {len(crossings)} {figures}\n")
    sys.exit(1 if is_missed else 0)


if __name__ == "__main__":
    main()
