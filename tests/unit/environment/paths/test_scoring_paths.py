"""Shortest ways against closed forms around one box, and the clearance field against brute force."""

from itertools import pairwise
from math import hypot

import numpy as np
import pytest

from gslcosim.environment.grid_kernels import is_line_of_sight_free
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.paths.scoring_paths import (
    clearance_field_m,
    shortest_level_path_m,
    shortest_path,
    shortest_path_m,
)
from gslcosim.scenario.models.scenario import BoxSpec, LayoutSpec, WindSpec

START_M, GOAL_M = (12.0, 5.0, 2.0), (3.0, 5.0, 2.0)


def room(*obstacles, size_m=(15.0, 12.0, 4.0), cell_m=0.2):
    specs = tuple(BoxSpec(name=f"box_{i}", min_m=low, max_m=high) for i, (low, high) in enumerate(obstacles))
    return build_layout(LayoutSpec(size_m=size_m, obstacles=specs), WindSpec(solver="uniform", cell_m=cell_m))


# A wall from floor to ceiling with a passage at y > 9 m.
WALLED = room(((7.0, 0.0, 0.0), (8.0, 9.0, 4.0)))


def around_the_wall_m(clearance_m):
    return 2 * hypot(4.0 - clearance_m, 4.0 + clearance_m) + 1.0 + 2 * clearance_m


def test_in_plain_sight_the_way_is_the_straight_line():
    assert shortest_path_m(room(), (1.0, 1.0, 0.2), (9.0, 7.0, 2.2), clearance_m=0.35) == pytest.approx(
        np.linalg.norm([8.0, 6.0, 2.0])
    )
    assert shortest_path_m(WALLED, (1.0, 1.0, 0.2), (5.0, 11.0, 3.0), clearance_m=0.35) == pytest.approx(
        np.linalg.norm([4.0, 10.0, 2.8])
    )


# A bend is off by up to half a cell, which lengthens the way by less than that.
@pytest.mark.parametrize(("clearance_m", "error_m"), [(0.0, 0.015), (0.2, 0.2), (0.35, 0.2), (0.6, 0.2)])
def test_the_way_around_a_wall_and_its_clearance_is_the_closed_form(clearance_m, error_m):
    length_m = shortest_path_m(WALLED, START_M, GOAL_M, clearance_m=clearance_m)
    assert length_m == pytest.approx(around_the_wall_m(clearance_m), abs=error_m)


def test_the_way_over_a_box_is_the_unfolded_straight_line():
    low_wall = room(((7.0, 0.0, 0.0), (8.0, 12.0, 3.0)))
    unfolded_m = hypot(2 * hypot(4.0, 1.0) + 1.0, 2.0)
    length_m = shortest_path_m(low_wall, START_M, (3.0, 7.0, 2.0), clearance_m=0.0)
    assert unfolded_m - 1e-3 < length_m < unfolded_m * 1.01


def test_no_leg_touches_a_solid_cell_and_no_bend_lacks_clearance():
    rng = np.random.default_rng(6)
    corners = rng.random((14, 3)) * (12.0, 9.0, 0.0) + (1.0, 1.0, 0.0)
    size = np.array([1.0, 1.4, 3.9])
    crowd = room(*((tuple(map(float, c)), tuple(map(float, c + size))) for c in corners))
    bends_m = shortest_path(crowd, (0.5, 0.5, 1.0), (14.5, 11.5, 1.0), clearance_m=0.3)
    assert len(bends_m) > 2
    for a, b in pairwise(bends_m):
        assert is_line_of_sight_free(crowd.occupancy, crowd.grid.origin_m, crowd.grid.cell_m, *a, *b)
    clear_m = clearance_field_m(crowd.occupancy == 1, crowd.grid.cell_m, up_to_m=1.0)
    assert all(clear_m[tuple(crowd.grid.cell_of(bend))] >= 0.2 for bend in bends_m[1:-1])


@pytest.mark.parametrize(
    "obstacles",
    [
        (((7.0, 0.0, 0.0), (8.0, 5.8, 4.0)), ((7.0, 6.4, 0.0), (8.0, 12.0, 4.0))),
        (((7.0, 0.0, 0.0), (8.0, 12.0, 3.4)),),
    ],
    ids=["between obstacles", "below the ceiling"],
)
def test_a_passage_narrower_than_the_vehicle_is_closed(obstacles):
    gap = room(*obstacles)
    assert shortest_path_m(gap, START_M, GOAL_M, clearance_m=0.2) is not None
    assert shortest_path_m(gap, START_M, GOAL_M, clearance_m=0.4) is None


