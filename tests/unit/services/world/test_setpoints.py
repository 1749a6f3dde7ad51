"""Attitude and rates from agents with a control of their own."""

import math

import numpy as np
import pytest

from gslcosim.base.frames import world_from_body_rotation
from gslcosim.contract.messages import AttitudeSetpoint, Command, RateSetpoint
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.multirotor_control import (
    align_heading_reference_inplace,
    attitude_from_angles,
    rate_torque,
    rotation_from_quaternion,
    thrust_from_setpoint,
)

WEIGHT_N = 1.535 * 9.81


def attitude(**fields):
    return {"kind": "attitude", "attitude": fields}


def rates(*rates_body_rad_s, **fields):
    return {"kind": "rates", "rates": {"rates_body_rad_s": rates_body_rad_s, **fields}}


FAR_FROM_WALLS = {"start_m": (7.0, 5.0, 0.1)}


def angles_of(body):
    turn = world_from_body_rotation(body.quaternion_wxyz)
    return math.atan2(turn[2, 1], turn[2, 2]), -math.asin(turn[2, 0]), math.atan2(turn[1, 0], turn[0, 0])


def test_angles_turn_about_z_then_y_then_x():
    def about(axis, angle):
        q = [math.cos(angle / 2), 0.0, 0.0, 0.0]
        q[1 + axis] = math.sin(angle / 2)
        return world_from_body_rotation(tuple(q))

    expected = about(2, 0.7) @ about(1, -0.4) @ about(0, 0.2)
    assert attitude_from_angles(0.2, -0.4, 0.7) == pytest.approx(expected.ravel().tolist())


def test_a_rate_that_is_met_needs_no_torque_but_the_gyroscopic(iris_constants):
    inertia = iris_constants[0]["inertia_kg_m2"]
    omega = np.array([0.5, -0.3, 2.0])
    torque = rate_torque(iris_constants[0], *omega.tolist(), *omega.tolist(), 0.0, 0.0, 0.0)
    assert torque == pytest.approx(np.cross(omega, inertia * omega).tolist())


def test_thrust_is_what_is_set_or_what_keeps_the_climb(iris_constants):
    states = np.zeros(1, vehicle_records.STATE)
    tilted = rotation_from_quaternion(math.cos(0.2), math.sin(0.2), 0.0, 0.0)
    vehicle_records.set_setpoint(states[0], AttitudeSetpoint(thrust_n=7.5))
    assert thrust_from_setpoint(iris_constants[0], states[0], tilted, 0.0) == 7.5
    vehicle_records.set_setpoint(states[0], RateSetpoint(rates_body_rad_s=(0.0, 0.0, 0.0), climb_m_s=0.5))
    assert thrust_from_setpoint(iris_constants[0], states[0], tilted, 0.5) == pytest.approx(WEIGHT_N / math.cos(0.4))
    assert thrust_from_setpoint(iris_constants[0], states[0], tilted, 0.0) > WEIGHT_N / math.cos(0.4)


def test_the_heading_follows_the_nose_meanwhile():
    states = np.zeros(1, vehicle_records.STATE)
    align_heading_reference_inplace(states[0], rotation_from_quaternion(math.cos(0.5), 0.0, 0.0, math.sin(0.5)))
    assert (states[0]["yaw_rad"], states[0]["wanted_yaw_rad"]) == pytest.approx((1.0, 1.0))


@pytest.mark.parametrize("model", ["iris", "crazyflie"])
def test_an_attitude_is_taken_and_the_height_kept(hovering_pilot, model):
    pilot = hovering_pilot({**FAR_FROM_WALLS, "model": model})
    pilot.step(agent_0=attitude(roll_rad=-0.1, pitch_rad=0.15, yaw_rad=0.6))
    for _ in range(15):
        body = pilot.step(agent_0={"kind": "noop"})
    assert angles_of(body) == pytest.approx((-0.1, 0.15, 0.6), abs=0.03)
    assert body.position_world_m[2] == pytest.approx(2.0, abs=0.1)
    assert body.tracking_error_m is None


