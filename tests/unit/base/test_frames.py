import math

import numpy as np
import pytest

from gslcosim.base.frames import (
    quaternion_from_rotation,
    rotation_from_rpy,
    world_from_body_rotation,
    yaw_from_quaternion,
)


def about(axis: tuple[float, float, float], angle_rad: float) -> tuple[float, float, float, float]:
    x, y, z = axis
    s = math.sin(angle_rad / 2)
    return (math.cos(angle_rad / 2), s * x, s * y, s * z)


@pytest.mark.parametrize(
    ("axis", "turned_m"),
    [((0, 0, 1), (-2.0, 1.0, 3.0)), ((1, 0, 0), (1.0, -3.0, 2.0)), ((0, 1, 0), (3.0, 2.0, -1.0))],
)
def test_a_quarter_turn_moves_the_body_axes_right_handed(axis, turned_m):
    rotation = world_from_body_rotation(about(axis, math.pi / 2))
    assert rotation @ (1.0, 2.0, 3.0) == pytest.approx(turned_m)


@pytest.mark.parametrize("angle_rad", [-3.1, -1.0, 0.0, 0.5, 3.1])
def test_yaw_is_the_turn_about_the_vertical(angle_rad):
    assert yaw_from_quaternion(about((0, 0, 1), angle_rad)) == pytest.approx(angle_rad)


def test_yaw_is_where_the_forward_axis_points_also_when_pitched():
    # First 0.3 rad nose down, then 1 rad to the left.
    w1, _, _, z1 = about((0, 0, 1), 1.0)
    w2, _, y2, _ = about((0, 1, 0), 0.3)
    both = (w1 * w2, -z1 * y2, w1 * y2, z1 * w2)
    forward = world_from_body_rotation(both)[:, 0]
    assert math.atan2(forward[1], forward[0]) == pytest.approx(1.0)
    assert yaw_from_quaternion(both) == pytest.approx(1.0)


def test_a_quaternion_comes_back_from_its_matrix():
    rng = np.random.default_rng(1)
    for q in [*rng.normal(size=(50, 4)), *np.eye(4)]:
        unit = q / np.linalg.norm(q)
        rotation = world_from_body_rotation(tuple(unit))
        assert world_from_body_rotation(quaternion_from_rotation(rotation)) == pytest.approx(rotation, abs=1e-12)


def test_roll_pitch_and_yaw_turn_about_fixed_axes():
    """After a roll of a quarter turn, y points up; a yaw of a quarter turn about the world's z leaves it there."""
    quarter = math.pi / 2
    assert rotation_from_rpy((quarter, 0.0, quarter)) @ (0.0, 1.0, 0.0) == pytest.approx((0.0, 0.0, 1.0))
    assert rotation_from_rpy((0.0, quarter, 0.0)) @ (1.0, 0.0, 0.0) == pytest.approx((0.0, 0.0, -1.0))
