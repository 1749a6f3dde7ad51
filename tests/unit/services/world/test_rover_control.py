import itertools
import math

import numpy as np
import pytest

from gslcosim.vehicles import get_vehicle
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.rover_control import path_speed_and_turn, wheel_speeds, wheel_torque_inplace
from gslcosim_services.world.scene import build_scene
from gslcosim_services.world.trajectory import Limits, plan_rest, plan_to_velocity

DT_S = 0.004
LIMITS = Limits(max_speed_m_s=2.0, max_acceleration_m_s2=2.0)


@pytest.fixture
def rover(make_room):
    """One record of the rover's constants at 4 ms."""
    model = get_vehicle("rover")
    scene = build_scene(make_room(), [("beetle", model)], DT_S)
    constants = np.zeros(1, vehicle_records.CONSTANTS)
    vehicle_records.set_constants(constants[0], model, scene.model, "beetle/", DT_S)
    return constants[0]


def following(trajectory):
    states = np.zeros(1, vehicle_records.STATE)
    vehicle_records.set_trajectory(states[0], trajectory)
    return states[0]


def test_wheels_turn_for_speed_and_turn(rover):
    left, right = wheel_speeds(rover, 0.5, 0.8)
    assert (left + right) / 2 * 0.0975 == pytest.approx(0.5)
    assert (right - left) / (2 * 0.158) * 0.0975 == pytest.approx(0.8)


def test_wheels_keep_the_turn_rather_than_the_speed(rover):
    left, right = wheel_speeds(rover, 9.0, 1.0)
    assert (right - left) / (2 * 0.158) * 0.0975 == pytest.approx(1.0)
    assert right * 0.0975 == pytest.approx(1.2 * 1.2)
    left, right = wheel_speeds(rover, 0.0, 50.0)
    assert (right - left) / (2 * 0.158) * 0.0975 == pytest.approx(1.2 * 1.5)


def test_motors_push_towards_the_wanted_speed_up_to_their_torque(rover):
    state = following(plan_rest((0.0, 0.0, 0.0), 0))
    torque = wheel_torque_inplace(rover, state, 1, 1.0, 0.5, DT_S)
    assert state["wheel_integral_n_m"].tolist() == pytest.approx([0.0, 6.0 * 0.5 * DT_S])
    assert torque == pytest.approx(1.5 * 0.5 + 6.0 * 0.5 * DT_S)
    for _ in range(5000):
        assert abs(wheel_torque_inplace(rover, state, 0, -90.0, 0.0, DT_S)) <= 2.0
    assert state["wheel_integral_n_m"][0] == -2.0


def test_on_the_path_it_goes_as_the_path_does(rover):
    """v = v_r and w = w_r without errors; here on a straight line."""
    state = following(
        plan_to_velocity(np.zeros((3, 3)), (0.6, 0.8, 0.0), Limits(max_speed_m_s=2.0, max_acceleration_m_s2=2.0), 0)
    )
    place = state["end_world_m"] + 3.0 * state["end_velocity_world_m_s"]
    yaw = math.atan2(0.8, 0.6)
    speed, turn = path_speed_and_turn(rover, state, place[0], place[1], yaw, state["duration_s"] + 3.0, DT_S)
    assert (speed, turn) == pytest.approx((1.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("error", [(0.3, 0.2, 0.0), (-0.2, 0.4, 0.8), (0.0, -0.3, -2.5), (0.1, 0.1, math.pi)])
def test_errors_fall_as_a_lyapunov_function_says(rover, error):
    """V = (e_x^2 + e_y^2)/2 + (1 - cos e_th)/k_y never rises while e_th is within a quarter turn, and ends at 0."""
    cruise = plan_to_velocity(np.array([[0.0] * 3, (0.5, 0.0, 0.0), [0.0] * 3]), (0.5, 0.0, 0.0), LIMITS, 0)
    state = following(cruise)
    x, y, yaw = -error[0], -error[1], -error[2]
    values = []
    for i in range(5000):
        t_s = i * DT_S
        e_x, e_y = 0.5 * t_s - x, -y
        values.append((0.5 * (e_x**2 + e_y**2) + (1 - math.cos(yaw)) / 8.0, abs(math.remainder(yaw, 2 * math.pi))))
        v, w = path_speed_and_turn(rover, state, x, y, yaw, t_s, DT_S)
        x, y, yaw = x + v * math.cos(yaw) * DT_S, y + v * math.sin(yaw) * DT_S, yaw + w * DT_S
    for (before, angle), (after, _) in itertools.pairwise(values):
        assert after <= before + 1e-5 or angle > math.pi / 2
    assert values[-1][0] < 1e-5


def test_standing_it_turns_to_the_heading_wanted(rover):
    state = following(plan_rest((1.0, 1.0, 0.0), 0))
    state["wanted_yaw_rad"] = 2.0
    yaw = 0.0
    for i in range(1500):
        speed, turn = path_speed_and_turn(rover, state, 1.0, 1.0, yaw, i * DT_S, DT_S)
        assert speed == 0.0
        assert abs(turn) < 2.0
        yaw += turn * DT_S
    assert yaw == pytest.approx(2.0, abs=1e-3)
