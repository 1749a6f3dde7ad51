"""Rotorcraft of a batch that are rigid bodies are where single runs have them, to the bit."""

import numpy as np
import pytest

from gslcosim.base.errors import ModelError, UsageError
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.store import load_environment
from gslcosim.vehicles import get_vehicle
from gslcosim_search.learned.encoding import ObservationVector, action_kind
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.vehicle_records import STATE
from gslcosim_training.batch import BatchSearchEnv, contact_scene
from gslcosim_training.batch.batch_records import SEARCH
from gslcosim_training.stepped_run import LearningTask, SteppedRun

SPEED_M_S = 0.65
HALL = (
    "gas.model=gaussian_plume",
    "environment.layout.size_m=[14,12,6]",
    "gas.sources=[{position_m: [1.5, 1.5, 1], filaments_per_s: 10}]",
    "agents[0].vehicle.start_m=[7,6,0.2]",
    "agents[0].vehicle.search_height_m=2",
    "referee.success.within_m=0.05",
    "referee.stop.time_limit_s=60",
    "agents[0].sensors=[{model: pid_ideal, name: nose, mount_m: [0.2, 0.1, 0.1]},"
    " {model: anemometer_3d, name: wind, mount_m: [0, 0, 0.3]}]",
)
STRONG_WIND = ("wind.inlet_velocity_m_s=[4, 1.5, 0]",)
LOCKSTEP = ("agents[0].mode=lockstep",)
# After the take-off: holds, climbs and descents, long legs, and changes while under way, each for a number of commands.
MANOEUVRES = {
    "velocity_3d": [
        ((0, 0, 0), 80), ((0, 0, 1), 15), ((1, -0.6, 0), 25), ((-1, 1, -0.4), 8), ((0.4, 1, 0.3), 25), ((0, 0, 0), 30),
    ],
    "waypoint_3d": [((0.5, 0.5, 0.5), 1), ((-1, 0.3, -0.2), 1), ((0.2, -1, 0.4), 2), ((0, 0, 0), 1), ((1, 1, -0.4), 1)],
}  # fmt: skip
RACKS = (
    "gas.model=gaussian_plume",
    "agents[0].vehicle.model=iris",
    "agents[0].vehicle.avoidance=none",
    "agents[0].vehicle.search_height_m=1",
    "referee.stop.time_limit_s=90",
)


def overrides_for(vehicle, *more):
    """Return the hall with a vehicle."""
    return (*HALL, f"agents[0].vehicle.model={vehicle}", *more)


def listed(action):
    """Return the actions of the manoeuvres, one after the other."""
    return [np.array(vector, np.float32) for vector, n in MANOEUVRES[action] for _ in range(n)]


def flown_alone(scenario, overrides, action, actions, seed):
    """Return states of a body (n, 13), observations and times of a single run at its questions, and its outcome."""
    run = SteppedRun(LearningTask(scenario=scenario, overrides=overrides).loaded(seed))
    agent = run.scenario.agents[0].name
    briefing = run.get_briefing(agent)
    vector = ObservationVector(briefing)
    kind = action_kind(action, briefing, step_m=2.0, speed_m_s=SPEED_M_S, hold_s=None)
    states, seen, times_s = [], [], []
    for given in actions:
        run.command(agent, kind.command(run.seen_by(agent), given))
        run.go_on()
        body = run.truth.bodies[agent]
        moves = (*body.velocity_world_m_s, *body.angular_velocity_body_rad_s)
        states.append((*body.position_world_m, *body.quaternion_wxyz, *moves))
        seen.append(vector.of(run.seen_by(agent)).copy())
        times_s.append(run.seen_by(agent).time_s)
        if run.is_over:
            break
    outcome = run.outcome_of(agent) if run.is_over else None
    run.close()
    return np.array(states), np.array(seen), np.array(times_s), outcome


def flown_in_batch(scenario, overrides, action, actions, seed):
    """Return the same of the second search of a batch."""
    case = LearningTask(scenario=scenario, overrides=overrides).loaded(seed)
    batch = BatchSearchEnv([case], 2, action=action, speed_m_s=SPEED_M_S, step_m=2.0, flying="rigid_body", n_threads=1)
    batch.reset(seed=1, options={"seeds": [seed, seed]})
    states, seen, times_s, outcome = [], [], [], None
    for given in actions:
        observed, *_, infos = batch.step(np.stack([given] * 2))
        states.append(batch.body_states[1])
        seen.append(observed[1])
        times_s.append(infos["time_s"][1])
        if "outcome" in infos:
            outcome = infos["outcome"][1]
            break
    batch.close()
    return np.array(states), np.array(seen), np.array(times_s), outcome


