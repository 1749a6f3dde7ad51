"""Rotations and frames: quaternions are (w, x, y, z), world is x east, y north, z up, body is x forward."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.base import elementary

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
    return elementary.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def quaternion_from_yaw(yaw_rad: ArrayLike) -> NDArray[np.float64]:
    """Return the attitude of a level vehicle, (..., 4) as w, x, y, z, for headings (...) [rad]."""
    half_rad = np.asarray(yaw_rad, np.float64) / 2.0
    nothing = np.zeros_like(half_rad)
    return np.stack([elementary.cos_each(half_rad), nothing, nothing, elementary.sin_each(half_rad)], axis=-1)


def rotation_from_rpy(rpy_rad: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the (3, 3) matrix that turns vectors by roll, then pitch, then yaw about fixed axes x, y and z.

    R = Rz(yaw) Ry(pitch) Rx(roll)
    """
    (cr, sr), (cp, sp), (cy, sy) = ((elementary.cos(angle), elementary.sin(angle)) for angle in rpy_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def quaternion_from_rotation(rotation: NDArray[np.float64]) -> Quaternion:
    """Return the unit quaternion (w >= 0) of a (3, 3) rotation matrix.

    The largest of the four components is taken from the trace, the others from sums and differences.
    """
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation.tolist()
    squares = (1 + r00 + r11 + r22, 1 + r00 - r11 - r22, 1 - r00 + r11 - r22, 1 - r00 - r11 + r22)
    i = squares.index(max(squares))
    rows = (
        (squares[0], r21 - r12, r02 - r20, r10 - r01),
        (r21 - r12, squares[1], r10 + r01, r02 + r20),
        (r02 - r20, r10 + r01, squares[2], r21 + r12),
        (r10 - r01, r02 + r20, r21 + r12, squares[3]),
    )
    scale = math.copysign(0.5 / math.sqrt(squares[i]), rows[i][0] or 1.0)
    w, x, y, z = (scale * component for component in rows[i])
    return (w, x, y, z)
