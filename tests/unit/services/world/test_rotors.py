import math

import numpy as np
import pytest

from gslcosim.vehicles import get_vehicle
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.multirotor_control import drag_force, lagged_rotor_speed, rotor_speed_command, rotor_wrench
from gslcosim_services.world.scene import build_scene


@pytest.mark.parametrize(("start", "command", "tau_s"), [(0.0, 800.0, 0.0125), (800.0, 100.0, 0.025)])
def test_a_rotor_closes_the_gap_exponentially(iris_constants, start, command, tau_s):
    speed = start
    for _ in range(5):
        speed = lagged_rotor_speed(iris_constants[0], speed, command)
    assert speed == pytest.approx(command + (start - command) * math.exp(-5 * 0.004 / tau_s))


def test_equal_rotors_lift_without_torque(iris_constants):
    """Front and rear arms differ by 2 cm: the roll torques of the pairs cancel."""
    thrust, *torque, total = rotor_wrench(iris_constants[0], np.full(4, 500.0))
    assert thrust == pytest.approx(4 * 5.84e-6 * 500.0**2)
    assert torque == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert total == 2000.0


def test_drag_is_along_the_relative_wind_and_grows_with_it(iris_constants):
    still = drag_force(iris_constants[0], 3200.0, 0.0, 0.0, 0.0)
    assert still == (0.0, 0.0, 0.0)
    x, y, z = drag_force(iris_constants[0], 3200.0, 2.0, 0.0, 0.0)
    assert (y, z) == (0.0, 0.0)
    assert x == pytest.approx(1.75e-4 * 3200.0 * 2.0 + 0.5 * 1.204 * 0.015 * 4.0)
    assert drag_force(iris_constants[0], 3200.0, -2.0, 0.0, 0.0)[0] == -x


def constants_of(name, room):
    constants = np.zeros(1, vehicle_records.CONSTANTS)
    vehicle = get_vehicle(name)
    scene = build_scene(room, [("beetle", vehicle)], 0.004)
    vehicle_records.set_constants(constants[0], vehicle, scene.model, "beetle/", 0.004)
    return constants[0]


@pytest.mark.parametrize("name", ["iris", "crazyflie", "hexarotor"])
def test_rotors_give_the_wrench_that_is_wanted(make_room, name):
    record = constants_of(name, make_room())
    weight_n, arm_m = record["mass_kg"] * 9.81, get_vehicle(name).rotors.motor_distance_m / 2
    wanted = (weight_n, 0.05 * weight_n * arm_m, -0.03 * weight_n * arm_m, 0.01 * weight_n * arm_m)
    speeds = np.array([rotor_speed_command(record, i, *wanted) for i in range(record["n_rotors"])])
    assert rotor_wrench(record, speeds)[:4] == pytest.approx(wanted)


def test_more_rotors_than_needed_share_the_work(make_room):
    """In hover all of them turn alike, at the speed of the closed form: sqrt(m g / (n c))."""
    record = constants_of("hexarotor", make_room())
    speeds = [rotor_speed_command(record, i, 1.53 * 9.81, 0.0, 0.0, 0.0) for i in range(6)]
    assert speeds == pytest.approx([math.sqrt(1.53 * 9.81 / (6 * 8.54858e-06))] * 6)
    assert vehicle_records.hover_rotor_speed_rad_s(record) == pytest.approx(speeds[0])


def test_four_rotors_are_mixed_by_the_inverse(make_room):
    record = constants_of("iris", make_room())
    wrench_from_thrusts = np.ascontiguousarray(record["wrench_from_thrusts"][:, :4])
    inverse = np.linalg.inv(wrench_from_thrusts)
    assert record["thrusts_from_wrench"][:4] == pytest.approx(inverse, rel=1e-14)
    assert not record["thrusts_from_wrench"][4:].any()
