"""A vehicle on wheels in a scenario: what it obeys, what it refuses, what stops it."""

import math

import numpy as np
import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.models.scenario import VehicleSpec
from gslcosim.vehicles import get_vehicle
from gslcosim_services.world.core import WorldCore
from gslcosim_services.world.path_follower import OVERTURNED_NOTICE

ROVER_HEIGHT_M = get_vehicle("rover").body.half_height_m

ROVER = {"model": "rover"}
RACK = ("rack", (6.0, 0.0, 0.0), (6.5, 10.0, 6.0))


def waypoint(*place_m, **more):
    return {"kind": "waypoint", "position_world_m": place_m, **more}


def drive(speed_m_s, yaw_rate_rad_s=0.0, **more):
    return {"kind": "drive", "drive": {"speed_m_s": speed_m_s, "yaw_rate_rad_s": yaw_rate_rad_s}, **more}


def yaw_of(body):
    w, _, _, z = body.quaternion_wxyz
    return 2 * math.atan2(z, w)


def test_it_stands_at_its_start_until_it_is_asked(make_pilot):
    pilot = make_pilot(ROVER)
    assert pilot.body().position_world_m == pytest.approx((3.0, 3.0, ROVER_HEIGHT_M))
    body = pilot.run_until_asked()
    assert pilot.tick == 5
    assert body.phase == "holding"
    assert body.position_world_m == pytest.approx((3.0, 3.0, ROVER_HEIGHT_M), abs=1e-3)
    assert all(message.bodies[0].contacts == () for message in pilot.log)


def test_it_turns_and_drives_to_a_waypoint_of_any_height(asked_pilot):
    pilot = asked_pilot(ROVER)
    assert pilot.step(agent_0=waypoint(2.0, 5.0, 2.0)).phase == "driving"
    body = pilot.run_until_asked()
    assert body.position_world_m == pytest.approx((2.0, 5.0, ROVER_HEIGHT_M), abs=0.02)
    assert yaw_of(body) == pytest.approx(math.atan2(2.0, -1.0), abs=0.05)
    assert body.path_length_m == pytest.approx(math.hypot(1.0, 2.0), abs=0.05)
    assert all(message.bodies[0].contacts == () for message in pilot.log)


def test_a_waypoint_says_where_to_look(make_pilot):
    pilot = make_pilot(ROVER, mode="lockstep")
    pilot.run(3)
    pilot.step(agent_0=waypoint(4.0, 3.0, 0.1, yaw_rad=1.5))
    pilot.run_until(lambda body: body.phase == "holding")
    assert yaw_of(pilot.run(30)) == pytest.approx(1.5, abs=0.02)


def test_a_turning_velocity_drives_a_circle_of_the_right_radius(make_pilot):
    pilot = make_pilot({**ROVER, "start_m": (7.0, 3.0, 0.1)}, mode="lockstep")
    pilot.run(3)
    places = []
    for i in range(300):
        angle = 0.4 * 0.1 * i
        velocity = (0.5 * math.cos(angle), 0.5 * math.sin(angle), 0.0)
        places.append(pilot.step(agent_0={"kind": "velocity", "velocity_world_m_s": velocity}).position_world_m[:2])
    assert radius_of(places[100:]) == pytest.approx(0.5 / 0.4, rel=0.01)


@pytest.mark.parametrize(("speed_m_s", "turn_rad_s"), [(0.5, 0.5), (-0.4, 0.8), (0.8, -0.4), (0.0, 1.0)])
def test_what_is_driven_has_the_right_radius(asked_pilot, speed_m_s, turn_rad_s):
    pilot = asked_pilot({**ROVER, "start_m": (7.0, 5.0, 0.1)})
    pilot.step(agent_0=drive(speed_m_s, turn_rad_s, hold_s=60.0))
    places = [pilot.step().position_world_m[:2] for _ in range(200)]
    assert radius_of(places[50:]) == pytest.approx(abs(speed_m_s / turn_rad_s), rel=0.01, abs=1e-3)
    assert pilot.body().angular_velocity_body_rad_s[2] == pytest.approx(turn_rad_s, rel=0.01)


def radius_of(places_m):
    """Radius of the circle that fits points best, after Kasa."""
    points = np.array(places_m)
    centre_x, centre_y, rest = np.linalg.lstsq(
        np.column_stack([2 * points, np.ones(len(points))]), (points**2).sum(axis=1), rcond=None
    )[0]
    return math.sqrt(max(0.0, rest + centre_x**2 + centre_y**2))


@pytest.mark.parametrize("command", [drive(1.0), {"kind": "velocity", "velocity_world_m_s": (1.0, 0.0, 0.0)}])
def test_it_stops_before_what_is_ahead(make_pilot, command):
    pilot = make_pilot(ROVER, mode="lockstep")
    pilot.run(3)
    pilot.step(agent_0=command)
    body = pilot.run_until(lambda body: body.rejected_command)
    assert "expected a stop at x within" in body.rejected_command
    assert math.hypot(*pilot.run(30).velocity_world_m_s) < 0.01
    assert pilot.body().position_world_m[0] < 15.0 - 0.267


def test_it_collides_by_name_and_gives_up(asked_pilot):
    pilot = asked_pilot(ROVER, obstacles=[RACK])
    pilot.step(agent_0=waypoint(9.0, 3.0, 0.1))
    body = pilot.run_until(lambda body: body.contacts)
    assert body.contacts == ("rack",)
    assert body.position_world_m[0] == pytest.approx(6.0 - 0.267, abs=0.01)
    body = pilot.run_until_asked()
    assert "was still" in body.rejected_command
    assert pilot.run(20).contacts == ()


