import math

import numpy as np
import pytest
from briefings import briefing, observation, open_map

from gslcosim.contract.messages import Bounds, KnownMap
from gslcosim.contract.record import NumericArray
from gslcosim_search.motion.legs import (
    LegPlanner,
    LegSpace,
    StuckDetector,
    cut_end_m,
    find_free_heading,
    leg_end,
    next_leg,
    random_headings,
    shorten_leg,
    step_towards_m,
    to_millimetre,
)
from gslcosim_search.occupancy import OccupancyMap
from gslcosim_search.random_stream import RandomStream

BOUNDS = Bounds(min_m=(0.0, 0.0, 0.0), max_m=(15.0, 10.0, 8.0))
ROOM = LegSpace.within(BOUNDS, 0.3)
INNER_ROOM = LegSpace(min_m=(1.0, 1.0, 1.0), max_m=(14.0, 9.0, 7.0))


def walled(*, clearance_m=0.0) -> LegSpace:
    """A room of 4 x 3 m with a wall from x 2.0 to 2.25, from y 0 to 2."""
    occupied = np.zeros((16, 12), np.uint8)
    occupied[8, :8] = 1
    known = KnownMap(origin_m=(0.0, 0.0, 1.0), cell_m=0.25, occupied=NumericArray.from_array(occupied), height_m=1.0)
    bounds = Bounds(min_m=(0.0, 0.0, 0.0), max_m=(4.0, 3.0, 2.0))
    return LegSpace.within(bounds, 0.1, obstacles=OccupancyMap.of(known, clearance_m=clearance_m))


def test_a_leg_ends_where_the_heading_leads_in_whole_millimetres():
    assert leg_end((7.0, 5.0, 2.0), math.pi / 6, 1.0, ROOM) == (7.866, 5.5)
    assert leg_end((7.0, 5.0, 2.0), math.pi / 2, 1.0, ROOM, climb_m=-0.25) == (7.0, 6.0, 1.75)


def test_rounding_goes_half_up_for_either_sign():
    assert [to_millimetre(value) for value in (1.2344, 1.2346, 0.0005, -0.0004, -1.2346)] == [
        1.234, 1.235, 0.001, 0.0, -1.235,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("start_m", "heading_rad"),
    [((14.0, 5.0), 0.0), ((1.0, 5.0), math.pi), ((7.0, 9.0), math.pi / 2), ((7.0, 1.0), -math.pi / 2)],
)
def test_a_leg_that_ends_in_the_margin_is_none(start_m, heading_rad):
    assert leg_end(start_m, heading_rad, 0.69, ROOM) is not None
    assert leg_end(start_m, heading_rad, 0.71, ROOM) is None


def test_a_room_with_less_than_two_margins_is_its_middle():
    assert LegSpace.within(BOUNDS, 6.0).nearest((0.0, 0.0, 0.0)) == (6.0, 5.0, 4.0)


def test_a_leg_is_shortened_until_it_fits_or_given_up():
    assert shorten_leg((14.0, 5.0), 0.0, 1.0, ROOM) == (14.7, 5.0)
    assert shorten_leg((14.0, 5.0), 0.0, 1.0, ROOM, n_tries=5) is None
    assert shorten_leg((14.7, 5.0), 0.0, 0.2, ROOM) is None


def test_lines_agree_with_a_dense_sampling():
    """Whatever is seen at 4000 points of a line is met by it, in three dimensions and from outside too."""
    rng = np.random.default_rng(1)
    obstacles = OccupancyMap(origin_m=(0.3, -0.2, 0.1), cell_m=0.3, solid=rng.random((7, 5, 6)) < 0.08)
    said = set()
    for _ in range(200):
        start_m, end_m = rng.uniform(-0.5, 2.5, (2, 3))
        if obstacles.is_solid(start_m):
            continue
        points_m = start_m + np.linspace(0, 1, 4000)[:, None] * (end_m - start_m)
        index = np.floor((points_m - obstacles.origin_m) / obstacles.cell_m).astype(int)
        inside = ((index >= 0) & (index < obstacles.solid.shape)).all(axis=1)
        sampled = obstacles.solid[tuple(index[inside].T)].any()
        is_free = obstacles.is_free_line(start_m, end_m)
        said.add(is_free)
        assert is_free == (not sampled)
    assert said == {True, False}


def test_a_clearance_grows_what_is_solid_by_so_much_and_no_more():
    grown = walled(clearance_m=0.5).obstacles
    assert grown.is_solid((1.6, 1.0))
    assert not grown.is_solid((1.4, 1.0))
    assert grown.is_solid((2.1, 2.4))
    assert not grown.is_solid((2.1, 2.6))
    assert not grown.is_solid((1.6, 2.4))  # a corner is rounded


