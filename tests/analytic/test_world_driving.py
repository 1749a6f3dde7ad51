"""Driving against closed forms: speeding up, rolling without slipping, turning with a mass that is off the axle."""

import math

import mujoco
import numpy as np
import pytest

from gslcosim.contract.messages import DriveSetpoint

RADIUS_M, HALF_TRACK_M = 0.0975, 0.158


def driven(robot_study, ticks, *, speed_m_s, turn_rad_s=0.0, **vehicle):
    """A rover after a number of ticks at a set speed and turn, and its wheels' angles before [rad]."""
    flight = robot_study.Flight(robot_study.closed_room(), model="rover", **{"start_m": (2.0, 5.0, 0.1), **vehicle})
    for _ in flight.run_until_asked():
        pass
    start, angles = flight.body, flight.core.data.qpos[7:9].copy()
    flight.step(kind="drive", drive=DriveSetpoint(speed_m_s=speed_m_s, yaw_rate_rad_s=turn_rad_s), hold_s=60.0)
    for _ in range(ticks - 1):
        flight.step()
    return flight, start, flight.core.data.qpos[7:9] - angles


def test_it_speeds_up_with_its_acceleration(robot_study):
    """x = v^2/(2 a) + v (t - v/a), but for the lag of the wheels' servo, below 0.05 s."""
    flight, start, _ = driven(robot_study, 60, speed_m_s=0.8)
    length_m = flight.body.position_world_m[0] - start.position_world_m[0]
    assert length_m == pytest.approx(0.8**2 / 2 + 0.8 * (6.0 - 0.8), abs=0.8 * 0.05)


def test_wheels_roll_without_slipping(robot_study):
    """The way is the mean of what the wheels roll, the turn their difference over the track."""
    flight, start, rolled = driven(robot_study, 80, speed_m_s=0.5, turn_rad_s=0.3)
    assert flight.body.path_length_m - start.path_length_m == pytest.approx(RADIUS_M * rolled.mean(), rel=5e-3)
    w, _, _, z = flight.body.quaternion_wxyz
    turned = RADIUS_M * (rolled[1] - rolled[0]) / (2 * HALF_TRACK_M)
    assert math.remainder(2 * math.atan2(z, w) - turned, 2 * math.pi) == pytest.approx(0.0, abs=0.02)


def test_a_turn_needs_the_torque_of_its_centre_of_mass(robot_study):
    """In a steady circle the mass d behind the axle wants m v w d about the axle: +-m v w d r/(2 b) a wheel."""
    flight, _, _ = driven(robot_study, 150, speed_m_s=0.5, turn_rad_s=0.5, start_m=(7.0, 3.0, 0.1))
    left, right = flight.core.data.qfrc_applied[6:8]
    # The body of 8 kg has its centre of mass 0.05 m behind the axle; wheels are on it.
    expected_n_m = 8.0 * 0.5 * 0.5 * 0.05 * RADIUS_M / (2 * HALF_TRACK_M)
    assert abs(right - left) / 2 == pytest.approx(expected_n_m, rel=0.1)


def test_at_rest_it_weighs_on_wheels_and_caster(robot_study):
    flight = robot_study.Flight(robot_study.closed_room(), model="rover")
    for _ in range(20):
        flight.step()
    data, model = flight.core.data, flight.core.model
    force = np.zeros(6)
    carried = {}
    for i, (a, b) in enumerate(data.contact.geom):
        mujoco.mj_contactForce(model, data, i, force)
        part = next(name for name in (model.geom(a).name, model.geom(b).name) if name.startswith("beetle/"))
        carried[part.split("/")[1]] = force[0]
    assert sum(carried.values()) == pytest.approx(9.001 * 9.81, rel=1e-3)
    assert carried["caster"] == pytest.approx(8.0 * 9.81 * 0.05 / 0.2145, rel=0.01)
    assert carried["wheel_left"] == pytest.approx(carried["wheel_right"], rel=1e-3)
