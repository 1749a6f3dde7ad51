"""Ways around obstacles: planned at a waypoint, passed without contact; places moved, refused, and published."""

import math

import numpy as np
import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.contract.codec import encode
from gslcosim_services.world.flight_space import build_route_planner
from gslcosim_services.world.leg_planners import Leg, plan_leg
from gslcosim_services.world.obstacle_avoidance import ObstacleAvoidance
from gslcosim_services.world.trajectory import Limits

# From the south wall, with a passage at y > 7.5 m and one above 3.5 m.
WALL = ("wall", (7.0, 0.0, 0.0), (7.5, 7.5, 3.5))
CRATE = ("crate", (5.0, 5.0, 0.0), (6.0, 6.5, 1.0))
LIMITS = Limits(max_speed_m_s=1.0, max_acceleration_m_s2=2.0)


def go(place_m):
    return {"kind": "waypoint", "position_world_m": place_m}


@pytest.mark.parametrize("model", ["iris", "crazyflie", "holonomic"])
@pytest.mark.parametrize("mode", ["2d", "3d"])
def test_flies_around_a_wall_that_stands_in_its_way(asked_pilot, model, mode):
    pilot = asked_pilot({"model": model, "avoidance": mode}, obstacles=[WALL])
    body = pilot.fly(go((12.0, 3.0, 2.0)))
    assert math.dist(body.position_world_m, (12.0, 3.0, 2.0)) < 0.15
    assert body.rejected_command is None
    assert not pilot.touched()
    heights_m = [message.bodies[0].position_world_m[2] for message in pilot.log[60:]]
    assert (max(heights_m) > 3.5) == (mode == "3d")


@pytest.mark.parametrize("vehicle", [{"model": "rover"}, {"start_m": (6.55, 3.0, 0.2)}], ids=["rover", "too near"])
def test_it_goes_around_on_wheels_and_from_a_place_that_is_too_near(asked_pilot, vehicle):
    pilot = asked_pilot({"avoidance": "2d", **vehicle}, obstacles=[WALL])
    body = pilot.fly(go((12.0, 3.0, 2.0)))
    assert math.dist(body.position_world_m[:2], (12.0, 3.0)) < 0.15
    assert not pilot.touched()


def test_without_avoidance_it_goes_straight(asked_pilot):
    pilot = asked_pilot({}, obstacles=[WALL])
    pilot.fly(go((12.0, 3.0, 2.0)))
    assert pilot.touched() == {"wall"}
    assert all(message.bodies[0].planned_path_world_m == () for message in pilot.log)


def test_in_plain_sight_the_way_is_that_without_avoidance(asked_pilot):
    logs = []
    for mode in ("none", "2d", "3d"):
        pilot = asked_pilot({"avoidance": mode}, obstacles=[CRATE])
        pilot.fly(go((9.0, 3.0, 2.0)))
        logs.append([message.bodies[0].position_world_m for message in pilot.log])
    assert logs[0] == logs[1] == logs[2]


def test_bends_are_passed_without_a_stop(asked_pilot):
    pilot = asked_pilot({"avoidance": "2d"}, obstacles=[WALL])
    pilot.fly(go((12.0, 3.0, 2.0)))
    speeds_m_s = [
        math.hypot(*m.bodies[0].velocity_world_m_s)
        for m in pilot.log
        if m.bodies[0].phase == "flying" and 4.0 < m.bodies[0].position_world_m[0] < 11.0
    ]
    assert min(speeds_m_s) > 0.2


def test_the_planned_path_leads_to_the_waypoint(asked_pilot):
    pilot = asked_pilot({"avoidance": "2d"}, obstacles=[WALL])
    body = pilot.step(agent_0=go((12.0, 3.0, 2.0)))
    assert body.waypoint_world_m == body.planned_path_world_m[-1] == (12.0, 3.0, 2.0)
    n_bends = len(body.planned_path_world_m) - 1
    assert 1 <= n_bends <= 4
    pilot.run_until_asked()
    lengths = [len(message.bodies[0].planned_path_world_m) for message in pilot.log]
    assert set(lengths) == set(range(n_bends + 2))
    assert pilot.body().planned_path_world_m == ()


@pytest.mark.parametrize("mode", ["2d", "3d"])
def test_a_waypoint_in_an_obstacle_is_moved_just_outside_with_a_notice(asked_pilot, mode):
    pilot = asked_pilot({"avoidance": mode}, obstacles=[WALL])
    body = pilot.fly(go((7.1, 3.0, 2.0)))
    assert "expected a place at least 0.43 m from obstacles, was (7.1, 3, 2) m; goes to (" in body.rejected_command
    x_m, y_m, z_m = body.position_world_m
    assert (y_m, z_m) == pytest.approx((3.0, 2.0), abs=0.2)
    # At least the clearance from the wall's face, and at most a cell more; within 2 cm of the reference.
    assert 0.43 - 0.02 <= 7.0 - x_m <= 0.43 + 0.25 + 0.02
    assert not pilot.touched()


def test_a_place_that_cannot_be_reached_is_refused_and_the_vehicle_holds(asked_pilot):
    high = ("high_wall", (7.0, 0.0, 0.0), (7.5, 10.0, 6.0))
    pilot = asked_pilot({"avoidance": "3d"}, obstacles=[high])
    before_m = pilot.body().position_world_m
    body = pilot.step(agent_0=go((12.0, 3.0, 2.0)))
    assert body.rejected_command == (
        "waypoint: expected a place that can be reached, was (12, 3, 2) m without a way to it; the vehicle holds."
    )
    assert body.phase == "holding"
    assert math.dist(pilot.run(30).position_world_m, before_m) < 0.05


