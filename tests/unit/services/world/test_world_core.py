"""The core: first tick, contacts, errors, repeatability."""

import dataclasses
import itertools
import math

import mujoco
import numpy as np
import pytest

from gslcosim.base.errors import ModelError, ScenarioError
from gslcosim.contract.codec import encode
from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Episode
from gslcosim.vehicles import get_vehicle
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.core import WorldCore
from gslcosim_services.world.scene import build_scene
from gslcosim_services.world.simulation_loop import SceneArrays, mark_near_inplace, turn_attitude_inplace

CRATE = ("crate", (5.0, 5.0, 0.0), (6.0, 6.5, 1.0))


def test_declares_its_reads_and_writes(make_scenario, make_room):
    spec = WorldCore(make_scenario({}, {}, mode={"latency": 4}), make_room()).spec
    assert spec.name == "world"
    assert [(r.port, r.delay_ticks) for r in spec.reads] == [("command/agent_0", 4), ("command/agent_1", 4)]
    assert [w.port for w in spec.writes] == ["truth/bodies"]


def test_tick_0_stands_on_the_floor(make_pilot):
    body = make_pilot().body()
    assert body.position_world_m == (3.0, 3.0, 0.055)
    assert body.phase == "on_ground"
    assert body.contacts == ("floor",)
    assert body.velocity_world_m_s == (0.0, 0.0, 0.0)
    assert not body.awaiting_command


def test_a_start_on_a_crate_stands_on_the_crate(make_pilot):
    body = make_pilot({"start_m": (5.5, 5.75, 1.1)}, obstacles=[CRATE]).body()
    assert body.position_world_m == pytest.approx((5.5, 5.75, 1.055))
    assert body.contacts == ("crate",)


def test_a_start_in_the_air_hovers(make_pilot):
    pilot = make_pilot({"start_m": (3.0, 3.0, 2.0)})
    assert pilot.body().contacts == ()
    lowest_m = min(pilot.step().position_world_m[2] for _ in range(20))
    assert lowest_m > 1.95


def test_path_length_is_the_sum_of_true_steps(make_pilot):
    pilot = make_pilot()
    pilot.run(60)
    places = [m.bodies[0].position_world_m for m in pilot.log]
    assert pilot.body().path_length_m == pytest.approx(sum(math.dist(a, b) for a, b in itertools.pairwise(places)))


@pytest.mark.parametrize(("model", "half_width_m"), [("iris", 0.258), ("holonomic", 0.15)])
def test_a_collision_stops_the_vehicle_and_is_reported_by_the_name_of_the_box(asked_pilot, model, half_width_m):
    pilot = asked_pilot({"model": model}, obstacles=[CRATE, ("rack", (8.0, 0.0, 0.0), (8.5, 10.0, 6.0))])
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (12.0, 3.0, 2.0)})
    body = pilot.run_until(lambda body: body.contacts)
    assert body.contacts == ("rack",)
    assert body.position_world_m[0] == pytest.approx(8.0 - half_width_m, abs=0.1)
    assert pilot.run(50).position_world_m[0] < 8.0


def test_two_vehicles_name_each_other(asked_pilot):
    pilot = asked_pilot({"start_m": (3.0, 3.0, 0.1)}, {"start_m": (6.0, 3.0, 0.1)})
    meet = {"kind": "waypoint", "position_world_m": (4.5, 3.0, 2.0)}
    pilot.step(agent_0=meet, agent_1=meet)
    pilot.run_until(lambda body: body.contacts)
    assert pilot.body(0).contacts == ("agent_1",)
    assert pilot.body(1).contacts == ("agent_0",)


def test_vehicles_fly_as_if_alone(make_pilot):
    alone, pair = make_pilot({}), make_pilot({}, {"start_m": (9.0, 7.0, 0.1)})
    alone.run(40)
    pair.run(40)
    assert pair.body(0).position_world_m == pytest.approx(alone.body().position_world_m, abs=1e-9)


def test_point_robots_alone_take_longer_steps(make_scenario, make_room):
    alone = WorldCore(make_scenario({"model": "holonomic"}), make_room())
    mixed = WorldCore(make_scenario({"model": "holonomic"}, {}), make_room())
    odd = WorldCore(make_scenario({"model": "holonomic"}, tick_ms=48), make_room())
    assert [core.model.opt.timestep for core in (alone, mixed, odd)] == [0.02, 0.004, 0.004]