@pytest.mark.parametrize(
    ("heading_rad", "end_m"),
    [(0.0, (14.7, 5.0)), (math.pi, (0.3, 5.0)), (math.pi / 2, (7.0, 9.7)), (-math.pi / 4, (11.7, 0.3))],
)
def test_a_leg_goes_as_far_as_the_margin(heading_rad, end_m):
    assert ROOM.farthest((7.0, 5.0, 2.0), heading_rad, 99.0) == pytest.approx(end_m)
    assert math.dist(ROOM.farthest((7.0, 5.0, 2.0), heading_rad, 1.5), (7.0, 5.0)) == pytest.approx(1.5, abs=1e-3)


def test_a_leg_goes_as_far_as_the_first_thing_in_its_way_and_from_outside_inside():
    x_m, y_m = walled().farthest((0.5, 1.0), 0.0, 3.0)
    assert 1.8 <= x_m <= 1.9
    assert y_m == 1.0
    assert walled().farthest((1.95, 1.0), 0.0, 3.0) == (1.95, 1.0)
    assert ROOM.farthest((0.1, 5.0), 0.0, 3.0) == (0.3, 5.0)


def test_the_room_of_a_briefing_has_its_map():
    assert LegSpace.of(briefing(), 0.3).obstacles is None
    known = open_map(walls=[(5.0, 0.0, 5.5, 10.0)])
    room = LegSpace.of(briefing(known_map=known), 0.3)
    assert leg_end((4.5, 5.0, 2.0), 0.0, 1.0, room) is None
    assert leg_end((4.5, 5.0, 2.0), 0.0, 1.0, room, climb_m=0.1) is None


def test_the_first_free_heading_is_taken():
    at_east_wall = (14.5, 5.0, 2.0)
    assert find_free_heading(at_east_wall, [0.0, 0.1, math.pi], 1.0, ROOM) == math.pi
    assert find_free_heading(at_east_wall, [0.0], 1.0, ROOM) is None
    assert find_free_heading((1.5, 1.0), [0.0, math.pi / 2], 1.0, walled()) == math.pi / 2


def test_a_refused_end_is_not_tried_again():
    start_m = (7.0, 5.0, 2.0)
    assert find_free_heading(start_m, [0.0, 1.0], 1.0, ROOM, refused_m=(8.0, 5.0, 2.0)) == 1.0
    leg = next_leg(start_m, [0.0], 1.0, ROOM, RandomStream(1), refused_m=(8.0, 5.0, 2.0))
    assert math.dist(leg.end_m, (8.0, 5.0)) > 0.02


@pytest.mark.parametrize("seed", range(20))
def test_a_leg_is_found_in_any_corner(seed):
    for start_m in ((0.3, 0.3, 2.0), (14.7, 9.7, 2.0), (0.0, 10.0, 2.0)):
        leg = next_leg(start_m, [], 1.0, ROOM, RandomStream(seed))
        assert ROOM.contains(leg.end_m)
        assert leg.heading_rad is not None


def test_where_no_leg_fits_the_way_leads_inside():
    small = LegSpace.within(Bounds(min_m=(0.0, 0.0, 0.0), max_m=(1.0, 1.0, 1.0)), 0.3)
    leg = next_leg((0.1, 0.5, 0.5), [0.0], 2.0, small, RandomStream(1))
    assert leg.end_m == (0.3, 0.5)
    assert leg.heading_rad is None


def test_numbers_are_drawn_only_for_headings_that_are_tried():
    one, other = RandomStream(5), RandomStream(5)
    next_leg((7.0, 5.0), [0.0], 1.0, ROOM, one)
    assert one.fraction() == other.fraction()
    next_leg((7.0, 5.0), [], 1.0, ROOM, one)
    other.angle_rad()
    assert one.fraction() == other.fraction()
    assert len(list(random_headings(one, 3))) == 3


def pilot(**changes):
    return LegPlanner(briefing(**changes), RandomStream(1), margin_m=1.0)


def at(x_m, y_m, z_m=2.0, *, tick=40, notice=None, status="holding"):
    return observation(tick=tick, position_m=(x_m, y_m, z_m), notice=notice, status=status)


@pytest.mark.parametrize("target_m", [(20.0, 5.0), (-3.0, 20.0), (7.0, -9.0), (8.0, 5.5)])
def test_a_cut_leg_ends_inside_on_the_straight_way(target_m):
    start_m = (7.0, 5.0)
    end_m = cut_end_m(start_m, target_m, INNER_ROOM)
    assert INNER_ROOM.contains([round(x, 9) for x in end_m])
    away = (target_m[0] - start_m[0], target_m[1] - start_m[1])
    flown = (end_m[0] - start_m[0], end_m[1] - start_m[1])
    assert away[0] * flown[1] - away[1] * flown[0] == pytest.approx(0.0, abs=1e-9)
    is_at_side = min(end_m[0] - 1, 14 - end_m[0], end_m[1] - 1, 9 - end_m[1]) < 1e-9
    assert is_at_side or end_m == target_m


