"""Five mosaik simulators in processes of their own, with mosaik in this one; prints ticks per second as JSON.

python mosaik_ring.py --shape closed --ticks 2000
"""

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mosaik
import mosaik_api_v3
from loguru import logger
from ring import SHAPES, Participant, Place, places, ticks_per_s

META: mosaik_api_v3.Meta = {
    "api_version": "3.0",
    "type": "time-based",
    "models": {"Participant": {"public": True, "params": [], "attrs": ["said", "heard"]}},
}


class Simulator(mosaik_api_v3.Simulator):
    """One participant as mosaik sees it."""

    def __init__(self) -> None:
        super().__init__(META)
        self._said = ""

    def init(self, sid: str, time_resolution: float, **setup: Any) -> mosaik_api_v3.Meta:
        """Take the place."""
        place = Place(**setup["place"])
        self._participant, self._folder = Participant(place), Path(setup["folder"])
        self._n_ticks = setup["n_ticks"]
        return self.meta

    def create(self, num: int, model: str, **parameters: Any) -> list[mosaik_api_v3.CreateResult]:
        """Make the one entity there is."""
        return [{"eid": "only", "type": model}]

    def step(self, time: int, inputs: mosaik_api_v3.InputData, max_advance: int) -> int:
        """Say the next thing."""
        received = inputs.get("only", {}).get("heard", {})
        self._said = self._participant.step(time, next(iter(received.values()), ""))
        if time == self._n_ticks - 1:
            self._participant.save_times(self._folder)
        return time + 1

    def get_data(self, outputs: mosaik_api_v3.OutputRequest) -> mosaik_api_v3.OutputData:
        """Return what it said."""
        return {"only": {"said": self._said}}


def measure(shape: str, n_ticks: int) -> dict[str, float]:
    """Run all five and return their speed."""
    with tempfile.TemporaryDirectory(prefix="peers-") as folder:
        command = f"{sys.executable} {__file__} --participate %(addr)s --log-level warning"
        world = mosaik.World({"Participant": {"cmd": command}}, skip_greetings=True)
        entities = {
            place.name: world.start(
                "Participant", sim_id=place.name, place=asdict(place), n_ticks=n_ticks, folder=folder
            ).Participant.create(1)[0]
            for place in places(shape)
        }
        for place in places(shape):
            if place.reads is None:
                continue
            later = {"time_shifted": True, "initial_data": {"said": ""}} if place.delay_ticks else {}
            world.connect(entities[place.reads], entities[place.name], ("said", "heard"), **later)
        # Not lazy: participants may run ahead as far as their inputs let them.
        world.run(until=n_ticks, print_progress=False, lazy_stepping=False)
        return {"ticks_per_s": ticks_per_s(Path(folder), n_ticks)}


def main() -> None:
    """Print the speed, or be one of the five."""
    if "--participate" in sys.argv:
        sys.argv.remove("--participate")
        mosaik_api_v3.start_simulation(Simulator())
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", choices=SHAPES, required=True, help="see ring.py")
    parser.add_argument("--ticks", type=int, default=2000, help="how many")
    options = parser.parse_args()
    logger.remove()
    logger.add(sys.stderr, level="WARNING")
    print(json.dumps(measure(options.shape, options.ticks)))  # noqa: T201


if __name__ == "__main__":
    main()
