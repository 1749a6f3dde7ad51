"""Vehicles that avoid obstacles cross cluttered rooms without touching anything."""

import importlib.util
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Episode
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import WindFrames, with_wind
from gslcosim.environment.paths.planner import free_space
from gslcosim.scenario.models.geometry import ComplexWarehouseSpec
from gslcosim.scenario.models.scenario import WindSpec
from gslcosim_services.world.core import WorldCore

REFERENCE_DIR = Path(os.environ.get("GSLCOSIM_REFERENCE", Path(__file__).parents[3] / "shared" / "reference"))
ENVIRONMENTS_DIR = REFERENCE_DIR / "gsl-bench" / "environments"
STUDY = Path(__file__).parents[2] / "docs" / "studies" / "crossings.py"
# Long enough for the longest way at 1 m/s with stops at all corners.
AT_MOST_TICKS = 3000


def complex_warehouse(seed):
    layout = ComplexWarehouseSpec(kind="warehouse_complex", size_m=(15.0, 15.0, 8.0), seed=seed)
    room = build_layout(layout, WindSpec(solver="uniform", cell_m=0.2))
    return with_wind(room, WindFrames(velocity_m_s=np.zeros((1, *room.grid.shape, 3), np.float32)))


@pytest.fixture
def study():
    """The script whose table `make crossings` prints."""
    if "crossings" not in sys.modules:
        spec = importlib.util.spec_from_file_location("crossings", STUDY)
        sys.modules["crossings"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["crossings"])
    return sys.modules["crossings"]


# ---------------------------------------------------------------- whole runs, judged by the referee


def check_all_nine_cross(study, environment, mode, runs_dir):
    """The referee lets none of the nine collide; ways are somewhat longer than its shortest, which fly over things."""
    crossings = study.cross(environment, mode, runs_dir)
    assert len({crossing.start_m for crossing in crossings}) == 9
    assert [crossing for crossing in crossings if crossing.outcome != "success"] == []
    assert sorted(crossing.way for crossing in crossings)[4] < 1.6


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["2d", "3d"])
@pytest.mark.parametrize("number", ["003", "005"])
def test_reference_environments_are_crossed_from_nine_starts(study, number, mode, tmp_path):
    if not (ENVIRONMENTS_DIR / number).is_dir():
        pytest.skip(f"GSLCOSIM_REFERENCE: no GSL-Bench environments in {ENVIRONMENTS_DIR}")
    check_all_nine_cross(study, {"gsl_bench": str(ENVIRONMENTS_DIR / number)}, mode, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["2d", "3d"])
def test_a_complex_warehouse_is_crossed_from_nine_starts(study, mode, tmp_path):
    check_all_nine_cross(study, study.warehouse(1), mode, tmp_path)


@pytest.mark.soak
@pytest.mark.parametrize("mode", ["2d", "3d"])
@pytest.mark.parametrize("seed", range(2, 12))
def test_complex_warehouses_are_crossed_from_nine_starts(study, seed, mode, tmp_path):
    check_all_nine_cross(study, study.warehouse(seed), mode, tmp_path)


@pytest.mark.slow
def test_without_avoidance_the_referee_sees_collisions(study, tmp_path):
    outcomes = {crossing.outcome for crossing in study.cross(study.warehouse(3), "none", tmp_path)}
    assert "collision" in outcomes


# ---------------------------------------------------------------- the world alone


class Flight:
    """A vehicle that is sent from place to place; what it touches is kept."""

    def __init__(self, make_scenario, environment, start_m, **vehicle):
        scenario = make_scenario({"start_m": start_m, "hold_s": 0.0, **vehicle})
        self.core = WorldCore(scenario, environment)
        self.core.reset(Episode(seed=0))
        self.tick, self.contacts = -1, set()
        self.body = self.step()

    def step(self, **fields):
        self.tick += 1
        inbox = {"command/agent_0": Command(tick=max(0, self.tick - 1), **fields)} if fields else {}
        self.body = self.core.step(self.tick, inbox)["truth/bodies"].bodies[0]
        self.contacts |= set(self.body.contacts)
        return self.body

    def wait(self):
        for _ in range(AT_MOST_TICKS):
            if self.step().awaiting_command:
                return self.body
        raise AssertionError(f"still under way: {self.body}")

    def go(self, place_m):
        self.step(kind="waypoint", position_world_m=place_m)
        return self.wait()


@pytest.mark.slow
def test_a_rover_crosses_a_complex_warehouse(study, make_scenario):
    environment = complex_warehouse(seed=1)
    for start in study.STARTS[::4]:
        x_m, y_m, _ = study.start_beside(environment, *start, height_m=0.5)
        flight = Flight(make_scenario, environment, (x_m, y_m, 0.1), model="rover", avoidance="2d")
        flight.wait()
        body = flight.go(study.SOURCE_M)
        assert not flight.contacts, (start, flight.contacts)
        assert math.dist(body.position_world_m[:2], study.SOURCE_M[:2]) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "mode", "height_m"), [("iris", "3d", 2.0), ("crazyflie", "2d", 2.0), ("rover", "2d", 0.1)]
)
def test_random_velocities_in_a_complex_warehouse_touch_nothing(study, make_scenario, model, mode, height_m):
    environment = complex_warehouse(seed=1)
    x_m, y_m, _ = study.start_beside(environment, 7.5, 7.5, height_m=max(height_m, 0.5))
    flight = Flight(make_scenario, environment, (x_m, y_m, height_m), model=model, avoidance=mode)
    flight.wait()
    rng, n_notices = np.random.default_rng(3), 0
    for _ in range(150):
        direction = rng.normal(size=3) * (1.0, 1.0, 0.3)
        velocity_m_s = tuple((rng.uniform(0.2, 1.0) * direction / np.linalg.norm(direction)).tolist())
        flight.step(kind="velocity", velocity_world_m_s=velocity_m_s, hold_s=60.0)
        for _ in range(30):
            flight.step()
        n_notices += flight.body.rejected_command is not None
        assert not flight.contacts, (flight.body, flight.contacts)
    assert n_notices > 20


# From each free place drawn to the next: pairs of free places of a complex warehouse.
def fly_free_pairs(study, make_scenario, n_pairs, seed):
    environment = complex_warehouse(seed)
    start_m = study.start_beside(environment, 3.0, 3.0)
    flight = Flight(make_scenario, environment, start_m, avoidance="3d")
    space = free_space(environment, radius_m=0.38, margin_m=0.05)
    part, rng = space.part_of(start_m), np.random.default_rng(seed)
    flight.wait()
    for _ in range(n_pairs):
        goal_m = next(
            point_m
            for point_m in iter(lambda: tuple(rng.uniform(environment.grid.origin_m, environment.grid.max_m)), None)
            if space.part_of(point_m) == part
        )
        body = flight.go(goal_m)
        assert body.rejected_command is None
        assert math.dist(body.position_world_m, goal_m) < 0.15
        assert not flight.contacts, (goal_m, flight.contacts)


@pytest.mark.slow
def test_free_pairs_of_a_complex_warehouse_are_flown_without_contact(study, make_scenario):
    fly_free_pairs(study, make_scenario, n_pairs=20, seed=1)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(4))
def test_two_hundred_free_pairs_are_flown_without_contact(study, make_scenario, seed):
    fly_free_pairs(study, make_scenario, n_pairs=50, seed=seed)