def test_ends_beside_an_obstacle_are_reached_although_they_lack_clearance():
    length_m = shortest_path_m(WALLED, START_M, (6.9, 5.0, 0.1), clearance_m=0.35)
    assert length_m == pytest.approx(hypot(4.0, 4.0) + 1.0 + hypot(4.0, 1.9), rel=0.1)


def test_within_shortens_the_way_by_as_much_where_its_end_is_straight():
    full_m = shortest_path_m(WALLED, START_M, GOAL_M, clearance_m=0.2)
    assert shortest_path_m(WALLED, START_M, GOAL_M, clearance_m=0.2, within_m=1.0) == pytest.approx(
        full_m - 1.0, abs=1e-2
    )
    assert shortest_path_m(room(), START_M, GOAL_M, clearance_m=0.2, within_m=1.5) == pytest.approx(7.5)
    assert shortest_path_m(room(), START_M, GOAL_M, clearance_m=0.2, within_m=20.0) == 0.0


def test_within_counts_through_walls():
    inside_wall = (7.5, 5.0, 2.0)
    assert shortest_path_m(WALLED, START_M, inside_wall, clearance_m=0.2) is None
    assert shortest_path_m(WALLED, START_M, inside_wall, clearance_m=0.2, within_m=1.0) == pytest.approx(3.5, abs=1e-6)


def test_ends_outside_the_room_or_in_a_solid_have_no_way():
    for bad_m in ((-1.0, 5.0, 2.0), (16.0, 5.0, 2.0), (7.5, 5.0, 2.0)):
        assert shortest_path_m(WALLED, bad_m, GOAL_M, clearance_m=0.2) is None
        assert shortest_path_m(WALLED, GOAL_M, bad_m, clearance_m=0.2) is None


def test_clearance_is_the_distance_from_centre_to_the_nearest_solid_cell():
    rng = np.random.default_rng(9)
    is_solid = rng.random((9, 7, 5)) < 0.03
    solids, cells = np.argwhere(is_solid), np.stack(np.meshgrid(*map(np.arange, is_solid.shape), indexing="ij"), -1)
    apart = np.maximum(np.abs(cells[..., None, :] - solids) - 0.5, 0.0) * 0.3
    expected = np.linalg.norm(apart, axis=-1).min(axis=-1)
    expected[expected > 0.8] = np.inf
    assert clearance_field_m(is_solid, 0.3, up_to_m=0.8) == pytest.approx(expected, abs=1e-6)


# ---------------------------------------------------------------- on the ground

# A wall 1 m high and one that hangs above it: between the two there is a way over, on the ground there is none.
LOW = room(((7.0, 0.0, 0.0), (8.0, 9.0, 1.0)), ((7.0, 0.0, 2.0), (8.0, 12.0, 4.0)))
ON_FLOOR_M = (12.0, 5.0, 0.12)


def test_a_way_on_the_ground_goes_around_what_a_flight_goes_over():
    level_m = shortest_level_path_m(LOW, ON_FLOOR_M, GOAL_M, clearance_m=0.0)
    assert level_m == pytest.approx(around_the_wall_m(0.0), rel=1e-3)
    assert shortest_path_m(LOW, ON_FLOOR_M, (3.0, 5.0, 0.12), clearance_m=0.0) < level_m - 1.0


def test_a_way_on_the_ground_passes_under_what_hangs():
    hanging = room(((7.0, 0.0, 1.0), (8.0, 12.0, 4.0)))
    assert shortest_level_path_m(hanging, ON_FLOOR_M, GOAL_M, clearance_m=0.3) == pytest.approx(9.0)


def test_near_enough_is_meant_in_space():
    goal_m = (3.0, 5.0, 2.12)
    assert shortest_level_path_m(room(), ON_FLOOR_M, goal_m, clearance_m=0.3, within_m=2.5) == pytest.approx(7.5)
    assert shortest_level_path_m(room(), ON_FLOOR_M, goal_m, clearance_m=0.3, within_m=1.9) is None
    assert shortest_level_path_m(room(), goal_m, (3.0, 5.5, 0.5), clearance_m=0.3, within_m=1.9) == 0.0


def test_a_start_outside_the_room_has_no_way():
    for height_m in (-0.5, 4.5):
        assert shortest_level_path_m(room(), (12.0, 5.0, height_m), GOAL_M, clearance_m=0.3) is None
