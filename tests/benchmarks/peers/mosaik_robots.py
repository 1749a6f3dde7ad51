"""Point masses and their agents as entities of two mosaik simulators in this process, at 10 Hz; see robots.py.

python mosaik_robots.py --robots 100
"""

import argparse
import sys
from importlib.metadata import version
from typing import Any

import mosaik
import mosaik_api_v3
from loguru import logger
from robots import answer

TICK_S, N_TICKS = 0.1, 100
LAG = 0.2


def _meta(model: str, attributes: list[str]) -> mosaik_api_v3.Meta:
    models = {model: {"public": True, "params": [], "attrs": attributes}}
    return {"api_version": "3.0", "type": "time-based", "models": models}


class Vehicles(mosaik_api_v3.Simulator):
    """Masses whose velocity lags what is wanted."""

    def __init__(self) -> None:
        super().__init__(_meta("Vehicle", ["place", "wanted"]))
        self._states: dict[str, list[float]] = {}

    def create(self, num: int, model: str, **parameters: Any) -> list[mosaik_api_v3.CreateResult]:
        """Make the masses, at rest."""
        self._states = {str(i): [0.0, 0.0] for i in range(num)}
        return [{"eid": name, "type": model} for name in self._states]

    def step(self, time: int, inputs: mosaik_api_v3.InputData, max_advance: int) -> int:
        """Advance all masses by a tick."""
        for name, state in self._states.items():
            for wanted in inputs.get(name, {}).get("wanted", {}).values():
                state[1] += LAG * (wanted - state[1])
            state[0] += TICK_S * state[1]
        return time + 1

    def get_data(self, outputs: mosaik_api_v3.OutputRequest) -> mosaik_api_v3.OutputData:
        """Return where they are."""
        return {name: {"place": self._states[name][0]} for name in outputs}


class Agents(mosaik_api_v3.Simulator):
    """Agents that want to go back to where they began."""

    def __init__(self) -> None:
        super().__init__(_meta("Agent", ["place", "wanted"]))
        self._wanted: dict[str, float] = {}

    def create(self, num: int, model: str, **parameters: Any) -> list[mosaik_api_v3.CreateResult]:
        """Make the agents."""
        self._wanted = {str(i): 1.0 for i in range(num)}
        return [{"eid": name, "type": model} for name in self._wanted]

    def step(self, time: int, inputs: mosaik_api_v3.InputData, max_advance: int) -> int:
        """Decide for all."""
        for name in self._wanted:
            for place in inputs.get(name, {}).get("place", {}).values():
                self._wanted[name] = -1.0 if place > 0.0 else 1.0
        return time + 1

    def get_data(self, outputs: mosaik_api_v3.OutputRequest) -> mosaik_api_v3.OutputData:
        """Return what they want."""
        return {name: {"wanted": self._wanted[name]} for name in outputs}


def main() -> None:
    """Run worlds of some ticks and answer; mosaik cannot go on with a world that has ended."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, required=True)
    options = parser.parse_args()
    logger.remove()
    logger.add(sys.stderr, level="WARNING")
    simulators = {name: {"python": f"{__name__}:{name}"} for name in ("Vehicles", "Agents")}

    def step() -> float:
        world = mosaik.World(simulators, skip_greetings=True)
        vehicles = world.start("Vehicles").Vehicle.create(options.robots)
        agents = world.start("Agents").Agent.create(options.robots)
        for vehicle, agent in zip(vehicles, agents, strict=True):
            world.connect(vehicle, agent, "place")
            world.connect(agent, vehicle, "wanted", time_shifted=True, initial_data={"wanted": 0.0})
        world.run(until=N_TICKS, print_progress=False)
        return options.robots * N_TICKS * TICK_S

    answer(step, f"mosaik {version('mosaik')}")


if __name__ == "__main__":
    main()