def assert_equal(scenario, overrides, action, actions, seed=3):
    """Fly both and compare them; return the states (n, 13) of the single run and the outcome."""
    alone = flown_alone(scenario, overrides, action, actions, seed)
    batch = flown_in_batch(scenario, overrides, action, actions, seed)
    assert np.array_equal(alone[2], batch[2])
    assert alone[3] == batch[3]
    # What a contact does is MuJoCo's, with what it has learned in the steps before.
    n = len(alone[0]) - (alone[3] == "collision")
    np.testing.assert_array_equal(batch[0][:n], alone[0][:n])
    np.testing.assert_allclose(batch[1][:n], alone[1][:n], rtol=0, atol=1e-6)
    return alone[0], alone[3]


@pytest.mark.slow
@pytest.mark.parametrize("wind", [(), STRONG_WIND], ids=["breeze", "wind"])
@pytest.mark.parametrize("action", list(MANOEUVRES))
@pytest.mark.parametrize("vehicle", ["iris", "crazyflie", "hexarotor"])
def test_manoeuvres_are_those_of_single_runs(vehicle, action, wind):
    mode = LOCKSTEP if action == "velocity_3d" else ()
    states, outcome = assert_equal("tiny_room", overrides_for(vehicle, *mode, *wind), action, listed(action))
    assert outcome is None
    # It has been to many places, and has leaned.
    assert np.ptp(states, axis=0)[:3].min() > 0.8
    assert not wind or np.abs(states[:, 4:6]).max() > 0.03


@pytest.mark.slow
def test_a_flight_along_a_wall_within_reach_of_it_is_that_of_a_single_run():
    overrides = overrides_for("iris", *LOCKSTEP, "agents[0].vehicle.start_m=[0.45,3,0.2]")
    actions = [np.array([0, y, 0], np.float32) for y in (0.0,) * 80 + (1.0,) * 45 + (0.0,) * 15]
    states, outcome = assert_equal("tiny_room", overrides, "velocity_3d", actions)
    assert outcome is None
    assert np.ptp(states[:, 1]) > 2.0
    # Its hull turned by a quarter would reach into the wall.
    assert states[:, 0].max() < 0.5


@pytest.mark.slow
def test_a_collision_ends_a_search_when_it_ends_a_single_run():
    rng = np.random.default_rng(5)
    actions = np.repeat(rng.uniform(-1, 1, (40, 2)), 3, axis=0).astype(np.float32)
    outcomes = [assert_equal("warehouse_racks", RACKS, "velocity", actions, seed=seed)[1] for seed in (1, 4)]
    assert "collision" in outcomes


def test_a_body_that_batches_cannot_advance_is_refused_with_the_remedy(monkeypatch):
    monkeypatch.setattr(vehicle_records, "is_plain_body", lambda model, body: False)
    task = LearningTask(scenario="tiny_room", overrides=overrides_for("iris"))
    with pytest.raises(UsageError) as caught:
        BatchSearchEnv([task.loaded(1)], 2, flying="rigid_body")
    assert "one body with its centre of mass at its origin, flying rigid_body, was iris." in str(caught.value)
    assert "Fly it first_order, or alone in gslcosim/Search-v0." in str(caught.value)


def test_a_state_that_has_exploded_is_reported():
    loaded = LearningTask(scenario="tiny_room", overrides=overrides_for("iris")).loaded(1)
    room = load_environment(prepare_environment(loaded.scenario, scenario_dir=loaded.directory))
    scene = contact_scene.ContactScene(room, get_vehicle("iris"), 0.004, 25)
    search = np.zeros((), SEARCH)
    search["position_m"], search["quaternion_wxyz"][0], search["velocity_m_s"][2] = (7.0, 6.0, 3.0), 1.0, 300.0
    with pytest.raises(ModelError, match="expected a finite, plausible state of a vehicle at tick 8"):
        scene.fly(3, 8, 0.1, 0.7, np.zeros(1, STATE), search)


@pytest.mark.slow
def test_threads_and_the_size_of_a_batch_change_nothing():
    case = LearningTask(scenario="tiny_room", overrides=overrides_for("crazyflie", *LOCKSTEP)).loaded(3)
    actions = np.random.default_rng(2).uniform(-1, 1, (100, 2)).astype(np.float32)
    flown = []
    for n_envs, n_threads in ((1, 1), (600, 2)):
        batch = BatchSearchEnv([case], n_envs, flying="rigid_body", n_threads=n_threads)
        batch.reset(seed=1, options={"seeds": np.full(n_envs, 7)})
        for action in actions:
            batch.step(np.tile(action, (n_envs, 1)))
        flown.append(batch.body_states)
        batch.close()
    assert (flown[1] == flown[0]).all()
