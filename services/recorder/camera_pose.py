"""Camera poses with which a recording opens: the room from above and aside, the map from straight above."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Environment

# Where the eye stands, seen from the room's middle: somewhat west of south and above, the inlet's side in front.
CAMERA_AZIMUTH_RAD = math.radians(-114.0)
CAMERA_ELEVATION_RAD = math.radians(31.0)
# The viewer's vertical field of view, measured in pictures of it, and the shapes of the views in a 16:10 window.
FIELD_OF_VIEW_RAD = math.radians(55.0)
ROOM_VIEW_ASPECT = 1.95
MAP_VIEW_ASPECT = 1.4
# Room for the colour scale west of the map, and margins, in fractions of the side.
MAP_SCALE_FRAC = 0.3
MAP_MARGIN_FRAC = 0.09
ROOM_MARGIN_FRAC = 0.02


def fit_room_camera(environment: Environment) -> tuple[Vec3, Vec3]:
    """Return eye and target [m] of the nearest camera that has all corners of the room, walls included, in view.

    For a corner c seen along the fixed directions right, up and backward, |c.up - t_up| <= h (d - c.backward) must hold
    with h the tangent of half the field of view, t the target and d the eye's distance (likewise for right with the
    view's aspect). With A = max(c.up + h c.backward) and B = max(-c.up + h c.backward) the smallest d is
    (A + B) / (2 h), at t_up = (A - B) / 2 (our derivation).
    """
    corners_m = np.array(list(itertools.product(*zip(*_extent_m(environment), strict=True))))
    level = math.cos(CAMERA_ELEVATION_RAD)
    backward = np.array(
        [level * math.cos(CAMERA_AZIMUTH_RAD), level * math.sin(CAMERA_AZIMUTH_RAD), math.sin(CAMERA_ELEVATION_RAD)]
    )
    right = np.array([-math.sin(CAMERA_AZIMUTH_RAD), math.cos(CAMERA_AZIMUTH_RAD), 0.0])
    up = np.cross(backward, right)
    half_height = math.tan(FIELD_OF_VIEW_RAD / 2)
    distances_m, offsets_m = [], []
    for direction, h in ((right, half_height * ROOM_VIEW_ASPECT), (up, half_height)):
        across_m, towards_m = corners_m @ direction, h * (corners_m @ backward)
        a_m, b_m = float(np.max(across_m + towards_m)), float(np.max(-across_m + towards_m))
        distances_m.append((a_m + b_m) / (2 * h))
        offsets_m.append((a_m - b_m) / 2)
    # Depths count from the world's origin along `backward`; the target lies at the corners' mean depth.
    depth_m = float(np.mean(corners_m @ backward))
    target_m = offsets_m[0] * right + offsets_m[1] * up + depth_m * backward
    distance_m = (1 + ROOM_MARGIN_FRAC) * (max(distances_m) - depth_m)
    return _vec3(target_m + distance_m * backward), _vec3(target_m)


def fit_map_camera(environment: Environment, height_m: float, *, n_views: int = 1) -> tuple[Vec3, Vec3]:
    """Return eye and target [m] that look straight down on the layer, with the colour scale in view.

    Args:
        environment: The room.
        height_m: Where the layer is [m].
        n_views: How many maps stand side by side; each is as much narrower.
    """
    aspect = MAP_VIEW_ASPECT * 2 / (n_views + 1)
    low_m, high_m = np.array(environment.grid.origin_m), np.array(environment.grid.max_m)
    width_m, depth_m = (1 + MAP_SCALE_FRAC) * (high_m[0] - low_m[0]), high_m[1] - low_m[1]
    tallest_m = (1 + 2 * MAP_MARGIN_FRAC) * max(depth_m, width_m / aspect)
    target_m = np.array([high_m[0] - width_m / 2, (low_m[1] + high_m[1]) / 2, height_m])
    # An orbiting eye has no up when it looks straight down; a hair from it is close enough.
    offset_m = np.array([0.0, -0.01, tallest_m / (2 * math.tan(FIELD_OF_VIEW_RAD / 2))])
    return _vec3(target_m + offset_m), _vec3(target_m)


# Walls of somebody's own geometry lie around the grid.
def _extent_m(environment: Environment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    lows_m = [environment.grid.origin_m, *(mesh.vertices_m.min(axis=0) for mesh in environment.meshes)]
    highs_m = [environment.grid.max_m, *(mesh.vertices_m.max(axis=0) for mesh in environment.meshes)]
    return np.min(lows_m, axis=0), np.max(highs_m, axis=0)


def _vec3(values: NDArray[np.float64]) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
