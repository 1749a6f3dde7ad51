import math

import briefings
import numpy as np
import pytest
from briefings import briefing, open_map

from gslcosim.contract.messages import Briefing, KnownMap, Observation
from gslcosim.contract.record import NumericArray
from gslcosim_search.motion.grid_paths import is_free_at
from gslcosim_search.motion.map_navigation import KnownPaths, MapNavigator, StopRecorder, largest_connected_part
from gslcosim_search.occupancy import OccupancyMap
from gslcosim_search.random_stream import RandomStream

START_M = (2.0, 2.0, 2.0)
FROM_M, GOAL_M = (3.0, 2.0, 2.0), (12.0, 2.0, 1.0)
WALL = (7.0, 0.0, 7.5, 6.0)


def plan(*, wall_to_m: float = 6.0) -> KnownMap:
    """A room of 10 x 8 m with a wall across it at x = 5, open above `wall_to_m`."""
    return briefings.open_map((10.0, 8.0), walls=[(5.0, 0.0, 5.25, wall_to_m)])


def room_briefing(known_map: KnownMap | None = None) -> Briefing:
    sensors = (("pid", "nose"), ("anemometer", "vane"))
    return briefings.briefing(sensors=sensors, size_m=(10.0, 8.0, 4.0), known_map=known_map)


def seen(
    tick: int, *, position_m=START_M, ppm: float = 0.0, notice: str | None = None, speed_m_s: float = 0.5
) -> Observation:
    readings = {"nose": ppm, "vane": (speed_m_s, math.pi)}
    return briefings.observation(tick=tick, position_m=position_m, readings=readings, notice=notice)


def flights(known_map: KnownMap | None = None) -> MapNavigator:
    return MapNavigator(
        room_briefing(known_map), RandomStream(1), cell_m=0.25, max_cells=3600, clearance_m=0.4, margin_m=0.5
    )


def test_legs_lead_round_a_wall_without_a_hold_and_hold_at_the_goal():
    on_map, position_m, holds_s = flights(plan()), START_M, []
    on_map.go_to((8.0, 2.0))
    for tick in range(12):
        now = seen(tick, position_m=position_m)
        if tick > 0 and not on_map.is_under_way(now):
            break
        command = on_map.leg(now)
        assert command is not None
        for share in np.linspace(0.0, 1.0, 200):
            point_m = (1.0 - share) * np.array(position_m[:2]) + share * np.array(command.position_world_m[:2])
            assert is_free_at(on_map.free, on_map.grid, point_m)
        position_m = command.position_world_m
        holds_s.append(command.hold_s)
    assert math.dist(position_m[:2], (8.0, 2.0)) < 0.2
    assert len(holds_s) > 1
    assert holds_s == [0.0] * (len(holds_s) - 1) + [None]


def test_a_long_way_is_flown_in_legs_no_longer_than_asked():
    on_map = flights()
    on_map.go_to((8.0, 2.0))
    command = on_map.leg(seen(0), at_most_m=1.5, hold_s=0.7)
    assert math.dist(command.position_world_m[:2], START_M[:2]) == pytest.approx(1.5, abs=0.01)
    assert command.hold_s == 0.0
    last = on_map.leg(seen(1, position_m=(7.0, 2.0, 2.0)), at_most_m=1.5, hold_s=0.7)
    assert last.hold_s == 0.7


def test_without_a_goal_or_a_way_there_is_no_leg():
    assert flights().leg(seen(0)) is None
    closed = flights(plan(wall_to_m=8.0))
    closed.go_to((2.0, 6.0))
    assert closed.leg(seen(0)) is not None


def test_a_goal_that_cannot_be_reached_becomes_the_nearest_place_that_can():
    """Behind a closed wall, in the smaller part of the room, nothing can be flown to."""
    on_map = flights(plan(wall_to_m=8.0))
    on_map.go_to((8.0, 2.0))
    on_map.leg(seen(0))
    assert is_free_at(on_map.flyable, on_map.grid, on_map.goal_m)


def test_a_refused_or_missed_goal_is_reported():
    on_map = flights()
    on_map.go_to((8.0, 2.0))
    on_map.leg(seen(0))
    assert on_map.is_under_way(seen(1))
    assert not on_map.is_under_way(seen(1, notice="expected a free place"))
    assert on_map.was_missed(seen(1))
    assert not on_map.was_missed(seen(1, position_m=(8.0, 2.0, 2.0)))
    assert not on_map.is_under_way(seen(1, position_m=(8.0, 2.0, 2.0)))


