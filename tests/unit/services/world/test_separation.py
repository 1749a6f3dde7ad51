"""Vehicles keep their distance from each other: head-on, crossing, many through one place, past one that stands."""

import itertools
import math

import numpy as np
import pytest

from gslcosim.contract.codec import encode
from gslcosim_services.world.separation import Neighbours, find_passing_velocity, has_conflict, is_hull_open_ahead


def among(*others, own_m_s=(0.0, 0.0, 0.0), least_m=1.0, gives_way=False):
    """A vehicle in the origin among others, each a place and a velocity."""
    return Neighbours(
        own=0,
        positions_m=np.array([(0.0, 0.0, 0.0), *(place_m for place_m, _ in others)]),
        velocities_m_s=np.array([own_m_s, *(velocity_m_s for _, velocity_m_s in others)]),
        least_m=np.full(1 + len(others), least_m),
        yields=np.full(1 + len(others), gives_way),
    )


STILL = (0.0, 0.0, 0.0)


def go(place_m):
    return {"kind": "waypoint", "position_world_m": place_m}


def nearest_m(pilot):
    return min(
        math.dist(a.position_world_m, b.position_world_m)
        for message in pilot.log
        for a, b in itertools.combinations(message.bodies, 2)
    )


def send_and_wait(pilot, places_m, at_most=900):
    """Send every vehicle somewhere once all are asked, and wait until all are asked again."""
    pilot.run_until(lambda _: all(body.awaiting_command for body in pilot.log[-1].bodies))
    pilot.step(**{f"agent_{i}": go(place_m) for i, place_m in enumerate(places_m)})
    pilot.run_until(lambda _: all(body.awaiting_command for body in pilot.log[-1].bodies), at_most=at_most)
    for i, place_m in enumerate(places_m):
        assert math.dist(pilot.body(i).position_world_m, place_m) < 0.15, i
        assert pilot.body(i).rejected_command is None


# Time to contact against the closed form: 5 m apart, 1 m to keep, 1 m/s: after 4 s.
def test_it_looks_as_far_ahead_as_set():
    others = among(((5.0, 0.0, 0.0), STILL))
    assert has_conflict((1.0, 0.0, 0.0), others, 4.01)
    assert not has_conflict((1.0, 0.0, 0.0), others, 3.99)
    assert not has_conflict((-1.0, 0.0, 0.0), others, 100.0)
    # Passing at 1.01 m: sin of the angle is 1.01 / 5.
    miss = (math.cos(math.asin(1.01 / 5)), 1.01 / 5, 0.0)
    assert not has_conflict(miss, others, 100.0)
    assert not has_conflict((1.0, 0.0, 0.0), among(), 100.0)


def test_who_is_too_near_already_only_may_not_come_nearer():
    others = among(((0.5, 0.0, 0.0), STILL))
    assert has_conflict((0.1, 0.0, 0.0), others, 0.01)
    assert not has_conflict((-0.1, 0.1, 0.0), others, 100.0)