def test_a_quadrotor_and_a_rover_name_each_other(hovering_pilot):
    pilot = hovering_pilot(ROVER, {"start_m": (5.0, 3.0, 0.1)})
    pilot.step(agent_1=waypoint(3.0, 3.0, 0.5))
    pilot.run(40)
    pilot.step(agent_1={"kind": "land"})
    pilot.run_until(lambda body: body.contacts)
    assert pilot.body(0).contacts == ("agent_1",)
    assert pilot.body(1).contacts == ("agent_0",)


@pytest.mark.parametrize(
    "command", [waypoint(3.0, 8.0, 0.1), {"kind": "velocity", "velocity_world_m_s": (0.0, 0.5, 0.0), "hold_s": 600.0}]
)
def test_a_turn_that_does_not_end_is_given_up(asked_pilot, command):
    pilot = asked_pilot(ROVER)
    pilot.step(agent_0=command)
    for _ in range(240):
        pilot.core.data.qpos[3:7] = (1.0, 0.0, 0.0, 0.0)
        if pilot.step().awaiting_command:
            break
    assert pilot.body().rejected_command == (
        "turn: expected to look where it goes within 20 s, did not; the vehicle holds."
    )
    assert pilot.body().phase == "holding"
    pilot.step(agent_0=waypoint(5.0, 3.0, 0.1))
    assert math.dist(pilot.run_until_asked().position_world_m[:2], (5.0, 3.0)) < 0.1


def test_on_its_back_it_says_so_and_refuses(make_pilot):
    pilot = make_pilot(ROVER, mode="lockstep")
    pilot.run(3)
    pilot.core.data.qpos[2] = 0.14
    pilot.core.data.qpos[3:7] = (0.0, 1.0, 0.0, 0.0)
    body = pilot.run_until(lambda body: body.rejected_command)
    assert body.rejected_command == OVERTURNED_NOTICE
    assert body.phase == "on_ground"
    assert "floor" in body.contacts
    assert pilot.step(agent_0=waypoint(4.0, 4.0, 0.1)).rejected_command == OVERTURNED_NOTICE
    assert math.hypot(*pilot.run(20).velocity_world_m_s) < 0.05


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (waypoint(1000.0, 4.0, 0.1), "expected x within 0 to 15 m, was 1000 m"),
        (waypoint(4.0, 4.0, -1.0), "expected z within 0 to 6 m, was -1 m"),
        (waypoint(6.2, 4.0, 0.1), "inside rack"),
        ({"kind": "land"}, "land: expected a vehicle that flies, was a rover."),
        ({"kind": "take_off"}, "take_off: expected a vehicle that flies, was a rover."),
        ({"kind": "attitude", "attitude": {}}, "attitude: expected a vehicle with rotors, was a rover."),
        (drive(5.0), "drive.speed_m_s: expected at most 1 m/s, was 5 m/s."),
        (drive(0.1, 9.0), "drive.yaw_rate_rad_s: expected at most 1.5 rad/s, was 9 rad/s."),
    ],
)
def test_what_it_cannot_do_is_refused_with_a_reason(asked_pilot, command, text):
    pilot = asked_pilot(ROVER, obstacles=[RACK])
    body = pilot.step(agent_0=command)
    assert text in body.rejected_command
    assert body.phase == "holding"
    assert math.hypot(*pilot.run(3).velocity_world_m_s) < 0.01


def test_its_limits_are_those_of_its_wheels(asked_pilot):
    pilot = asked_pilot({**ROVER, "max_speed_m_s": 20.0, "max_acceleration_m_s2": 50.0})
    pilot.fly(waypoint(12.0, 3.0, 0.1))
    speeds = [math.hypot(*message.bodies[0].velocity_world_m_s) for message in pilot.log]
    assert 1.1 < max(speeds) < 1.22
    assert max(abs(np.diff(speeds))) < 0.1 * 1.2


def test_a_mission_leads_around_a_corner(asked_pilot):
    pilot = asked_pilot(ROVER)
    corners = [(5.0, 3.0, 0.1), (5.0, 5.0, 0.1), (3.0, 5.0, 0.1)]
    pilot.fly({"kind": "mission", "waypoints": tuple({"position_world_m": corner} for corner in corners)})
    for corner in corners:
        assert min(math.dist(m.bodies[0].position_world_m[:2], corner[:2]) for m in pilot.log) < 0.02
    assert pilot.body().path_length_m == pytest.approx(6.0, abs=0.1)


def test_a_start_in_the_air_is_refused(make_scenario, make_room):
    with pytest.raises(ScenarioError, match="expected a start on the floor for a rover, was 2 m high"):
        WorldCore(make_scenario({**ROVER, "start_m": (3.0, 3.0, 2.0)}), make_room())


def test_it_has_no_search_height():
    assert VehicleSpec(model="rover", start_m=(1.0, 1.0, 0.1)).search_height_m == ROVER_HEIGHT_M
    with pytest.raises(ValueError, match="expected no height for a rover"):
        VehicleSpec(model="rover", start_m=(1.0, 1.0, 0.1), search_height_m=2.0)


def test_equal_runs_give_equal_states(make_pilot):
    first, second = make_pilot(ROVER), make_pilot(ROVER)
    for pilot in (first, second):
        pilot.run_until_asked()
        pilot.step(agent_0=waypoint(5.0, 6.0, 0.1))
        pilot.run(60)
    assert first.log == second.log
