import math

import numpy as np
import pytest

from gslcosim.world.physics.rotor_kernels import drag_force, lagged_rotor_speed, rotor_wrench


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


@pytest.mark.parametrize(("rotor", "signs"), [(0, (-1, -1, -1)), (1, (1, 1, -1)), (2, (1, -1, 1)), (3, (-1, 1, 1))])
def test_each_rotor_turns_the_body_by_its_place_and_direction(iris_constants, rotor, signs):
    """Front right, rear left turn counter-clockwise: their drag torque is about -z."""
    speeds = np.zeros(4)
    speeds[rotor] = 700.0
    torque = rotor_wrench(iris_constants[0], speeds)[1:4]
    assert tuple(np.sign(torque)) == signs


def test_drag_is_along_the_relative_wind_and_grows_with_it(iris_constants):
    still = drag_force(iris_constants[0], 3200.0, 0.0, 0.0, 0.0)
    assert still == (0.0, 0.0, 0.0)
    x, y, z = drag_force(iris_constants[0], 3200.0, 2.0, 0.0, 0.0)
    assert (y, z) == (0.0, 0.0)
    assert x == pytest.approx(1.75e-4 * 3200.0 * 2.0 + 0.5 * 1.204 * 0.015 * 4.0)
    assert drag_force(iris_constants[0], 3200.0, -2.0, 0.0, 0.0)[0] == -x
