"""Landing, taking off again, and missions of waypoints."""

import math

import pytest

TABLE = ("table", (3.0, 6.0, 0.0), (6.0, 9.0, 1.0))
FREE_M = (4.0, 4.0, 2.0)
LAND = {"kind": "land"}


def waypoint(*place_m):
    return {"kind": "waypoint", "position_world_m": place_m}


def mission(*waypoints, **more):
    return {"kind": "mission", "waypoints": waypoints, **more}


def landed(asked_pilot):
    pilot = asked_pilot()
    pilot.step(agent_0=LAND)
    pilot.run_until(lambda body: body.phase == "on_ground")
    return pilot


@pytest.mark.parametrize("model", ["iris", "crazyflie", "holonomic"])
def test_it_comes_down_stands_and_asks(make_pilot, model):
    pilot = make_pilot({"model": model})
    standing_m = pilot.body().position_world_m
    pilot.run_until_asked()
    assert pilot.step(agent_0=LAND).phase == "landing"
    body = pilot.run_until(lambda body: body.awaiting_command)
    assert body.phase == "on_ground"
    assert body.position_world_m == pytest.approx(standing_m, abs=0.02)
    assert math.hypot(*body.velocity_world_m_s) < 0.02
    assert body.tracking_error_m is None
    assert {name for message in pilot.log for name in message.bodies[0].contacts} == {"floor"}


def test_it_lands_on_what_is_below(asked_pilot):
    pilot = asked_pilot(obstacles=[TABLE])
    pilot.fly(waypoint(4.5, 7.5, 2.0))
    pilot.step(agent_0=LAND)
    body = pilot.run_until(lambda body: body.phase == "on_ground")
    assert body.position_world_m == pytest.approx((4.5, 7.5, 1.055), abs=0.02)


def test_it_does_not_land_on_an_edge(asked_pilot):
    pilot = asked_pilot(obstacles=[TABLE])
    pilot.fly(waypoint(4.5, 6.2, 2.0))
    body = pilot.step(agent_0=LAND)
    assert body.rejected_command == "land: expected level ground within 0.38 m of (4.50, 6.20), was 0 to 1 m high."
    assert body.phase == "holding"


def test_it_takes_off_again(asked_pilot):
    pilot = landed(asked_pilot)
    x_m, y_m, _ = pilot.body().position_world_m
    assert pilot.step(agent_0={"kind": "take_off"}).phase == "taking_off"
    body = pilot.run_until_asked()
    assert body.position_world_m == pytest.approx((x_m, y_m, 2.0), abs=0.02)
    assert body.phase == "holding"


def test_a_waypoint_lifts_it_first(asked_pilot):
    pilot = landed(asked_pilot)
    assert pilot.step(agent_0=waypoint(5.0, 3.0, 1.0)).phase == "taking_off"
    pilot.run_until(lambda body: body.phase == "flying")
    assert pilot.body().position_world_m[2] == pytest.approx(2.0, abs=0.05)
    assert pilot.run_until_asked().position_world_m == pytest.approx((5.0, 3.0, 1.0), abs=0.02)


def test_holding_on_the_ground_is_standing(asked_pilot):
    pilot = landed(asked_pilot)
    pilot.run_until_asked()
    before = pilot.body().position_world_m
    assert pilot.step(agent_0={"kind": "hold", "hold_s": 1.0}).phase == "on_ground"
    body = pilot.run_until_asked()
    assert body.position_world_m == pytest.approx(before, abs=1e-3)


def test_landing_is_broken_off_by_another_command(asked_pilot):
    pilot = asked_pilot()
    pilot.step(agent_0=LAND)
    pilot.run(10)
    assert pilot.body().position_world_m[2] < 1.9
    assert pilot.fly(waypoint(3.0, 5.0, 2.5)).position_world_m == pytest.approx((3.0, 5.0, 2.5), abs=0.02)


@pytest.mark.parametrize(
    ("is_landed", "kind", "text"),
    [
        (False, "take_off", "take_off: expected a vehicle that has landed, was in the air."),
        (True, "land", "land: expected a vehicle in the air, was on the ground."),
    ],
)
def test_what_is_done_already_is_refused(make_pilot, asked_pilot, is_landed, kind, text):
    pilot = landed(asked_pilot) if is_landed else make_pilot()
    pilot.run_until_asked()
    assert pilot.step(agent_0={"kind": kind}).rejected_command == text


def test_a_repeated_landing_is_one_landing(hovering_pilot):
    pilot = hovering_pilot()
    pilot.step(agent_0=LAND)
    while pilot.body().phase == "landing":
        pilot.step(agent_0=LAND)
    body = pilot.step(agent_0=LAND)
    assert (body.phase, body.rejected_command) == ("on_ground", None)
    for _ in range(45):
        body = pilot.step(agent_0={"kind": "take_off"})
    assert (body.phase, body.rejected_command) == ("holding", None)


# ---------------------------------------------------------------- missions