def test_the_way_to_another_height_is_clear_of_what_stands_between(asked_pilot):
    table = ("table", (6.0, 0.0, 0.0), (7.0, 10.0, 1.2))
    pilot = asked_pilot({"avoidance": "2d"}, obstacles=[table])
    body = pilot.fly(go((11.0, 3.0, 0.6)))
    assert math.dist(body.position_world_m, (11.0, 3.0, 0.6)) < 0.15
    body = pilot.fly(go((6.5, 5.0, 2.5)))
    assert math.dist(body.position_world_m, (6.5, 5.0, 2.5)) < 0.15
    assert not pilot.touched()


def test_a_new_waypoint_in_flight_keeps_clear_from_the_motion_it_has(make_pilot):
    pilot = make_pilot({"avoidance": "3d"}, obstacles=[WALL, CRATE], mode="lockstep")
    pilot.run(60)
    for place_m in [(6.0, 3.0, 2.0), (12.0, 3.0, 2.0), (3.0, 3.0, 1.0), (5.5, 8.0, 0.7), (9.0, 1.0, 2.0)]:
        for _ in range(45):
            pilot.step(agent_0=go(place_m))
    assert not pilot.touched()
    assert all(message.bodies[0].rejected_command is None for message in pilot.log)


def test_what_is_said_again_keeps_its_notice(make_pilot):
    pilot = make_pilot({"avoidance": "3d"}, obstacles=[WALL], mode="lockstep")
    pilot.run(60)
    notices = {pilot.step(agent_0=go((7.1, 3.0, 2.0))).rejected_command for _ in range(40)}
    assert len(notices) == 1
    assert None not in notices


def test_missions_go_around_and_hold_as_they_say(asked_pilot):
    pilot = asked_pilot({"avoidance": "3d"}, obstacles=[WALL])
    points = ({"position_world_m": (12.0, 3.0, 2.0), "hold_s": 1.0}, {"position_world_m": (3.0, 3.0, 2.0)})
    body = pilot.fly({"kind": "mission", "waypoints": points})
    assert math.dist(body.position_world_m, (3.0, 3.0, 2.0)) < 0.15
    there = [m.tick for m in pilot.log if math.dist(m.bodies[0].position_world_m, (12.0, 3.0, 2.0)) < 0.15]
    assert len(there) >= 10
    assert not pilot.touched()


def test_a_place_that_cannot_be_passed_clear_is_refused(asked_pilot):
    pilot = asked_pilot({"avoidance": "2d"}, obstacles=[WALL])
    # Right behind the wall and away from it: the curve would have to come through the wall.
    points = ({"position_world_m": (8.1, 1.0, 2.0), "velocity_world_m_s": (1.0, 0.0, 0.0)},)
    body = pilot.step(agent_0={"kind": "mission", "waypoints": points})
    assert "expected a way that keeps clear of obstacles, was passed at 1 m/s" in body.rejected_command
    assert body.phase == "holding"


def test_the_same_flight_comes_back_to_the_bit(asked_pilot):
    logs = []
    for _ in range(2):
        pilot = asked_pilot({"avoidance": "3d"}, {"avoidance": "2d"}, obstacles=[WALL, CRATE])
        pilot.step(agent_0=go((12.0, 3.0, 2.0)), agent_1=go((3.0, 8.0, 1.0)))
        pilot.run(150)
        logs.append([encode(message) for message in pilot.log])
    assert logs[0] == logs[1]


@pytest.mark.parametrize("mode", ["2d", "3d"])
def test_every_leg_keeps_clear_at_every_instant(make_room, mode):
    environment = make_room(obstacles=[WALL, CRATE, ("shelf", (9.0, 6.0, 1.5), (12.0, 8.0, 2.5))])
    routes = build_route_planner(environment, mode, radius_m=0.38)
    avoidance = ObstacleAvoidance(routes=routes, limits=LIMITS, tick_ns=100_000_000, has_wheels=False)
    rng = np.random.default_rng(5)
    n_bends = 0
    for _ in range(40):
        ends_m = [tuple(rng.uniform((0.6, 0.6, 0.6), (14.4, 9.4, 5.4)).tolist()) for _ in range(2)]
        if not all(routes.is_free(end_m) for end_m in ends_m):
            continue
        state = np.array([ends_m[0], (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
        legs = avoidance.plan([Leg(name="waypoint", place_world_m=ends_m[1])], state).legs
        n_bends += len(legs) - 1
        for leg in legs:
            path = plan_leg(leg, state, LIMITS, 0, 100_000_000)
            places_m = [path.state_after(t)[0] for t in np.linspace(0.0, path.duration_s, 60)]
            assert all(routes.is_free(tuple(place_m)) for place_m in places_m), (ends_m, leg)
            state = leg.end
        assert legs[-1].place_world_m == ends_m[1]
    assert n_bends > 5


def test_a_rover_has_no_third_dimension(make_scenario):
    with pytest.raises((ScenarioError, ValueError), match="none or 2d for a rover"):
        make_scenario({"model": "rover", "avoidance": "3d"})
