"""What on-board sensors cost, beside their targets: whole runs with and without them, and single readings.

`make bench-robots` prints it too. Runs are run in this process, in turns, unrecorded; the time is that of this
process, and of each tick the best of all rounds counts, so that what else the machine does is left out.
"""

import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "kit"))

from built_messages import build_body
from built_rooms import build_air
from built_scenarios import build_agent, build_scenario

from gslcosim.base.rng import stream
from gslcosim.contract.messages import BodyState
from gslcosim.contract.record import NumericArray
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.model import Box, Cell, Environment
from gslcosim.environment.store import load_environment
from gslcosim.runtime import in_process
from gslcosim.runtime.run import run_scenario
from gslcosim.runtime.status import RunStatus
from gslcosim.scenario.loader import LoadedScenario, load_scenario
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.models import build_sensor
from gslcosim_services.sensing.models.base import Surroundings
from gslcosim_services.sensing.ray_scene import RayScene

# Short runs go through more rounds.
ROUNDS = {"tiny_room": 20, "warehouse_empty": 6}
TIME_LIMIT_S = 40
USUAL = "{model: tgs2600, name: nose}, {model: anemometer, name: wind}"
NAVIGATION = "{model: imu, name: imu}, {model: gps, name: gps}, {model: barometer, name: barometer}"
CAMERA = "{model: camera, name: eye, period_s: 0.2, camera: {width_px: 64, height_px: 64}}"
KINDS = {"usual": USUAL, "navigation": f"{USUAL}, {NAVIGATION}", "camera": f"{USUAL}, {CAMERA}"}
MOST_COST = 0.25
LEAST_WITH_CAMERA = 5.0
N_BOXES = 200
TICK_NS = 100_000_000


class Ticks:
    """Notes the time of this process wherever a run reports: at every tick."""

    def __init__(self) -> None:
        self.marks: list[tuple[float, float]] = []

    def __call__(self, status: RunStatus) -> None:
        """Take a report."""
        if status.state == "flying":
            self.marks.append((status.sim_time_s, time.process_time()))

    @property
    def lengths_s(self) -> np.ndarray:
        """(n, 2) simulated and needed time of each tick [s]."""
        return np.diff(self.marks, axis=0)


def load(name: str, sensors: str) -> LoadedScenario:
    """Return a scenario with these sensors."""
    overrides = ["recording.enabled=false", f"agents[0].sensors=[{sensors}]"]
    overrides.append(f"referee.stop.time_limit_s={TIME_LIMIT_S}")
    return load_scenario(name, overrides=overrides)


def times_real_time(name: str, kinds: Sequence[str]) -> dict[str, float]:
    """Return how fast a scenario flies with each kind of sensors, flown in turns; without those that cannot fly."""
    scenarios = {kind: load(name, KINDS[kind]) for kind in kinds}
    rounds: dict[str, list[np.ndarray]] = {kind: [] for kind in kinds}
    with tempfile.TemporaryDirectory() as runs_dir:
        for _ in range(ROUNDS[name]):
            for kind, loaded in scenarios.items():
                noted = Ticks()
                if run_scenario(loaded, runs_dir=Path(runs_dir), processes="one", report=noted).result["valid"]:
                    rounds[kind].append(noted.lengths_s)
    best = {kind: np.min(lengths_s, axis=0).sum(axis=0) for kind, lengths_s in rounds.items() if lengths_s}
    return {kind: float(simulated_s / needed_s) for kind, (simulated_s, needed_s) in best.items()}


def print_runs() -> None:
    """Print how fast the small room and the quickstart fly with and without on-board sensors."""
    for name in ROUNDS:
        speeds = times_real_time(name, ("usual", "navigation"))
        cost = speeds["usual"] / speeds["navigation"] - 1.0
        say(f"{name}, nose and anemometer", f"{speeds['usual']:.0f} x real time")
        say(
            "  with IMU, GPS and barometer",
            f"{speeds['navigation']:.0f} x real time, costs {cost:.0%}, at most {MOST_COST:.0%}",
        )
        seen = times_real_time(name, ("camera",))
        figure = "left out: neither EGL nor OSMesa works here"
        if seen:
            figure = f"{seen['camera']:.0f} x real time, at least {LEAST_WITH_CAMERA:g}"
        say("  with a 64 x 64 camera at 5 Hz", figure)


