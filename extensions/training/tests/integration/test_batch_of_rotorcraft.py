"""Rotorcraft of a batch are near to those of full runs, and only where that is asked for."""

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.search_env import SearchEnv
from gslcosim_training.stepped_run import LearningTask

PLUME = "gas.model=gaussian_plume"
HALL = (
    PLUME,
    "agents[0].mode=lockstep",
    "environment.layout.size_m=[12,10,4]",
    "gas.sources=[{position_m: [1.5, 1.5, 1], filaments_per_s: 10}]",
    "agents[0].vehicle.start_m=[6,5,0.2]",
    "agents[0].vehicle.search_height_m=1.5",
    "referee.success.within_m=0.05",
    "referee.stop.time_limit_s=200",
)
HALF_M = np.array([6.0, 5.0, 2.0])


def overrides_for(vehicle):
    """Return the hall with a vehicle."""
    return (*HALL, f"agents[0].vehicle.model={vehicle}")


def drawn_velocities(seed, n):
    """Return n actions, each kept for one to three seconds."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1, 1, (n, 2)), rng.integers(10, 31, n), axis=0)[:n].astype(np.float32)


def flown_alone(vehicle, actions):
    """Return the (n, 3) places [m] of a full flight."""
    env = SearchEnv("tiny_room", overrides=overrides_for(vehicle), action="velocity")
    env.reset(seed=3)
    places_m = [HALF_M * env.step(action)[0][:3] for action in actions]
    env.close()
    return np.array(places_m)


def flown_in_batch(vehicle, actions):
    """Return the (n, 3) places [m] of a search of a batch."""
    case = LearningTask(scenario="tiny_room", overrides=overrides_for(vehicle)).loaded(3)
    batch = BatchSearchEnv([case], 2, action="velocity", flying="first_order", n_threads=1)
    batch.reset(seed=1, options={"seeds": [3, 3]})
    places_m = [HALF_M * batch.step(np.stack([action] * 2))[0][:, :3] for action in actions]
    batch.close()
    assert np.array_equal(np.array(places_m)[:, 0], np.array(places_m)[:, 1])
    return np.array(places_m)[:, 0]


def rms_m(places_m, others_m):
    """Return the root of the mean square of distances [m]."""
    return float(np.sqrt(np.mean(np.sum((places_m - others_m) ** 2, axis=1))))


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["iris", "crazyflie"])
def test_a_rotorcraft_is_where_a_full_flight_is_closer_than_a_point_robot_would_be(vehicle):
    actions = drawn_velocities(2, 400)
    full_m = flown_alone(vehicle, actions)
    # It has been anywhere.
    assert np.ptp(full_m, axis=0)[:2].min() > 3.0
    error_m = rms_m(flown_in_batch(vehicle, actions), full_m)
    assert error_m < 0.03
    assert rms_m(flown_in_batch("holonomic", actions), full_m) > 3 * error_m


@pytest.mark.slow
def test_a_rotorcraft_that_flies_against_something_has_collided():
    low = (PLUME, *(f"agents[0].vehicle.{each}" for each in ("model=iris", "search_height_m=1", "avoidance=none")))
    cases = [LearningTask(scenario="warehouse_racks", overrides=low).loaded(seed) for seed in (1, 4)]
    batch = BatchSearchEnv(cases, 40, hold_s=1.0, flying="first_order")
    batch.reset(seed=2)
    rng = np.random.default_rng(5)
    outcomes = set()
    for _ in range(60):
        *_, infos = batch.step(rng.uniform(-1, 1, (40, 2)).astype(np.float32))
        outcomes |= set(infos.get("outcome", [])) - {None}
    assert "collision" in outcomes
    batch.close()


@pytest.mark.parametrize(
    ("vehicle", "settings", "sentence"),
    [
        (
            "iris",
            {},
            "expected holonomic in a batch, or flying first_order or rigid_body, was iris.",
        ),
        ("rover", {}, "agents[0].vehicle.model: expected holonomic in a batch, was rover."),
        ("rover", {"flying": "first_order"}, "expected holonomic or a rotorcraft in a batch, was rover."),
        ("rover", {"flying": "rigid_body"}, "expected holonomic or a rotorcraft in a batch, was rover."),
        ("iris", {"flying": "fast"}, "flying: expected one of exact, first_order, rigid_body, was 'fast'."),
    ],
)
def test_how_vehicles_fly_is_chosen_or_refused_in_one_sentence(vehicle, settings, sentence):
    low = ("agents[0].vehicle={model: rover, start_m: [4.5, 2.5, 0.1]}",) if vehicle == "rover" else ()
    task = LearningTask(scenario="tiny_room", overrides=(PLUME, f"agents[0].vehicle.model={vehicle}", *low))
    with pytest.raises(UsageError) as caught:
        BatchSearchEnv([task.loaded(1)], 2, **settings)
    assert sentence in str(caught.value)
