import numpy as np
import pytest
from briefings import briefing, open_map

from gslcosim.contract.messages import KnownMap
from gslcosim.contract.record import NumericArray
from gslcosim_search.motion.map_navigation import KnownPaths
from gslcosim_search.occupancy import OccupancyMap

START_M, GOAL_M = (3.0, 2.0, 2.0), (12.0, 2.0, 1.0)
WALL = (7.0, 0.0, 7.5, 6.0)


def test_without_a_map_the_way_is_straight():
    assert KnownPaths(briefing(), clearance_m=0.5).to_m(START_M, GOAL_M, margin_m=0.0) == (GOAL_M,)


def test_a_way_ends_inside_the_margin_or_at_the_height_of_its_start():
    paths = KnownPaths(briefing(), clearance_m=0.5)
    assert paths.to_m(START_M, (12.0, 0.1, 0.2), margin_m=0.4) == ((12.0, 0.4, 0.4),)
    assert paths.to_m(START_M, GOAL_M, margin_m=None) == ((12.0, 2.0, 2.0),)


def test_with_a_plan_the_way_goes_around_at_one_height_and_comes_down_at_its_end():
    known = open_map(walls=[WALL])
    path_m = KnownPaths(briefing(known_map=known), clearance_m=0.3).to_m(START_M, GOAL_M, margin_m=0.0)
    assert path_m[-1] == GOAL_M
    assert {z_m for _, _, z_m in path_m[:-1]} == {2.0}
    assert max(y_m for _, y_m, _ in path_m) > 6.25
    solid, here_m = OccupancyMap.of(known), START_M
    for bend_m in path_m:
        assert solid.is_free_line(here_m[:2], bend_m[:2])
        here_m = bend_m


def test_with_a_map_in_space_the_way_may_go_over_things():
    occupied = np.zeros((30, 20, 16), np.uint8)
    occupied[14, :, :6] = 1  # a wall from side to side, 3 m high
    known = KnownMap(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, occupied=NumericArray.from_array(occupied))
    path_m = KnownPaths(briefing(known_map=known), clearance_m=0.4).to_m(START_M, GOAL_M, margin_m=0.0)
    assert path_m[-1] == GOAL_M
    assert max(z_m for _, _, z_m in path_m) > 3.0


def test_where_no_way_leads_it_is_straight():
    closed = open_map(walls=[(7.0, 0.0, 7.5, 10.0)])
    paths = KnownPaths(briefing(known_map=closed), clearance_m=0.3)
    assert paths.to_m(START_M, GOAL_M, margin_m=0.0) == (GOAL_M,)
    assert paths.to_m(START_M, GOAL_M, margin_m=None) == ((12.0, 2.0, 2.0),)


@pytest.mark.parametrize("margin_m", [0.0, None])
def test_a_free_way_on_a_map_is_straight_too(margin_m):
    path_m = KnownPaths(briefing(known_map=open_map()), clearance_m=0.3).to_m(
        START_M, (12.0, 2.0, 2.0), margin_m=margin_m
    )
    assert path_m == ((12.0, 2.0, 2.0),)