def test_pitch_accelerates_by_g_times_its_tangent(hovering_pilot):
    pilot = hovering_pilot(FAR_FROM_WALLS)
    pilot.step(agent_0=attitude(pitch_rad=0.1))
    pilot.run(2)
    before = pilot.body().velocity_world_m_s[0]
    after = pilot.run(5).velocity_world_m_s[0]
    assert (after - before) / 0.5 == pytest.approx(9.81 * math.tan(0.1), rel=0.15)


@pytest.mark.parametrize(("factor", "accelerates_m_s2"), [(1.1, 0.981), (1.0, 0.0), (0.9, -0.981)])
def test_thrust_accelerates_by_newton(hovering_pilot, factor, accelerates_m_s2):
    pilot = hovering_pilot(FAR_FROM_WALLS)
    pilot.step(agent_0=attitude(thrust_n=factor * WEIGHT_N))
    before = pilot.run(1).velocity_world_m_s[2]
    after = pilot.run(4).velocity_world_m_s[2]
    assert (after - before) / 0.4 == pytest.approx(accelerates_m_s2, abs=0.05)


def test_rates_are_turned_at(hovering_pilot):
    pilot = hovering_pilot(FAR_FROM_WALLS)
    pilot.step(agent_0=rates(0.0, 0.0, 0.8))
    body = pilot.run(15)
    assert body.angular_velocity_body_rad_s == pytest.approx((0.0, 0.0, 0.8), abs=0.03)
    pilot.step(agent_0=rates(0.5, -0.4, 0.0))
    assert pilot.run(3).angular_velocity_body_rad_s[:2] == pytest.approx((0.5, -0.4), abs=0.06)


def test_a_path_takes_over_where_the_vehicle_is(hovering_pilot):
    pilot = hovering_pilot(FAR_FROM_WALLS)
    pilot.step(agent_0=attitude(pitch_rad=0.1, yaw_rad=0.5))
    pilot.run(15)
    speed = math.hypot(*pilot.body().velocity_world_m_s)
    assert speed > 0.8
    body = pilot.step(agent_0={"kind": "hold"})
    assert math.hypot(*body.velocity_world_m_s) > 0.6 * speed
    body = pilot.run(40)
    assert math.hypot(*body.velocity_world_m_s) < 0.02
    assert angles_of(body)[2] == pytest.approx(0.5, abs=0.03)
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (7.0, 7.0, 2.0)})
    assert pilot.run_until(lambda body: body.phase == "holding").position_world_m == pytest.approx(
        (7.0, 7.0, 2.0), abs=0.03
    )


def test_an_agent_on_request_is_asked_again_after_its_hold_time(asked_pilot):
    pilot = asked_pilot()
    pilot.step(agent_0={**attitude(), "hold_s": 0.4})
    asked_at = pilot.tick
    pilot.run_until_asked()
    assert pilot.tick == asked_at + 3
    assert pilot.body().phase == "flying"


@pytest.mark.parametrize(
    ("model", "command", "text"),
    [
        ("holonomic", attitude(), "attitude: expected a vehicle with rotors, was a holonomic."),
        ("holonomic", rates(0.0, 0.0, 0.0), "rates: expected a vehicle with rotors, was a holonomic."),
        ("iris", attitude(thrust_n=29.0), "attitude.thrust_n: expected at most 28.27 N, was 29 N."),
        ("hexarotor", attitude(thrust_n=37.0), "attitude.thrust_n: expected at most 36.02 N, was 37 N."),
        ("iris", rates(0.0, 0.0, 0.0, climb_m_s=-3.0), "rates.climb_m_s: expected at most 1 m/s, was 3 m/s."),
        ("iris", {"kind": "drive", "drive": {"speed_m_s": 0.5}}, "drive: expected a vehicle on wheels, was a iris."),
    ],
)
def test_what_a_vehicle_cannot_do_is_refused(asked_pilot, model, command, text):
    pilot = asked_pilot({"model": model})
    body = pilot.step(agent_0=command)
    assert body.rejected_command == text
    assert body.phase == "holding"


@pytest.mark.parametrize(
    "fields",
    [
        attitude(pitch_rad=4.0),
        attitude(thrust_n=-1.0),
        rates(51.0, 0.0, 0.0),
        {"kind": "attitude"},
        {"kind": "rates"},
    ],
)
def test_setpoints_out_of_range_are_no_commands(fields):
    with pytest.raises(ValueError, match=r"expected|[Ii]nput"):
        Command(tick=0, **fields)
