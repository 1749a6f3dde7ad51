"""Rotations and frames: quaternions are (w, x, y, z), world is x east, y north, z up, body is x forward."""

import math

import numpy as np
from numpy.typing import NDArray

Quaternion = tuple[float, float, float, float]


def world_from_body_rotation(quaternion_wxyz: Quaternion) -> NDArray[np.float64]:
    """Return the (3, 3) matrix that turns body-frame vectors into world-frame vectors.

    Args:
        quaternion_wxyz: Unit quaternion of the body's attitude in the world frame.
    """
    w, x, y, z = quaternion_wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def yaw_from_quaternion(quaternion_wxyz: Quaternion) -> float:
    """Return the heading [rad] of the body's x axis, counter-clockwise from world x, in (-pi, pi]."""
    w, x, y, z = quaternion_wxyz
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