@pytest.mark.parametrize(("z_m", "expected_m"), [(3.3, 3.3), (-5.0, 1.0), (50.0, 7.0)])
def test_a_height_is_kept_within_the_margin(z_m, expected_m):
    command = pilot().leg(at(7.0, 5.0), (8.0, 5.0), z_m=z_m, hold_s=0.5)
    assert command.position_world_m == (8.0, 5.0, expected_m)
    assert command.hold_s == 0.5


def test_a_refused_leg_is_led_around():
    flown = pilot()
    first = flown.leg(at(7.0, 5.0), (8.0, 5.0))
    second = flown.leg(at(7.0, 5.0, notice="in an obstacle"), (8.0, 5.0))
    assert first.position_world_m == (8.0, 5.0, 2.0)
    x_m, y_m, _ = second.position_world_m
    assert math.degrees(math.atan2(y_m - 5.0, x_m - 7.0)) == pytest.approx(45.0, abs=0.1)
    assert flown.leg(at(7.0, 5.0), (8.0, 5.0)) == first


@pytest.mark.parametrize("size_m", [(15.0, 10.0, 8.0), (1.0, 1.0, 1.0), (2.1, 15.0, 3.0)])
def test_every_leg_ends_inside_whatever_is_asked_and_refused(size_m):
    flown = pilot(size_m=size_m)
    for i in range(60):
        start_m = (size_m[0] * (i % 7) / 6, size_m[1] * (i % 5) / 4)
        target_m = (30.0 * math.cos(i), 30.0 * math.sin(i))
        end_m = flown.leg(at(*start_m, notice="no" if i % 3 else None), target_m).position_world_m
        assert all(math.isfinite(x) and 0.0 <= x <= size for x, size in zip(end_m[:2], size_m))


def test_a_leg_that_leads_nowhere_is_not_worth_it():
    flown = pilot()
    assert flown.is_worth_it(at(7.0, 5.0), (7.2, 5.0))
    assert not flown.is_worth_it(at(14.0, 5.0), (15.0, 5.0))
    assert flown.is_worth_it(at(7.0, 5.0), (7.0, 5.0, 3.0))
    assert not flown.is_worth_it(at(7.0, 5.0, 7.0), (7.0, 5.0, 8.0))


def test_who_is_asked_when_the_vehicle_holds_is_never_busy():
    flown = pilot()
    flown.leg(at(7.0, 5.0), (8.0, 5.0))
    assert not flown.is_busy(at(7.0, 5.0, tick=41, status="flying"))


def test_who_is_asked_always_waits_for_the_end_of_the_leg_and_its_hold():
    flown = pilot(mode="lockstep")
    assert not flown.is_busy(at(7.0, 5.0, tick=40))
    flown.leg(at(7.0, 5.0, tick=40), (8.0, 5.0), hold_s=0.3)
    statuses = ["holding", "flying", "flying", "holding", "holding", "holding", "holding"]
    busy = [flown.is_busy(at(7.5, 5.0, tick=41 + i, status=status)) for i, status in enumerate(statuses)]
    assert busy == [True, True, True, True, True, True, False]
    assert flown.stay(at(7.5, 5.0)).kind == "noop"


def test_a_refusal_ends_a_leg_at_once():
    flown = pilot(mode="lockstep")
    flown.leg(at(7.0, 5.0, tick=40), (8.0, 5.0))
    assert not flown.is_busy(at(7.0, 5.0, tick=41, notice="in an obstacle"))


def test_a_step_leads_straight_and_not_beyond_the_target():
    assert step_towards_m((0.0, 0.0), (3.0, 4.0), 2.5) == pytest.approx((1.5, 2.0))
    assert step_towards_m((0.0, 0.0), (0.3, 0.4), 2.5) == (0.3, 0.4)


def circle(radius_m, n=20):
    return [
        (5 + radius_m * math.cos(math.tau * i / n), 5 + radius_m * math.sin(math.tau * i / n), 2.0) for i in range(n)
    ]


@pytest.mark.parametrize(("radius_m", "is_wound_up"), [(0.0, True), (1.9, True), (2.1, False)])
def test_legs_round_a_small_circle_count_as_stuck(radius_m, is_wound_up):
    detector = StuckDetector(n_legs=20, radius_m=2.0)
    for place in circle(radius_m):
        assert not detector.is_stuck
        detector.note(place)
    assert detector.is_stuck is is_wound_up


def test_a_reset_detector_needs_as_many_legs_again():
    detector = StuckDetector(n_legs=3, radius_m=1.0)
    for _ in range(3):
        detector.note((3.0, 3.0))
    detector.release()
    detector.note((3.0, 3.0))
    assert not detector.is_stuck
