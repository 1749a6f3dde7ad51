"""Rewards lead around walls: a step through the gap is paid, one towards the wall is not."""

import numpy as np
import pytest

from gslcosim_training.rewards import AgentState, TaskScale, potential
from gslcosim_training.stepped_run import LearningTask, SteppedRun

WALLED = (
    "environment.layout.obstacles=[{name: wall, min_m: [2.5, 0, 0], max_m: [2.75, 4, 2]}]",
    "gas.sources[0].position_m=[4, 1, 0.5]",
    "agents[0].vehicle={model: holonomic, start_m: [1, 1, 0.1], search_height_m: 0.5}",
    "gas.model=gaussian_plume",
)
SCALE = TaskScale(diagonal_m=7.0, time_limit_s=1e9, discount=1.0)


@pytest.fixture(scope="module")
def walled():
    """A room of which a wall with a gap at one end parts the start from the source."""
    flight = SteppedRun(LearningTask(scenario="tiny_room", overrides=WALLED).loaded(1))
    yield flight
    flight.close()


def paid(lengths, before_m, after_m):
    states = []
    for place_m in (before_m, after_m):
        distance_m = float(np.hypot(place_m[0] - 4.0, place_m[1] - 1.0))
        length_m = lengths.lengths_m(np.zeros(1, np.int64), np.array([place_m]), np.array([distance_m]))
        states.append(AgentState(distance_m=distance_m, path_m=float(length_m[0]), time_s=0.0, n_commands=0))
    return potential(*states, SCALE)


def test_a_step_around_the_wall_is_paid_and_one_towards_it_is_not(walled):
    (lengths,) = walled.path_lengths("velocity").values()
    to_wall, to_gap = paid(lengths, (1.5, 1.0, 0.5), (2.0, 1.0, 0.5)), paid(lengths, (1.5, 1.0, 0.5), (1.5, 1.5, 0.5))
    assert to_gap > to_wall
    assert to_gap > 0.4 / 7.0
    assert paid(lengths, (1.5, 3.3, 0.5), (2.0, 3.3, 0.5)) > 0.0


def test_in_front_of_the_source_a_length_is_the_distance(walled):
    (lengths,) = walled.path_lengths("velocity").values()
    found_m = lengths.lengths_m(np.zeros(1, np.int64), np.array([[3.2, 1.1, 0.5]]), np.array([0.806]))
    assert found_m == pytest.approx(0.806, abs=0.06)


def test_a_room_without_obstacles_keeps_the_very_distances():
    task = LearningTask(scenario="tiny_room", overrides=WALLED[1:])
    loaded = task.loaded(1)
    flight = SteppedRun(loaded)
    (lengths,) = flight.path_lengths("velocity").values()
    distances_m = np.array([1.234])
    assert lengths.lengths_m(np.zeros(1, np.int64), np.array([[3.0, 1.0, 0.5]]), distances_m) is distances_m
    flight.close()
