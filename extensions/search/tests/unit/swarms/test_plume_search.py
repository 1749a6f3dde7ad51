import math

import numpy as np
import pytest

from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.swarms.formations import (
    PlumeMemory,
    find_lane_point,
    find_next_lane_point,
    nearest_axis_rad,
    plan_crosswind_lanes,
)

ROOM = LegSpace(min_m=(1.0, 1.0, 0.5), max_m=(14.0, 9.0, 7.0))


def points_on(lanes_m, n=2000):
    length = np.hypot(*np.diff(lanes_m, axis=0).T).sum()
    return np.array([find_lane_point(lanes_m, length * i / n * (1.0 - 1e-9)) for i in range(n)])


@pytest.mark.parametrize("upwind_rad", [0.0, 0.6, math.pi / 2.0, 2.5, math.pi, -1.4])
def test_no_place_of_the_room_is_farther_than_half_a_lane_from_the_lanes(upwind_rad):
    path = points_on(plan_crosswind_lanes(ROOM, upwind_rad, 2.0))
    places = np.random.default_rng(1).uniform(ROOM.min_m[:2], ROOM.max_m[:2], (200, 2))
    nearest = np.min(np.hypot(*(places[:, None] - path[None]).transpose(2, 0, 1)), axis=1)
    assert nearest.max() <= 1.0 + 0.05


@pytest.mark.parametrize(("upwind_rad", "axis", "sign"), [(0.3, 0, 1), (math.pi, 0, -1), (1.2, 1, 1), (-1.5, 1, -1)])
def test_lanes_lie_across_the_wind_and_go_up_it(upwind_rad, axis, sign):
    lanes_m = plan_crosswind_lanes(ROOM, upwind_rad, 2.0)
    lanes = lanes_m[::2, axis]
    assert lanes_m[1::2, axis] == pytest.approx(lanes)
    assert np.all(sign * np.diff(lanes) > 0.0)


def test_lanes_turn_before_the_walls_by_their_inset_and_never_beyond_the_middle():
    assert np.unique(plan_crosswind_lanes(ROOM, 0.0, 2.0, inset_m=1.5)[:, 1]) == pytest.approx([2.5, 7.5])
    assert np.unique(plan_crosswind_lanes(ROOM, 0.0, 2.0, inset_m=99.0)[:, 1]) == pytest.approx([5.0])


def test_a_room_narrower_than_a_lane_has_one_in_its_middle():
    assert plan_crosswind_lanes(ROOM, 0.0, 50.0)[:, 0] == pytest.approx([7.5, 7.5])


def test_a_step_leads_along_the_lanes_and_from_its_end_to_its_beginning():
    lanes_m = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]])
    assert find_next_lane_point(lanes_m, (1.0, 0.3), 1.0) == pytest.approx([2.0, 0.0])
    assert find_next_lane_point(lanes_m, (3.5, 0.0), 1.0) == pytest.approx([4.0, 0.5])
    assert find_next_lane_point(lanes_m, (4.0, 0.0), 1.0) == pytest.approx([4.0, 1.0])
    assert find_next_lane_point(lanes_m, (0.3, 2.0), 1.0) == pytest.approx([0.0, 2.0])
    assert find_next_lane_point(lanes_m, (0.0, 2.0), 1.0) == pytest.approx([0.0, 0.0])


def test_distances_beyond_the_end_of_the_lanes_begin_again():
    lanes_m = np.array([[0.0, 0.0], [4.0, 0.0]])
    assert find_lane_point(lanes_m, 5.0) == pytest.approx([1.0, 0.0])
    assert find_lane_point(np.array([[2.0, 2.0], [2.0, 2.0]]), 5.0) == pytest.approx([2.0, 2.0])


def test_lost_gas_is_cast_for_to_both_sides_of_where_it_was_and_then_the_lanes_go_on():
    lanes_m = plan_crosswind_lanes(ROOM, math.pi / 2.0, 2.0)
    memory = PlumeMemory(lanes_m, step_m=1.0, cast_m=1.0, n_casts=2)
    assert memory.next_place_m((7.0, 2.0)) == pytest.approx(find_next_lane_point(lanes_m, (7.0, 2.0), 1.0))
    memory.met_gas((7.0, 4.0), math.pi / 2.0)
    assert memory.next_place_m((7.0, 5.0)) == pytest.approx([6.0, 4.0])
    assert memory.next_place_m((6.0, 4.0)) == pytest.approx([8.0, 4.0])
    assert memory.next_place_m((8.0, 4.0)) == pytest.approx(find_next_lane_point(lanes_m, (8.0, 4.0), 1.0))


def test_the_nearest_axis_of_a_heading():
    assert [nearest_axis_rad(a) for a in (0.2, 1.4, 3.0, -1.7)] == pytest.approx(
        [0.0, math.pi / 2.0, math.pi, -math.pi / 2.0]
    )