def test_who_stays_has_no_goal_and_holds_at_search_height():
    on_map = flights()
    on_map.go_to((8.0, 2.0))
    command = on_map.stay(seen(0, position_m=(3.0, 4.0, 0.2)))
    assert command.position_world_m == (3.0, 4.0, 2.0)
    assert on_map.goal_m is None


def test_a_room_too_narrow_for_the_clearance_is_flown_with_less():
    occupied = np.ones((40, 32), np.uint8)
    occupied[4:36, 10:12] = 0
    corridor = KnownMap(origin_m=(0.0, 0.0, 2.0), cell_m=0.25, occupied=NumericArray.from_array(occupied), height_m=2.0)
    assert flights(corridor).flyable.any()


def test_of_parts_that_do_not_hang_together_the_largest_is_taken():
    free = np.ones((10, 6), bool)
    free[3] = False
    part = largest_connected_part(free)
    assert part[4:].all()
    assert not part[:4].any()
    assert largest_connected_part(np.zeros((3, 3), bool)).all()


def test_a_stop_shows_each_finding_and_the_wind():
    watch = StopRecorder(room_briefing(), threshold_ppm=0.1, every_s=0.5)
    for tick in range(20):
        watch.add(seen(tick, ppm=1.0 if 6 <= tick < 9 else 0.0))
    stop = watch.stop(seen(20))
    assert [finding.is_hit for finding in stop.findings] == [False, True, False, False]
    assert stop.is_hit
    assert stop.wind_world_m_s() == pytest.approx((0.5, 0.0))
    assert math.cos(stop.downwind_rad(0.1)) == pytest.approx(1.0)
    assert stop.downwind_rad(0.6) is None
    assert watch.stop(seen(21)).is_hit is None  # nothing new was found


def test_without_a_map_the_way_is_straight():
    assert KnownPaths(briefing(), clearance_m=0.5).to_m(FROM_M, GOAL_M, margin_m=0.0) == (GOAL_M,)


def test_a_way_ends_inside_the_margin_or_at_the_height_of_its_start():
    paths = KnownPaths(briefing(), clearance_m=0.5)
    assert paths.to_m(FROM_M, (12.0, 0.1, 0.2), margin_m=0.4) == ((12.0, 0.4, 0.4),)
    assert paths.to_m(FROM_M, GOAL_M, margin_m=None) == ((12.0, 2.0, 2.0),)


def test_with_a_plan_the_way_goes_around_at_one_height_and_comes_down_at_its_end():
    known = open_map(walls=[WALL])
    path_m = KnownPaths(briefing(known_map=known), clearance_m=0.3).to_m(FROM_M, GOAL_M, margin_m=0.0)
    assert path_m[-1] == GOAL_M
    assert {z_m for _, _, z_m in path_m[:-1]} == {2.0}
    assert max(y_m for _, y_m, _ in path_m) > 6.25
    solid, here_m = OccupancyMap.of(known), FROM_M
    for bend_m in path_m:
        assert solid.is_free_line(here_m[:2], bend_m[:2])
        here_m = bend_m


def test_with_a_map_in_space_the_way_may_go_over_things():
    occupied = np.zeros((30, 20, 16), np.uint8)
    occupied[14, :, :6] = 1  # a wall from side to side, 3 m high
    known = KnownMap(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, occupied=NumericArray.from_array(occupied))
    path_m = KnownPaths(briefing(known_map=known), clearance_m=0.4).to_m(FROM_M, GOAL_M, margin_m=0.0)
    assert path_m[-1] == GOAL_M
    assert max(z_m for _, _, z_m in path_m) > 3.0


def test_where_no_way_leads_it_is_straight():
    closed = open_map(walls=[(7.0, 0.0, 7.5, 10.0)])
    paths = KnownPaths(briefing(known_map=closed), clearance_m=0.3)
    assert paths.to_m(FROM_M, GOAL_M, margin_m=0.0) == (GOAL_M,)
    assert paths.to_m(FROM_M, GOAL_M, margin_m=None) == ((12.0, 2.0, 2.0),)
