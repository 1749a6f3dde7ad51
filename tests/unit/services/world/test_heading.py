"""Where vehicles look: as before, towards an angle, or along their path."""

import math

import numpy as np
import pytest

from gslcosim_services.world import vehicle_records
from gslcosim_services.world.multirotor_control import advance_heading_inplace, wrap_angle

WAYPOINT = {"kind": "waypoint", "position_world_m": (3.0, 7.0, 2.0)}


def yaw_of(body):
    w, x, y, z = body.quaternion_wxyz
    return math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))


@pytest.mark.parametrize("angle", [-7.0, -math.pi, -0.1, 0.0, 3.2, 12.0])
def test_wrapped_angles_look_the_same_way(angle):
    assert -math.pi <= wrap_angle(angle) <= math.pi
    assert math.cos(wrap_angle(angle)) == pytest.approx(math.cos(angle))
    assert math.sin(wrap_angle(angle)) == pytest.approx(math.sin(angle))


@pytest.mark.parametrize("wanted", [0.5, -3.0, 5.5])
def test_the_reference_turns_the_short_way_at_no_more_than_its_rate(iris_constants, wanted):
    states = np.zeros(1, vehicle_records.STATE)
    states[0]["wanted_yaw_rad"] = wanted
    rates = []
    for _ in range(2000):
        advance_heading_inplace(iris_constants[0], states[0], 0.0, 0.0, 0.004)
        rates.append(states[0]["yaw_rate_rad_s"])
    assert states[0]["yaw_rad"] == pytest.approx(wrap_angle(wanted))
    assert rates[-1] == 0.0
    assert max(map(abs, rates)) <= 1.5
    assert sum(rates) * 0.004 == pytest.approx(wrap_angle(wanted), abs=1e-3)


def test_the_direction_of_the_path_is_taken_when_there_is_one(iris_constants):
    states = np.zeros(1, vehicle_records.STATE)
    states[0]["faces_path"] = 1
    advance_heading_inplace(iris_constants[0], states[0], 0.0, 0.01, 0.004)
    assert states[0]["wanted_yaw_rad"] == 0.0
    advance_heading_inplace(iris_constants[0], states[0], 0.0, 0.3, 0.004)
    assert states[0]["wanted_yaw_rad"] == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("model", ["iris", "crazyflie", "holonomic"])
def test_a_waypoint_with_an_angle_turns_the_nose(asked_pilot, model):
    pilot = asked_pilot({"model": model})
    body = pilot.fly({**WAYPOINT, "yaw_rad": -2.0})
    assert yaw_of(body) == pytest.approx(-2.0, abs=0.02)
    assert body.position_world_m == pytest.approx((3.0, 7.0, 2.0), abs=0.03)


def test_the_nose_stays_where_it_was(asked_pilot):
    pilot = asked_pilot()
    pilot.fly({"kind": "hold", "yaw_rad": 1.0, "hold_s": 3.0})
    pilot.step(agent_0=WAYPOINT)
    assert yaw_of(pilot.run_until_asked()) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    "command",
    [{**WAYPOINT, "faces_path": True}, {"kind": "velocity", "velocity_world_m_s": (0.0, 0.8, 0.0), "faces_path": True}],
)
def test_the_nose_is_along_the_path(hovering_pilot, command):
    pilot = hovering_pilot()
    pilot.step(agent_0=command)
    assert yaw_of(pilot.run(35)) == pytest.approx(math.pi / 2, abs=0.05)


def test_a_turning_velocity_turns_the_nose_with_it(hovering_pilot):
    """At 1 rad/s the nose lags by a third of a second: the heading follows with a gain of 3 1/s."""
    pilot = hovering_pilot({"start_m": (7.0, 5.0, 0.1)})
    for i in range(120):
        angle = 0.1 * i
        velocity = (0.8 * math.cos(angle), 0.8 * math.sin(angle), 0.0)
        body = pilot.step(agent_0={"kind": "velocity", "velocity_world_m_s": velocity, "faces_path": True})
    direction = math.atan2(body.velocity_world_m_s[1], body.velocity_world_m_s[0])
    assert 0.1 < wrap_angle(direction - yaw_of(body)) < 0.5
