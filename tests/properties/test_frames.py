import math

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from gslcosim.base.frames import world_from_body_rotation, yaw_from_quaternion

components = st.floats(-1.0, 1.0)


@st.composite
def unit_quaternions(draw):
    raw = draw(st.tuples(components, components, components, components))
    norm = math.sqrt(sum(value * value for value in raw))
    assume(norm > 1e-3)
    return tuple(value / norm for value in raw)


@given(unit_quaternions())
def test_rotations_keep_lengths_angles_and_handedness(quaternion_wxyz):
    rotation = world_from_body_rotation(quaternion_wxyz)
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert math.isclose(np.linalg.det(rotation), 1.0, abs_tol=1e-12)


@given(unit_quaternions())
def test_a_quaternion_and_its_negative_are_the_same_attitude(quaternion_wxyz):
    negative = tuple(-value for value in quaternion_wxyz)
    assert np.array_equal(world_from_body_rotation(quaternion_wxyz), world_from_body_rotation(negative))
    assert yaw_from_quaternion(quaternion_wxyz) == yaw_from_quaternion(negative)