def test_both_pass_on_the_right():
    others = among(((3.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), own_m_s=(1.0, 0.0, 0.0), gives_way=True)
    _, v, _ = find_passing_velocity((1.0, 0.0, 0.0), others, lambda _: True)
    assert v < 0


def test_half_of_the_way_is_enough_where_the_other_gives_way():
    turns = []
    for gives_way in (True, False):
        others = among(((4.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), own_m_s=(1.0, 0.0, 0.0), gives_way=gives_way)
        u, v, _ = find_passing_velocity((1.0, 0.0, 0.0), others, lambda _: True)
        turns.append(abs(math.atan2(v, u)))
    assert turns[0] < turns[1]


def test_closed_ways_are_not_taken():
    others = among(((3.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), own_m_s=(1.0, 0.0, 0.0))
    assert find_passing_velocity((1.0, 0.0, 0.0), others, lambda _: False) == (0.0, 0.0, 0.0)
    _, v, _ = find_passing_velocity((1.0, 0.0, 0.0), others, lambda velocity: velocity[1] >= 0)
    assert v > 0


# A room of 8, 10 and 12 m in cells of 2 m, one of them solid from (4, 6, 8) m on; a vehicle with a radius of 0.5 m.
@pytest.mark.parametrize(
    ("position_m", "velocity_m_s", "is_open"),
    [
        ((2.0, 5.0, 9.0), (0.0, 0.0, 0.0), True),
        ((2.0, 7.0, 9.0), (1.49, 0.0, 0.0), True),
        ((2.0, 7.0, 9.0), (1.51, 0.0, 0.0), False),
        ((3.0, 7.0, 9.0), (4.0, 0.0, 0.0), False),
        ((5.0, 5.4, 9.0), (0.0, 0.2, 0.0), False),
        ((5.0, 7.0, 7.4), (0.0, 0.0, 0.2), False),
        ((6.0, 1.0, 1.0), (1.49, 0.0, 0.0), True),
        ((6.0, 1.0, 1.0), (1.51, 0.0, 0.0), False),
        ((6.0, 1.0, 1.0), (0.0, -0.51, 0.0), False),
        ((6.0, 1.0, 11.0), (0.0, 0.0, 0.51), False),
    ],
)
def test_room_ahead_is_that_of_the_middle_and_all_sides(position_m, velocity_m_s, is_open):
    occupancy = np.zeros((4, 5, 6), np.uint8)
    occupancy[2, 3, 4] = 1
    assert is_hull_open_ahead(position_m, velocity_m_s, 0.5, occupancy, (0.0, 0.0, 0.0), 2.0) == is_open


def test_two_meet_head_on_and_pass_without_contact(make_pilot):
    spec = {"separation_m": 1.2}
    pilot = make_pilot({"start_m": (3.0, 5.0, 0.2), **spec}, {"start_m": (12.0, 5.0, 0.2), **spec})
    send_and_wait(pilot, [(12.0, 5.0, 2.0), (3.0, 5.0, 2.0)])
    assert nearest_m(pilot) > 1.15
    assert not pilot.touched()


def test_without_separation_they_collide(make_pilot):
    pilot = make_pilot({"start_m": (3.0, 5.0, 0.2)}, {"start_m": (12.0, 5.0, 0.2)})
    pilot.run(60)
    pilot.step(agent_0=go((12.0, 5.0, 2.0)), agent_1=go((3.0, 5.0, 2.0)))
    pilot.run(130)
    assert pilot.touched()


def test_one_alone_goes_around_one_that_does_not_look(make_pilot):
    pilot = make_pilot({"start_m": (3.0, 5.0, 0.2), "separation_m": 1.2}, {"start_m": (12.0, 5.0, 0.2)})
    send_and_wait(pilot, [(12.0, 5.0, 2.0), (3.0, 5.0, 2.0)])
    assert nearest_m(pilot) > 1.15
    assert not pilot.touched()


@pytest.mark.parametrize("avoidance", ["none", "3d"])
def test_a_standing_vehicle_is_passed(make_pilot, avoidance):
    spec = {"separation_m": 1.2, "avoidance": avoidance}
    pilot = make_pilot({"start_m": (3.0, 5.0, 0.2), **spec}, {"start_m": (8.0, 5.1, 0.2), **spec})
    send_and_wait(pilot, [(12.0, 5.0, 2.0), (8.0, 5.1, 2.0)])
    assert nearest_m(pilot) > 1.0


def test_who_keeps_a_velocity_takes_it_again(asked_pilot):
    pilot = asked_pilot({"start_m": (3.0, 5.0, 2.0), "separation_m": 1.2}, {"start_m": (7.0, 5.0, 2.0)})
    pilot.step(agent_0={"kind": "velocity", "velocity_world_m_s": (0.8, 0.0, 0.0)})
    pilot.run(100)
    assert nearest_m(pilot) > 1.0
    assert pilot.body().velocity_world_m_s == pytest.approx((0.8, 0.0, 0.0), abs=0.05)


def test_a_goal_that_another_one_takes_is_given_up(make_pilot):
    spec = {"separation_m": 1.2}
    pilot = make_pilot({"start_m": (3.0, 5.0, 0.2), **spec}, {"start_m": (8.0, 5.0, 0.2), **spec})
    pilot.run_until(lambda _: all(body.awaiting_command for body in pilot.log[-1].bodies))
    body = pilot.fly(go((8.0, 5.2, 2.0)))
    assert body.rejected_command == "separation: expected a way past other vehicles within 20 s; it holds."
    assert nearest_m(pilot) > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("model", ["iris", "crazyflie", "holonomic"])
def test_six_change_places_across_a_circle(make_pilot, model):
    places_m = [(7.5 + 4.0 * math.cos(i * math.pi / 3), 5.0 + 4.0 * math.sin(i * math.pi / 3), 2.0) for i in range(6)]
    spec = {"model": model, "separation_m": 1.0}
    pilot = make_pilot(*({"start_m": (x, y, 2.0), **spec} for x, y, _ in places_m))
    send_and_wait(pilot, [places_m[(i + 3) % 6] for i in range(6)])
    assert nearest_m(pilot) > 1.0
    assert not pilot.touched()


def test_the_same_encounter_comes_back_to_the_bit(make_pilot):
    logs = []
    for _ in range(2):
        spec = {"separation_m": 1.2, "avoidance": "2d"}
        pilot = make_pilot({"start_m": (3.0, 5.0, 0.2), **spec}, {"start_m": (10.0, 5.0, 0.2), **spec})
        pilot.run(60)
        pilot.step(agent_0=go((12.0, 5.0, 2.0)), agent_1=go((3.0, 5.0, 2.0)))
        pilot.run(60)
        logs.append([encode(message) for message in pilot.log])
    assert logs[0] == logs[1]


def test_a_rover_does_not_look_out(make_scenario):
    with pytest.raises(ValueError, match="only vehicles in the air"):
        make_scenario({"model": "rover", "separation_m": 1.0})


def test_nobody_is_pushed_into_a_wall(make_pilot):
    walls = [("south", (5.0, 0.0, 0.0), (10.0, 4.0, 6.0)), ("north", (5.0, 6.0, 0.0), (10.0, 10.0, 6.0))]
    spec = {"separation_m": 1.5, "avoidance": "2d"}
    pilot = make_pilot({"start_m": (3.0, 5.0, 0.2), **spec}, {"start_m": (12.0, 5.0, 0.2), **spec}, obstacles=walls)
    pilot.run_until(lambda _: all(body.awaiting_command for body in pilot.log[-1].bodies))
    pilot.step(agent_0=go((12.0, 5.0, 2.0)), agent_1=go((3.0, 5.0, 2.0)))
    pilot.run(400)
    assert not pilot.touched()
    assert nearest_m(pilot) > 1.0
