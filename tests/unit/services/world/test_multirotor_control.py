# ruff: noqa: N803, N806 - symbols of equations
import math

import numpy as np
import pytest

from gslcosim.base.frames import world_from_body_rotation
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.multirotor_control import (
    attitude_from_force,
    attitude_torque,
    axis_acceleration_inplace,
    limited_specific_force,
    reference_at,
    rotation_from_quaternion,
    rotor_speed_command,
    thrust_along,
)
from gslcosim_services.world.trajectory import Trajectory

LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
G = 9.81


def attitude_wrench(vehicle, R, *numbers, yaw=0.0):
    """Thrust and torque that turn the thrust axis to a force: from rates, force and jerk, as position control does."""
    omega, force, jerk = numbers[:3], numbers[3:6], numbers[6:9]
    R_d, omega_d = attitude_from_force(*force, *jerk, yaw, 0.0)
    return (thrust_along(vehicle, R, *force), *attitude_torque(vehicle, R, *omega, R_d, omega_d))


def state_record():
    return np.zeros(1, vehicle_records.STATE)


def test_rotation_agrees_with_frames():
    q = np.array([0.7, -0.2, 0.5, 0.3])
    q = tuple((q / np.linalg.norm(q)).tolist())
    assert rotation_from_quaternion(*q) == pytest.approx(world_from_body_rotation(q).ravel().tolist())


def test_the_reference_goes_on_with_its_end_velocity():
    states = state_record()
    coefficients = np.zeros((3, 6))
    coefficients[:, 1] = (1.0, 2.0, 3.0)
    trajectory = Trajectory(
        start_tick=0,
        coefficients=coefficients,
        duration_s=2.0,
        end_world_m=(2.0, 4.0, 6.0),
        end_velocity_world_m_s=(1.0, 2.0, 3.0),
    )
    vehicle_records.set_trajectory(states[0], trajectory)
    for t_s in (0.0, 1.9, 2.0, 5.0):
        assert reference_at(states[0], 1, t_s) == pytest.approx((2.0 * t_s, 2.0, 0.0, 0.0))


def test_hovering_at_the_reference_asks_for_weight_and_no_torque(iris_constants):
    thrust, *torque = attitude_wrench(iris_constants[0], LEVEL, 0.0, 0.0, 0.0, 0.0, 0.0, G, 0.0, 0.0, 0.0)
    assert thrust == pytest.approx(iris_constants[0]["mass_kg"] * G)
    assert torque == pytest.approx([0.0, 0.0, 0.0], abs=1e-15)


def test_position_error_pulls_towards_the_reference_and_integrates(iris_constants):
    states = state_record()
    a, _ = axis_acceleration_inplace(iris_constants[0], states[0], 2, -0.1, 0.0, 0.0, 0.004)
    gain, integral_gain = iris_constants[0]["position_gain_s2"], iris_constants[0]["integral_gain_s3"]
    assert states[0]["integral_m_s2"][2] == pytest.approx(integral_gain * 0.1 * 0.004)
    assert a == pytest.approx(gain * 0.1 + states[0]["integral_m_s2"][2])


def test_the_integral_is_clamped(iris_constants):
    states = state_record()
    for _ in range(2000):
        axis_acceleration_inplace(iris_constants[0], states[0], 0, 10.0, 0.0, 0.0, 0.004)
    assert states[0]["integral_m_s2"][0] == -iris_constants[0]["integral_limit_m_s2"]


@pytest.mark.parametrize("wanted", [(50.0, -20.0, 3.0), (0.0, 0.0, -40.0), (0.1, 0.2, 100.0), (3.0, 0.0, -20.0)])
def test_specific_force_keeps_lift_and_tilt_within_bounds(iris_constants, wanted):
    f_x, f_y, f_z = limited_specific_force(iris_constants[0], *wanted)
    assert 0.3 * G <= f_z <= 1.7 * G
    assert math.atan2(math.hypot(f_x, f_y), f_z) <= 0.6 + 1e-12
    assert f_x * wanted[1] == pytest.approx(f_y * wanted[0])


@pytest.mark.parametrize(
    ("axis", "force"), [(0, (0.0, -1.0, G)), (1, (1.0, 0.0, G))], ids=["left is roll -", "forward is pitch +"]
)
def test_torque_tilts_the_thrust_axis_to_the_force(iris_constants, axis, force):
    torque = attitude_wrench(iris_constants[0], LEVEL, 0.0, 0.0, 0.0, *force, 0.0, 0.0, 0.0)[1:]
    tilt = math.atan2(1.0, G)
    gain, inertia = iris_constants[0]["attitude_gain_s2"][axis], iris_constants[0]["inertia_kg_m2"][axis]
    assert torque[axis] == pytest.approx(inertia * gain * math.sin(tilt))


def test_heading_is_turned_back_to_world_x(iris_constants):
    yaw = 0.4
    turned = rotation_from_quaternion(math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
    torque = attitude_wrench(iris_constants[0], turned, 0.0, 0.0, 0.0, 0.0, 0.0, G, 0.0, 0.0, 0.0)[1:]
    gain, inertia = iris_constants[0]["attitude_gain_s2"][2], iris_constants[0]["inertia_kg_m2"][2]
    assert torque == pytest.approx((0.0, 0.0, -inertia * gain * math.sin(yaw)), abs=1e-15)


def test_jerk_asks_for_the_rate_that_turns_the_force(iris_constants):
    """In hover, jerk along x turns the thrust axis about +y at j/g: with that rate there is no torque."""
    torque = attitude_wrench(iris_constants[0], LEVEL, 0.0, 2.0 / G, 0.0, 0.0, 0.0, G, 2.0, 0.0, 0.0)[1:]
    assert torque == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    torque = attitude_wrench(iris_constants[0], LEVEL, -2.0 / G, 0.0, 0.0, 0.0, 0.0, G, 0.0, 2.0, 0.0)[1:]
    assert torque == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


def test_gyroscopic_torque_is_cancelled(iris_constants):
    """With the attitude right, torque is damping plus omega x J omega."""
    J = iris_constants[0]["inertia_kg_m2"]
    k_w = iris_constants[0]["rate_gain_s"]
    omega = np.array([0.5, -0.3, 2.0])
    torque = attitude_wrench(iris_constants[0], LEVEL, *omega.tolist(), 0.0, 0.0, G, 0.0, 0.0, 0.0)[1:]
    assert torque == pytest.approx((-J * k_w * omega + np.cross(omega, J * omega)).tolist())


def test_rotor_commands_stay_within_reach(iris_constants):
    for wrench in ((-10.0, 0.0, 0.0, 0.0), (500.0, 0.0, 0.0, 0.0), (15.0, 50.0, -50.0, 9.0)):
        for i in range(4):
            assert 0.0 <= rotor_speed_command(iris_constants[0], i, *wrench) <= 1100.0