def test_a_point_robot_does_not_feel_the_wind(make_pilot):
    calm = make_pilot({"model": "holonomic"})
    windy = make_pilot({"model": "holonomic"}, wind_m_s=((5.0, 1.0, 1.0),))
    assert calm.run(50) == windy.run(50)


def test_vehicles_of_several_kinds_fly_in_one_world(make_pilot):
    pilot = make_pilot({"model": "iris"}, {"model": "crazyflie"}, {"model": "holonomic"})
    pilot.run(60)
    for i in range(3):
        assert pilot.body(i).position_world_m == pytest.approx((3.0 + 2.0 * i, 3.0, 2.0), abs=0.02)


def script(core, *, episode_seed=0):
    """Fly a fixed script and return the bytes of every message."""
    core.reset(Episode(seed=episode_seed))
    places = [(4.0, 4.0, 2.5), (900.0, 0.0, 0.0), (7.0, 3.0, 2.0)]
    is_asked, payloads = False, []
    for tick in range(150):
        inbox = {}
        if is_asked:
            place = places.pop(0) if places else (3.0, 3.0, 1.0)
            inbox["command/agent_0"] = Command(tick=tick - 1, kind="waypoint", position_world_m=place)
        message = core.step(tick, inbox)["truth/bodies"]
        is_asked = message.bodies[0].awaiting_command
        payloads.append(encode(message))
    return payloads


def test_equal_runs_give_equal_bytes_also_after_a_reset(make_scenario, make_room):
    room = make_room(wind_m_s=((0.4, -0.2, 0.1), (1.0, 0.3, 0.0)))
    first, second = WorldCore(make_scenario(), room), WorldCore(make_scenario(), room)
    second.reset(Episode(seed=0))
    for tick in range(17):
        second.step(tick, {})
    expected = script(first)
    assert script(second) == expected
    assert script(first, episode_seed=5) == expected


def test_wind_frames_change_with_time(make_scenario, make_room):
    """Steady at first, then a gust: the flight differs from the tick after the frame begins, not earlier.

    Frames count from when the sources open, `warm_up_s` before the flight, for vehicles as for gas.
    """
    scenario = make_scenario()
    period_s = scenario.gas.warm_up_s + 2.0
    calm = WorldCore(scenario, make_room(wind_m_s=((0.0, 0.0, 0.0),)))
    gusty = WorldCore(scenario, make_room(wind_m_s=((0.0,) * 3, (3.0, 0.0, 0.0)), period_s=period_s, is_looping=False))
    for core in (calm, gusty):
        core.reset(Episode(seed=0))
    for tick in range(25):
        a, b = (core.step(tick, {})["truth/bodies"] for core in (calm, gusty))
        assert (a == b) == (tick <= 20)


def test_ticks_out_of_order_are_refused(make_pilot):
    pilot = make_pilot()
    with pytest.raises(ModelError, match="expected tick 1, was 3"):
        pilot.core.step(3, {})


@pytest.mark.parametrize("value", [float("nan"), 1e9])
def test_an_exploding_state_names_the_agent(make_pilot, value):
    pilot = make_pilot({}, {})
    pilot.run(3)
    pilot.core.data.qvel[6] = value
    with pytest.raises(ModelError, match="plausible state of agent_1's vehicle at tick 4"):
        pilot.step()


def test_a_tick_that_is_not_whole_physics_steps_is_refused(make_scenario, make_room):
    with pytest.raises(ScenarioError, match=r"whole number of 4 ms physics steps, was 50 ms. Nearest: 48 ms or 52 ms"):
        WorldCore(make_scenario(tick_ms=50), make_room())


