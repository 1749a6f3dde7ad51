"""How fast vehicles fly and drive: microseconds per 4 ms sub-step and times real time, on one core.

`make bench-robots` prints it and then how accurately they do; with `iris` as argument the script takes only those.
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "kit"))

from built_rooms import build_closed_room
from built_scenarios import build_agent, build_scenario

from gslcosim.base.quantities import PHYSICS_STEP_MS
from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Episode
from gslcosim.environment.model import Environment
from gslcosim.scenario.models.scenario import Scenario
from gslcosim_services.world.core import WorldCore

TICK_MS = 100
N_TICKS = 500
N_REPEATS = 7
MODELS = ("iris", "crazyflie", "holonomic", "rover")
# What those keep that change places and go out of each other's way, and how their rows are marked.
SEPARATION_M = 1.0
APART = " apart"
# Times real time that a quadrotor and ten of them are to reach.
TARGETS = {(model, n): times for model in ("iris", "crazyflie") for n, times in ((1, 400), (10, 40))}


def room() -> Environment:
    """Return a closed room of 30 x 15 x 8 m with wind."""
    return build_closed_room((150, 75, 40), cell_m=0.2, wind_m_s=(0.3, 0.3, 0.3))


def scenario(model: str, n_vehicles: int, separation_m: float) -> Scenario:
    """Return a scenario of vehicles of one model, two metres apart."""
    vehicle = {"model": model, "separation_m": separation_m}
    places_m = [(3.0 + 2.0 * i, 3.0, 0.1) for i in range(n_vehicles)]
    agents = (
        build_agent(f"agent_{i}", place_m, mode="lockstep", vehicle=vehicle) for i, place_m in enumerate(places_m)
    )
    return build_scenario(*agents, tick_ms=TICK_MS)


def seconds_per_tick(core: WorldCore, model: str, n_vehicles: int, *, change_places: bool) -> float:
    """Return the best of several measurements of a tick in flight, new waypoints every 10 s included.

    It is the time that the core spends on it: what else the machine does is left out.
    """
    best = float("inf")
    core.reset(Episode(seed=0))
    core.step(0, {})
    # The first second takes off and compiles.
    for tick in range(1, 11):
        core.step(tick, {})
    tick = 10
    for _ in range(N_REPEATS):
        begin = time.process_time()
        for _ in range(N_TICKS):
            tick += 1
            inbox = {}
            if tick % 100 == 50:
                is_far = tick % 200 == 50
                y_m = 12.0 if is_far else 3.0
                for i in range(n_vehicles):
                    place = n_vehicles - 1 - i if change_places and is_far else i
                    goal = (3.0 + 2.0 * place, y_m, 0.1 if model == "rover" else 3.0)
                    inbox[f"command/agent_{i}"] = Command(tick=tick - 1, kind="waypoint", position_world_m=goal)
            core.step(tick, inbox)
        best = min(best, (time.process_time() - begin) / N_TICKS)
    return best


def main() -> None:
    """Print one line for each vehicle model and number of vehicles, with its target where it has one."""
    environment = room()
    n_substeps = TICK_MS // PHYSICS_STEP_MS
    titles = f"{'n':>3} {'us/tick':>9} {'us/sub-step':>12} {'x real time':>12} {'at least':>9}"
    print(f"{'vehicle':<15} {titles}")  # noqa: T201
    for model in sys.argv[1:] or MODELS:
        apart = [(10, SEPARATION_M)] if (model, 10) in TARGETS else []
        for n_vehicles, separation_m in [(1, 0.0), (10, 0.0), *apart]:
            core = WorldCore(scenario(model, n_vehicles, separation_m), environment)
            tick_s = seconds_per_tick(core, model, n_vehicles, change_places=separation_m > 0)
            figures = f"{tick_s * 1e6:9.1f} {tick_s * 1e6 / n_substeps:12.2f} {TICK_MS * 1e-3 / tick_s:12.0f}"
            target = TARGETS.get((model, n_vehicles), "")
            name = model + (APART if separation_m else "")
            print(f"{name:<15} {n_vehicles:>3} {figures} {target:>9}")  # noqa: T201


if __name__ == "__main__":
    main()
