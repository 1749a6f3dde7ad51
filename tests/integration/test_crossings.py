"""Vehicles that avoid obstacles cross cluttered rooms without touching anything."""

import itertools
import math
import os
from pathlib import Path

import numpy as np
import pytest

from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Episode
from gslcosim.environment.gsl_bench import load_gsl_bench_room
from gslcosim.environment.model import WindFrames
from gslcosim.environment.planning import free_space
from gslcosim.environment.room import build_room, with_wind
from gslcosim.scenario.layout_models import ComplexWarehouseSpec
from gslcosim.scenario.models import WindSpec
from gslcosim.world.core import WorldCore

REFERENCE_DIR = Path(os.environ.get("GSLCOSIM_REFERENCE", Path(__file__).parents[3] / "shared" / "reference"))
ENVIRONMENTS_DIR = REFERENCE_DIR / "gsl-bench" / "environments"
STARTS = list(itertools.product((3.0, 7.5, 12.0), repeat=2))
SOURCE_M = (5.0, 1.0, 2.0)
HEIGHT_M = 2.0
# Long enough for the longest way at 1 m/s with stops at all corners.
AT_MOST_TICKS = 3000


def in_still_air(room):
    return with_wind(room, WindFrames(velocity_m_s=np.zeros((1, *room.grid.shape, 3), np.float32)))


def complex_warehouse(seed):
    layout = ComplexWarehouseSpec(kind="warehouse_complex", size_m=(15.0, 15.0, 8.0), seed=seed)
    return in_still_air(build_room(layout, WindSpec(solver="uniform", cell_m=0.2)))


def reference_environment(number):
    if not (ENVIRONMENTS_DIR / number).is_dir():
        pytest.skip(f"GSLCOSIM_REFERENCE: no GSL-Bench environments in {ENVIRONMENTS_DIR}")
    return in_still_air(load_gsl_bench_room(ENVIRONMENTS_DIR / number))


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


# The nearest place to a start where the vehicle can hover, in the part of the room from which most can be reached.
def hovering_start_m(environment, x_m, y_m, height_m=HEIGHT_M):
    space = free_space(environment, radius_m=0.38, margin_m=0.1).slab(height_m, height_m)
    largest = int(np.bincount(space.parts[space.parts > 0]).argmax())
    if space.part_of((x_m, y_m, 0.0)) == largest:
        return x_m, y_m, height_m
    near_m = space.nearest_m((x_m, y_m, 0.0), part=largest)
    return near_m[0], near_m[1], height_m


def cross(make_scenario, environment, start, mode, model="iris"):
    """Fly from a start to the source; it must arrive as near as obstacles let it, and touch nothing."""
    start_m = hovering_start_m(environment, *start)
    flight = Flight(make_scenario, environment, start_m, model=model, avoidance=mode)
    flight.wait()
    body = flight.go(SOURCE_M)
    assert not flight.contacts, (start_m, flight.contacts)
    assert not body.rejected_command or "instead" in body.rejected_command, body.rejected_command
    assert math.dist(body.position_world_m, SOURCE_M) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["2d", "3d"])
@pytest.mark.parametrize("number", ["003", "005"])
def test_reference_environments_are_crossed_from_nine_starts(make_scenario, number, mode):
    environment = reference_environment(number)
    for start in STARTS:
        cross(make_scenario, environment, start, mode)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["2d", "3d"])
def test_a_complex_warehouse_is_crossed_from_nine_starts(make_scenario, mode):
    environment = complex_warehouse(seed=1)
    for start in STARTS:
        cross(make_scenario, environment, start, mode)


@pytest.mark.soak
@pytest.mark.parametrize("mode", ["2d", "3d"])
@pytest.mark.parametrize("seed", range(2, 12))
def test_complex_warehouses_are_crossed_from_nine_starts(make_scenario, seed, mode):
    environment = complex_warehouse(seed)
    for start in STARTS:
        cross(make_scenario, environment, start, mode)


@pytest.mark.slow
def test_a_rover_crosses_a_complex_warehouse(make_scenario):
    environment = complex_warehouse(seed=1)
    for start in STARTS[::4]:
        x_m, y_m, _ = hovering_start_m(environment, *start, height_m=0.5)
        flight = Flight(make_scenario, environment, (x_m, y_m, 0.1), model="rover", avoidance="2d")
        flight.wait()
        body = flight.go(SOURCE_M)
        assert not flight.contacts, (start, flight.contacts)
        assert math.dist(body.position_world_m[:2], SOURCE_M[:2]) < 1.0


# From each free place drawn to the next: pairs of free places of a complex warehouse.
def fly_free_pairs(make_scenario, n_pairs, seed):
    environment = complex_warehouse(seed)
    start_m = hovering_start_m(environment, 3.0, 3.0)
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
def test_free_pairs_of_a_complex_warehouse_are_flown_without_contact(make_scenario):
    fly_free_pairs(make_scenario, n_pairs=20, seed=1)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(4))
def test_two_hundred_free_pairs_are_flown_without_contact(make_scenario, seed):
    fly_free_pairs(make_scenario, n_pairs=50, seed=seed)
