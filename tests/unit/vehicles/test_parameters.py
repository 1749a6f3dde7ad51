"""What follows from the facts of a vehicle."""

import numpy as np
import pytest

from gslcosim.vehicles import get_vehicle, list_vehicle_names

MULTIROTORS = [name for name in list_vehicle_names() if get_vehicle(name).rotors]


@pytest.mark.parametrize("name", MULTIROTORS)
def test_equal_thrusts_lift_without_turning(name):
    rotors = get_vehicle(name).rotors
    wrench = rotors.wrench_from_thrusts() @ np.ones(rotors.n_rotors)
    assert wrench == pytest.approx([rotors.n_rotors, 0.0, 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("name", MULTIROTORS)
def test_a_rotor_turns_the_body_by_its_place_and_against_its_direction(name):
    rotors = get_vehicle(name).rotors
    for i, (x_m, y_m, _) in enumerate(rotors.rotor_places_m):
        force_n = np.array([0.0, 0.0, 1.0])
        thrust, *torque = rotors.wrench_from_thrusts()[:, i]
        drag_torque = -rotors.rotor_directions[i] * rotors.torque_per_thrust_m * force_n
        assert thrust == 1.0
        assert torque == pytest.approx(np.cross([x_m, y_m, 0.0], force_n) + drag_torque)


def test_the_motor_distance_is_the_diagonal():
    assert get_vehicle("crazyflie").rotors.motor_distance_m == pytest.approx(0.092, abs=1e-4)
    assert get_vehicle("iris").rotors.motor_distance_m == pytest.approx(np.hypot(0.26, 0.42))


def test_only_what_has_wheels_drives():
    assert {name for name in list_vehicle_names() if get_vehicle(name).drives} == {"rover"}
    assert all((get_vehicle(name).wheels is not None) == get_vehicle(name).drives for name in list_vehicle_names())
