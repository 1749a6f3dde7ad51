import math

import pytest
from briefings import briefing, observation, open_map

from gslcosim_search.motion.legs import LegPlanner, LegSpace, cut_end_m, step_towards_m
from gslcosim_search.random_stream import RandomStream

ROOM = LegSpace(min_m=(1.0, 1.0, 1.0), max_m=(14.0, 9.0, 7.0))


def pilot(**changes):
    return LegPlanner(briefing(**changes), RandomStream(1), margin_m=1.0)


def at(x_m, y_m, z_m=2.0, *, tick=40, notice=None, status="holding"):
    return observation(tick=tick, position_m=(x_m, y_m, z_m), notice=notice, status=status)


@pytest.mark.parametrize("target_m", [(20.0, 5.0), (-3.0, 20.0), (7.0, -9.0), (8.0, 5.5)])
def test_a_cut_leg_ends_inside_on_the_straight_way(target_m):
    start_m = (7.0, 5.0)
    end_m = cut_end_m(start_m, target_m, ROOM)
    assert ROOM.contains([round(x, 9) for x in end_m])
    away = (target_m[0] - start_m[0], target_m[1] - start_m[1])
    flown = (end_m[0] - start_m[0], end_m[1] - start_m[1])
    assert away[0] * flown[1] - away[1] * flown[0] == pytest.approx(0.0, abs=1e-9)
    is_at_side = min(end_m[0] - 1, 14 - end_m[0], end_m[1] - 1, 9 - end_m[1]) < 1e-9
    assert is_at_side or end_m == target_m


def test_from_outside_the_margin_a_leg_leads_inside():
    assert cut_end_m((0.2, 5.0), (0.1, 6.0), ROOM) == (1.0, 6.0)


def test_a_leg_to_a_free_place_ends_there_at_search_height():
    command = pilot().leg(at(7.0, 5.0), (8.25, 4.5))
    assert command.position_world_m == (8.25, 4.5, 2.0)
    assert command.hold_s is None


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


def test_a_leg_into_a_wall_slides_along_it():
    x_m, y_m, _ = pilot().leg(at(14.0, 5.0), (15.0, 5.0)).position_world_m
    assert x_m == 14.0
    assert abs(y_m - 5.0) == pytest.approx(1.0)


@pytest.mark.parametrize("size_m", [(15.0, 10.0, 8.0), (1.0, 1.0, 1.0), (2.1, 15.0, 3.0)])
def test_every_leg_ends_inside_whatever_is_asked_and_refused(size_m):
    flown = pilot(size_m=size_m)
    for i in range(60):
        start_m = (size_m[0] * (i % 7) / 6, size_m[1] * (i % 5) / 4)
        target_m = (30.0 * math.cos(i), 30.0 * math.sin(i))
        end_m = flown.leg(at(*start_m, notice="no" if i % 3 else None), target_m).position_world_m
        assert all(math.isfinite(x) and 0.0 <= x <= size for x, size in zip(end_m[:2], size_m))


def test_a_granted_map_stops_legs_before_obstacles():
    known_map = open_map(walls=((8.0, 4.0, 9.0, 6.0),))
    x_m, y_m, _ = pilot(known_map=known_map).leg(at(7.0, 5.0), (8.2, 5.0)).position_world_m
    assert y_m == 5.0
    assert 7.5 < x_m <= 8.0


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
