"""Rays against closed forms and against every box one by one."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from surroundings import body, scenario_of

from gslcosim.base.frames import world_from_body_rotation
from gslcosim.environment.model import Box
from gslcosim_services.sensing.ray_kernels import distance_to_box, distance_to_cylinder, turn_rays
from gslcosim_services.sensing.ray_scene import RayScene

BOX = np.array([1.0, 2.0, 3.0, 2.0, 4.0, 6.0])
CYLINDER = np.array([5.0, 0.0, 1.0, 0.5, 0.25])
R2 = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("start", "direction", "distance"),
    [
        ((0.0, 3.0, 4.0), (1.0, 0.0, 0.0), 1.0),
        ((3.0, 3.0, 4.0), (1.0, 0.0, 0.0), math.inf),
        ((1.5, 5.0, 5.0), (0.0, -1.0, 0.0), 1.0),
        ((1.5, 3.0, 10.0), (0.0, 0.0, -1.0), 4.0),
        ((0.0, 2.5, 4.0), (R2, R2, 0.0), math.sqrt(2.0)),
        ((0.0, 3.5, 4.0), (R2, R2, 0.0), math.inf),
        ((1.5, 3.0, 4.0), (1.0, 0.0, 0.0), 0.0),
        ((1.0, 3.0, 7.0), (0.0, 0.0, 1.0), math.inf),
    ],
)
def test_a_box_is_where_its_faces_are(start, direction, distance):
    assert distance_to_box(BOX, *start, *direction) == pytest.approx(distance)


@pytest.mark.parametrize(
    ("start", "direction", "distance"),
    [
        ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), 4.5),
        ((0.0, 0.3, 1.0), (1.0, 0.0, 0.0), 4.6),
        ((0.0, 0.6, 1.0), (1.0, 0.0, 0.0), math.inf),
        ((0.0, 0.0, 1.3), (1.0, 0.0, 0.0), math.inf),
        ((5.2, 0.0, 4.0), (0.0, 0.0, -1.0), 2.75),
        ((5.6, 0.0, 4.0), (0.0, 0.0, -1.0), math.inf),
        ((3.0, 0.0, 3.0), (R2, 0.0, -R2), 1.75 * math.sqrt(2.0)),
        ((10.0, 0.0, 1.0), (1.0, 0.0, 0.0), math.inf),
        ((5.0, 0.0, 1.0), (0.0, 1.0, 0.0), 0.0),
    ],
)
def test_a_cylinder_is_where_its_wall_and_lids_are(start, direction, distance):
    assert distance_to_cylinder(CYLINDER, *start, *direction) == pytest.approx(distance)


def test_rays_turn_with_sums_that_are_rounded_once_on_any_processor():
    rng = np.random.default_rng(1)
    for _ in range(50):
        quaternion = rng.normal(size=4)
        rotation = world_from_body_rotation(tuple((quaternion / np.linalg.norm(quaternion)).tolist()))
        rays = rng.normal(size=(5, 3))
        turned = turn_rays(rotation.ravel(), rays)
        assert np.allclose(turned, rays @ rotation.T, rtol=0.0, atol=1e-15 * np.abs(rays).max() * 9)
        for ray, expected in zip(rays.tolist(), turned.tolist(), strict=True):
            for row, component in zip(rotation.tolist(), expected, strict=True):
                total = row[0] * ray[0]
                for a, b in zip(row[1:], ray[1:], strict=True):
                    total = float(Fraction(a) * Fraction(b) + Fraction(total))
                assert component == total


def test_bins_change_no_distance(make_room):
    rng = np.random.default_rng(2)
    obstacles = []
    for i in range(60):
        low, size = rng.uniform((0, 0, 0), (13, 8, 4)), rng.uniform(0.1, 2.0, 3)
        obstacles.append((f"box_{i}", tuple(low.tolist()), tuple((low + size).tolist())))
    room = make_room(obstacles=obstacles)
    scene = RayScene(scenario_of("iris"), room)
    boxes = np.array([(*box.min_m, *box.max_m) for box in room.boxes])
    for start in [*rng.uniform((0.1, 0.1, 0.1), (14.9, 9.9, 5.9), (20, 3)), np.array([-3.0, 4.0, 2.0])]:
        directions = rng.normal(size=(50, 3))
        directions[:6] = np.vstack([np.eye(3), -np.eye(3)])
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        expected = [min(30.0, *(distance_to_box(box, *start, *d) for box in boxes)) for d in directions]
        assert scene.ranges_m(start, directions, (), 30.0) == pytest.approx(np.array(expected))


def test_rays_from_outside_all_boxes_find_the_same(make_room):
    rng = np.random.default_rng(3)
    low = rng.uniform((2, 2, 0), (9, 6, 2), (40, 3)).round(1)
    boxes = np.hstack([low, low + rng.uniform(0.2, 2.0, (40, 3)).round(1)])
    room = make_room()
    solids = tuple(
        Box(name=f"box_{i}", kind="floor", min_m=tuple(box[:3]), max_m=tuple(box[3:]))
        for i, box in enumerate(boxes.tolist())
    )
    scene = RayScene(scenario_of("iris"), replace(room, boxes=solids))
    faces = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    starts = [*rng.uniform((-5, -5, 4.5), (20, 15, 9), (20, 3)), np.array([-3.0, 4.0, 1.0])]
    starts += [np.array([-3.0, 4.0, faces[1][2]]), np.array([-3.0, faces[0][1], 1.0]), faces[1], faces[0]]
    n_hits = 0
    for start in starts:
        towards = rng.uniform((1, 1, 0), (11, 8, 4), (200, 3)) - start
        directions = np.vstack([towards, np.eye(3), -np.eye(3)])
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        expected = [min(30.0, *(distance_to_box(box, *start, *d) for box in boxes)) for d in directions]
        assert np.array_equal(scene.ranges_m(start, directions, (), 30.0), expected)
        n_hits += np.sum(np.array(expected) < 30.0)
    assert 0.1 < n_hits / (206 * len(starts)) < 0.9


def test_other_vehicles_are_met(make_room):
    scene = RayScene(scenario_of("iris", "crazyflie"), make_room())
    other = body("moth", position_world_m=(5.0, 5.0, 2.0))
    ahead = np.array([[1.0, 0.0, 0.0]])
    assert scene.ranges_m(np.array([1.0, 5.0, 2.0]), ahead, [other], 30.0) == pytest.approx([4.0 - 0.07])
    assert scene.ranges_m(np.array([1.0, 5.0, 2.1]), ahead, [other], 30.0) == pytest.approx([14.0])