def test_all_bad_starts_come_in_one_error(make_scenario, make_room):
    scenario = make_scenario(
        {"start_m": (20.0, 3.0, 0.2)},
        {"start_m": (5.5, 5.5, 0.5)},
        {"start_m": (1.0, 1.0, 0.2), "search_height_m": 9.0},
        {"start_m": (1.2, 1.0, 0.2)},
    )
    with pytest.raises(ScenarioError) as error:
        WorldCore(scenario, make_room(obstacles=[CRATE]))
    text = str(error.value)
    assert "agents.agent_0.vehicle.start_m: expected x within 0 to 15 m, was 20 m." in text
    assert "agents.agent_1.vehicle.start_m: expected a free place" in text
    assert "agents.agent_2.vehicle.search_height_m: expected z within 0.38 to 5.62 m, was 9 m." in text
    assert "agents.agent_3.vehicle.start_m: expected at least 0.76 m from agent_2's vehicle, was 0.2 m." in text


def test_wind_of_another_type_is_refused(make_scenario, make_room):
    room = make_room()
    wind = dataclasses.replace(room.wind, velocity_m_s=room.wind.velocity_m_s.astype(np.float64))
    with pytest.raises(ModelError, match="wind: expected contiguous float32, was float64"):
        WorldCore(make_scenario(), dataclasses.replace(room, wind=wind))


@pytest.mark.parametrize(
    ("vehicle", "text"),
    [
        ({"start_m": (4.8, 5.5, 0.1)}, r"agent_0.vehicle.start_m: .* was 0.0\d\d m inside crate"),
        ({"start_m": (0.2, 5.5, 0.1)}, r"agent_0.vehicle.start_m: .* was 0.0\d\d m inside wall_west"),
        ({"model": "rover", "start_m": (4.8, 5.5, 0.1)}, r"agent_0.vehicle.start_m: .* was 0.0\d\d m inside crate"),
    ],
)
def test_a_start_that_reaches_into_something_is_refused(make_scenario, make_room, vehicle, text):
    with pytest.raises(ScenarioError, match=text):
        WorldCore(make_scenario(vehicle), make_room(obstacles=[CRATE]))


def test_hulls_that_overlap_are_refused_however_their_centres_are(make_scenario, make_room):
    with pytest.raises(ScenarioError, match=r"expected at least 0\.647 m from agent_0's vehicle, was 0\.50"):
        WorldCore(make_scenario({}, {"model": "rover", "start_m": (3.5, 3.0, 0.1)}), make_room())


def test_whatever_mujoco_finds_a_contact_of_is_near(make_room):
    models = [get_vehicle(name) for name in ("iris", "crazyflie", "holonomic")]
    room = make_room(obstacles=[("crate", (7.0, 4.0, 0.0), (9.0, 5.0, 2.0))])
    scene = build_scene(room, list(zip("abc", models, strict=True)), 0.004)
    data, constants = mujoco.MjData(scene.model), np.zeros(3, vehicle_records.CONSTANTS)
    for record, model, name in zip(constants, models, "abc", strict=True):
        vehicle_records.set_constants(record, model, scene.model, f"{name}/", 0.004)
    arrays, rng = SceneArrays.of(scene.model, data), np.random.default_rng(5)
    is_near, n_far, n_touching = np.empty(3, np.bool_), 0, 0
    for _ in range(300):
        places_m, turns = rng.uniform((6.0, 3.0, 0.0), (10.0, 6.0, 3.0), (3, 3)), rng.standard_normal((3, 4))
        data.qpos[:] = np.hstack([places_m, turns / np.linalg.norm(turns, axis=1, keepdims=True)]).ravel()
        mujoco.mj_forward(scene.model, data)
        touching = {scene.agent_of_geom[geom] for geom in data.contact.geom.flat} - {-1}
        mark_near_inplace(is_near, constants, data.qpos, arrays.obstacles_m)
        assert touching <= set(np.flatnonzero(is_near).tolist())
        n_far, n_touching = n_far + np.sum(~is_near), n_touching + len(touching)
    assert n_far > 300
    assert n_touching > 30


def test_attitudes_turn_as_mujocos_do():
    rng = np.random.default_rng(7)
    for scale in (0.0, 1e-12, 1e-3, 1.0, 100.0):
        q, w = rng.normal(size=4), scale * rng.normal(size=3)
        q /= np.linalg.norm(q)
        expected = q.copy()
        mujoco.mju_quatIntegrate(expected, w, 0.002)
        turn_attitude_inplace(q, w, 0.002)
        assert q == pytest.approx(expected, rel=0.0, abs=1e-15)
