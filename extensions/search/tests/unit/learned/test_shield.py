import math

import numpy as np
import pytest

from gslcosim_search.learned.encoding import closeness, find_shield_problem
from gslcosim_search.learned.shield import shield_velocity

N_RAYS, KEEP_M, REACH_M = 8, 0.4, 0.9
DIRECTIONS = [(math.cos(i * math.pi / 4), math.sin(i * math.pi / 4)) for i in range(N_RAYS)]


def shielded(velocity, ranges_m, yaw_rad=0.0):
    given = list(velocity)
    numbers = np.array([closeness(range_m) for range_m in ranges_m], np.float32)
    sin, cos = math.sin(yaw_rad), math.cos(yaw_rad)
    shield_velocity(given, numbers, range(N_RAYS), DIRECTIONS, sin, cos, KEEP_M, REACH_M)
    return given


def wall(x_m):
    """Ranges in front of a wall along y, x_m ahead."""
    return [x_m / math.cos(rad) if (math.cos(rad := i * math.pi / 4)) > 0.1 else 4.0 for i in range(N_RAYS)]


def test_towards_a_wall_it_is_slowed_and_along_it_kept():
    x, y = shielded((1.0, 0.3), wall(0.85))
    assert x == pytest.approx(0.45 / REACH_M, abs=0.01)
    assert y == pytest.approx(0.3, abs=0.1)
    assert shielded((1.0, 0.0), wall(0.3))[0] == pytest.approx(0.0, abs=1e-9)


def test_rays_turn_with_the_vehicle():
    """With its nose to the left, the wall ahead is on the left of the room."""
    x, y = shielded((1.0, 1.0), wall(0.4), yaw_rad=math.pi / 2)
    assert y < 1e-6
    assert x > 0.5


def test_no_ray_is_ever_approached_faster_than_it_allows():
    rng = np.random.default_rng(1)
    for _ in range(300):
        ranges_m = rng.uniform(0.1, 2.0, N_RAYS)
        x, y = shielded(rng.uniform(-1, 1, 2), ranges_m)
        for (dx, dy), range_m in zip(DIRECTIONS, ranges_m, strict=True):
            assert x * dx + y * dy <= max(0.0, range_m - KEEP_M) / REACH_M + 1e-6


@pytest.mark.parametrize(
    ("kind", "shield_m", "words"),
    [
        ("velocity", 0.4, None),
        ("heading", None, None),
        ("heading", 0.4, "expected none for heading, was 0.4. Take velocity or velocity_3d"),
        ("velocity", -1.0, "expected a distance from 0, was -1.0"),
        ("velocity", True, "expected a distance from 0, was True"),
    ],
)
def test_shields_fit_kinds_of_actions(kind, shield_m, words):
    found = find_shield_problem(kind, shield_m)
    assert found is None if words is None else found is not None and found.startswith(words)
