"""Rehearses a world, flies it around a wall and past another vehicle, and prints what was compiled or loaded in flight.

`test_warmup.py` runs it in a process of its own, in which no other test has used a kernel before.
"""

import json
import sys
from pathlib import Path

from numba.core.registry import CPUDispatcher

from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Episode
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.store import load_environment
from gslcosim.runtime.warmup import warm_up
from gslcosim.scenario import load_scenario
from gslcosim_services.world.core import WorldCore

SCENARIO = Path(__file__).parents[2] / "end_to_end" / "around_a_wall.yaml"


def compiled():
    modules = [module for name, module in sys.modules.items() if name.startswith("gslcosim")]
    kernels = [value for module in modules for value in vars(module).values() if isinstance(value, CPUDispatcher)]
    return {f"{kernel.py_func.__name__}{signature}" for kernel in kernels for signature in kernel.signatures}


def main():
    loaded = load_scenario(SCENARIO)
    scenario = loaded.scenario
    core = WorldCore(scenario, load_environment(prepare_environment(scenario, scenario_dir=loaded.directory)))
    warm_up(core, scenario)
    before = compiled()
    core.reset(Episode(seed=0))
    inbox, n_bends = {}, 0
    for tick in range(300):
        bodies = core.step(tick, inbox)["truth/bodies"].bodies
        asked = [body for body in bodies if body.awaiting_command]
        inbox = {f"command/{body.agent}": crossing(tick, body) for body in asked}
        n_bends = max(n_bends, *(len(body.planned_path_world_m) for body in bodies))
    found = {"in_flight": sorted(compiled() - before), "n_bends": n_bends, "n_rehearsed": len(before)}
    sys.stdout.write(json.dumps(found))


def crossing(tick, body):
    x_m = 8.0 - round(body.position_world_m[0])
    # The first time into the wall, so that the place is moved.
    place_m = (4.0 if tick < 60 else x_m, 2.0, 1.0)
    return Command(tick=tick, kind="waypoint", position_world_m=place_m)


if __name__ == "__main__":
    main()