def scenario_with(*sensors: dict[str, object]) -> Scenario:
    """Return a scenario whose vehicle has these sensors; its environment does not matter."""
    return build_scenario(build_agent("a", sensors=sensors))


def room_of_boxes() -> Environment:
    """Return 30 x 15 x 8 m with many boxes in it and no walls."""
    rng = np.random.default_rng(1)
    low_m, high_m = rng.uniform((0, 0, 0), (28, 13, 5), (N_BOXES, 3)), rng.uniform(0.4, 2.0, (N_BOXES, 3))
    boxes = tuple(
        Box(name=f"box_{i}", kind="obstacle", min_m=tuple(low.tolist()), max_m=tuple((low + side).tolist()))
        for i, (low, side) in enumerate(zip(low_m, high_m, strict=True))
    )
    return build_air((60, 30, 16), cell_m=0.5, boxes=boxes)


def complex_warehouse() -> Environment:
    """Return a generated warehouse full of racks, with even wind because it does not matter here."""
    loaded = load_scenario("gsl_bench_5", overrides=["wind={solver: uniform, inlet_velocity_m_s: [1, 0, 0]}"])
    return load_environment(
        prepare_environment(loaded.scenario, scenario_dir=loaded.directory, progress=lambda _text, _fraction: None)
    )


def body_at(position_m: np.ndarray) -> BodyState:
    """Return a vehicle at rest there."""
    return build_body("a", tuple(position_m.tolist()), inertial_body=NumericArray.from_array(np.ones((25, 9))))


def reading_us(model: str, environment: Environment, n_places: int = 20) -> tuple[float, int]:
    """Return how long a reading takes at places in the free air, each the best of five, and how many numbers it has."""
    described: dict[str, object] = {"model": model, "name": "s"}
    scene, spec = RayScene(scenario_with(described), environment), make_sensor_spec(**described)
    sensor = build_sensor(SENSOR_MODELS[model], spec, TICK_NS, stream(1, "bench"))
    grid, rng = environment.grid, np.random.default_rng(2)
    free = np.argwhere(environment.occupancy == Cell.FREE)
    centres_m = grid.origin_m + (free[rng.integers(len(free), size=n_places)] + 0.5) * grid.cell_m
    places = [Surroundings(body_at(centre_m), scene) for centre_m in centres_m]
    reading = sensor.read(places[0], (0.0, 0.0, 0.0))
    times_us = [
        min(time_us(lambda place=place: sensor.read(place, (0.0, 0.0, 0.0))) for _ in range(5)) for place in places
    ]
    n_numbers = reading.array.to_array().size if reading.array else len(reading.values)
    return float(np.mean(times_us)), n_numbers


def time_us(call: Callable[[], object]) -> float:
    """Return how long a call takes [us]."""
    began = time.perf_counter_ns()
    call()
    return (time.perf_counter_ns() - began) * 1e-3


def print_readings() -> None:
    """Print what single readings take."""
    boxes, warehouse = room_of_boxes(), complex_warehouse()
    for where, room in (
        (f"{N_BOXES} boxes", boxes),
        (f"a complex warehouse of {len(warehouse.boxes)} boxes", warehouse),
    ):
        scan_us, n_rays = reading_us("lidar_3d", room)
        say(
            f"lidar_3d in {where}",
            f"{scan_us / 1e3:.2f} ms a scan of {n_rays} rays, {scan_us / n_rays * 1e3:.0f} ns a ray",
        )
    models = ("imu", "gps", "barometer", "magnetometer", "pose", "range_finder", "four_range_finders", "lidar_2d")
    figures = [f"{model} {reading_us(model, warehouse)[0]:.0f}" for model in models]
    say("a reading of the others [us]", ", ".join(figures))


def say(what: str, figure: str) -> None:
    """Print a line."""
    print(f"{what:<52} {figure}", flush=True)  # noqa: T201


if __name__ == "__main__":
    in_process.REPORT_EVERY_TICKS = 1
    print_readings()
    print_runs()