def test_a_mission_stops_and_holds_at_its_waypoints(asked_pilot):
    pilot = asked_pilot()
    places = [(5.0, 3.0, 2.0), (5.0, 5.0, 3.0), (3.0, 3.0, 2.0)]
    pilot.step(agent_0=mission(*({"position_world_m": place, "hold_s": 0.5} for place in places)))
    started = pilot.tick
    pilot.run_until_asked()
    for place in places:
        near = [m for m in pilot.log[started:] if math.dist(m.bodies[0].position_world_m, place) < 0.03]
        assert len(near) >= 5
        assert min(math.hypot(*m.bodies[0].velocity_world_m_s) for m in near) < 0.02
    # Half a second at each, and the tick at which the agent is asked.
    phases = [message.bodies[0].phase for message in pilot.log[started:]]
    assert phases.count("holding") == 16


def test_a_mission_passes_with_its_velocities_at_its_times(asked_pilot):
    pilot = asked_pilot({"max_speed_m_s": 2.0})
    started = pilot.tick
    through = {"position_world_m": (5.0, 3.0, 2.0), "velocity_world_m_s": (1.0, 0.0, 0.0), "after_s": 3.0}
    pilot.step(agent_0=mission(through, {"position_world_m": (8.0, 4.0, 2.0), "after_s": 4.0}))
    body = pilot.run(29)
    assert pilot.tick == started + 30
    assert body.position_world_m == pytest.approx((5.0, 3.0, 2.0), abs=0.05)
    assert body.velocity_world_m_s == pytest.approx((1.0, 0.0, 0.0), abs=0.08)
    body = pilot.run(40)
    assert body.position_world_m == pytest.approx((8.0, 4.0, 2.0), abs=0.05)
    pilot.run_until_asked()


def test_the_last_velocity_of_a_mission_is_kept_until_the_next_command(asked_pilot):
    pilot = asked_pilot()
    pilot.fly(mission({"position_world_m": (5.0, 3.0, 2.0), "velocity_world_m_s": (0.5, 0.0, 0.0)}))
    assert pilot.run(5).velocity_world_m_s == pytest.approx((0.5, 0.0, 0.0), abs=0.03)
    pilot.run_until(lambda body: body.rejected_command)
    assert "expected a stop at x" in pilot.body().rejected_command


def test_a_mission_is_replaced_in_flight(hovering_pilot):
    pilot = hovering_pilot()
    pilot.step(agent_0=mission({"position_world_m": (9.0, 3.0, 2.0)}, {"position_world_m": (9.0, 8.0, 2.0)}))
    pilot.run(20)
    pilot.step(agent_0=waypoint(5.0, 5.0, 2.0))
    body = pilot.run_until(lambda body: body.phase == "holding")
    assert body.position_world_m == pytest.approx((5.0, 5.0, 2.0), abs=0.05)
    assert pilot.run(30).position_world_m == pytest.approx((5.0, 5.0, 2.0), abs=0.02)


@pytest.mark.parametrize(
    ("place_m", "more", "text"),
    [
        ((4.0, 4.0, -1.0), {}, "waypoints[1]: expected z within"),
        ((4.5, 7.0, 0.5), {}, "inside table"),
        ((1e3, 4.0, 2.0), {}, "waypoints[1]: expected x within 0 to 15 m, was 1000 m"),
        (FREE_M, {"velocity_world_m_s": (3, 0, 0)}, "waypoints[1].velocity: expected at most 1 m/s, was 3 m/s."),
        (FREE_M, {"acceleration_world_m_s2": (0, 30, 0)}, ".acceleration: expected at most 2 m/s^2, was 30 m/s^2."),
        (FREE_M, {"velocity_world_m_s": (0.5, 0, 0), "hold_s": 1.0}, ".hold_s: expected 0 where the vehicle passes"),
    ],
)
def test_a_mission_with_a_bad_waypoint_is_refused_as_a_whole(asked_pilot, place_m, more, text):
    pilot = asked_pilot(obstacles=[TABLE])
    body = pilot.step(agent_0=mission({"position_world_m": FREE_M}, {"position_world_m": place_m, **more}))
    assert text in body.rejected_command
    assert body.phase == "holding"


def test_a_mission_whose_path_leaves_the_room_is_refused(asked_pilot):
    pilot = asked_pilot()
    out = {"position_world_m": (14.5, 3.0, 2.0), "velocity_world_m_s": (1.0, 0.0, 0.0)}
    back = {"position_world_m": (14.5, 5.0, 2.0), "velocity_world_m_s": (-1.0, 0.0, 0.0)}
    body = pilot.step(agent_0=mission(out, back))
    assert "waypoints[1]: path to it: expected x within 0 to 15 m, was 15." in body.rejected_command
    pilot.run_until_asked()
    assert pilot.step(agent_0=mission(out, {**back, "velocity_world_m_s": (0.0, 1.0, 0.0)})).rejected_command


def test_limits_beyond_the_vehicles_are_kept_to_what_its_tilt_gives(asked_pilot):
    """At 40 m/s^2 a leg would want a tilt of 76 degrees; the rotors are asked for no more than 0.9 of theirs."""
    pilot = asked_pilot({"max_speed_m_s": 50.0, "max_acceleration_m_s2": 40.0})
    pilot.fly(waypoint(13.0, 3.0, 2.0))
    errors_m = [m.bodies[0].tracking_error_m for m in pilot.log[1:]]
    assert max(errors_m) < 0.4
    assert pilot.body().position_world_m == pytest.approx((13.0, 3.0, 2.0), abs=0.05)
