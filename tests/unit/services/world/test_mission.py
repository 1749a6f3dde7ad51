"""When a vehicle asks, what it does with the answer, and what it refuses."""

import math

import pytest

WAYPOINT = {"kind": "waypoint", "position_world_m": (4.0, 4.0, 2.5)}
CRATE = ("crate", (5.0, 5.0, 0.0), (6.0, 6.5, 3.0))


def ask_ticks(pilot):
    return [message.tick for message in pilot.log if message.bodies[0].awaiting_command]


def phases(pilot):
    seen = [message.bodies[0].phase for message in pilot.log]
    return [phase for i, phase in enumerate(seen) if i == 0 or phase != seen[i - 1]]


# ---------------------------------------------------------------- on request


def test_an_agent_is_asked_once_after_take_off_and_hold(make_pilot):
    pilot = make_pilot()
    body = pilot.run_until_asked()
    assert phases(pilot) == ["on_ground", "taking_off", "holding"]
    assert body.position_world_m == pytest.approx((3.0, 3.0, 2.0), abs=0.02)
    held_from = next(m.tick for m in pilot.log if m.bodies[0].phase == "holding")
    assert pilot.tick == held_from + 5
    pilot.step(agent_0=WAYPOINT)
    pilot.run(5)
    assert ask_ticks(pilot) == [held_from + 5]


def test_a_waypoint_is_reached_held_and_answered_with_a_question(asked_pilot):
    pilot = asked_pilot()
    assert pilot.step(agent_0=WAYPOINT).waypoint_world_m == (4.0, 4.0, 2.5)
    left_at = pilot.tick - 1
    pilot.run_until_asked()
    assert phases(pilot) == ["on_ground", "taking_off", "holding", "flying", "holding"]
    assert math.dist(pilot.body().position_world_m, (4.0, 4.0, 2.5)) < 0.02
    assert pilot.body().waypoint_world_m is None
    duration_s = 15 / 8 * 1.5 / 1.0
    assert pilot.tick == pytest.approx(left_at + 10 * (duration_s + 0.5), abs=1.5)


@pytest.mark.parametrize(("hold_s", "ticks"), [(0.0, 1), (0.1, 1), (1.0, 10)])
def test_hold_asks_again_after_its_time(asked_pilot, hold_s, ticks):
    pilot = asked_pilot()
    asked_at = pilot.tick
    pilot.step(agent_0={"kind": "hold", "hold_s": hold_s})
    if not pilot.body().awaiting_command:
        pilot.run_until_asked()
    assert pilot.tick == asked_at + ticks


def test_noop_asks_again_at_the_next_tick(asked_pilot):
    pilot = asked_pilot()
    for _ in range(3):
        assert pilot.step(agent_0={"kind": "noop"}).awaiting_command


def test_a_declaration_holds_and_asks_again(asked_pilot):
    pilot = asked_pilot()
    asked_at = pilot.tick
    declare = {"kind": "declare_source", "declaration": {"position_world_m": (5.0, 1.0, 2.0)}}
    assert not pilot.step(agent_0=declare).awaiting_command
    pilot.run_until_asked()
    assert pilot.tick == asked_at + 5
    assert pilot.body().phase == "holding"


def test_a_failed_agent_is_never_asked_again_and_its_vehicle_stays(asked_pilot):
    pilot = asked_pilot()
    pilot.step(agent_0={"kind": "failed", "reason": "gone"})
    body = pilot.run(100)
    assert body.phase == "failed"
    assert ask_ticks(pilot)[-1] < pilot.tick - 100
    assert body.position_world_m == pytest.approx((3.0, 3.0, 2.0), abs=0.02)


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ((1000.0, 4.0, 2.5), "expected x within 0 to 15 m, was 1000 m"),
        ((4.0, 4.0, -1.0), "expected z within 0.38 to 5.62 m, was -1 m"),
        ((5.5, 5.5, 1.0), "inside crate"),
    ],
)
def test_a_refused_waypoint_is_explained_held_and_asked_about(asked_pilot, place, text):
    pilot = asked_pilot(obstacles=[CRATE])
    asked_at = pilot.tick
    body = pilot.step(agent_0={"kind": "waypoint", "position_world_m": place})
    assert text in body.rejected_command
    assert body.phase == "holding"
    body = pilot.run_until_asked()
    assert pilot.tick == asked_at + 5
    # The notice stays until the next command, so that the observation that asks carries it.
    assert text in body.rejected_command
    assert pilot.step(agent_0=WAYPOINT).rejected_command is None


def test_a_waypoint_behind_a_wall_of_boxes_is_given_up(asked_pilot):
    wall = ("rack", (5.0, 0.0, 0.0), (5.5, 10.0, 6.0))
    pilot = asked_pilot(obstacles=[wall])
    body = pilot.fly({"kind": "waypoint", "position_world_m": (8.0, 3.0, 2.0)})
    assert "was still" in body.rejected_command
    assert body.position_world_m[0] < 5.0
    assert body.phase == "holding"
    pilot.fly({"kind": "hold", "hold_s": 5.0})
    assert math.hypot(*pilot.body().velocity_world_m_s) < 0.05
    assert all(m.bodies[0].contacts == () for m in pilot.log[-20:])


# ---------------------------------------------------------------- every tick


@pytest.mark.parametrize("mode", ["lockstep", {"latency": 3}])
def test_agents_of_the_other_modes_are_asked_at_every_tick(make_pilot, mode):
    pilot = make_pilot(mode=mode)
    pilot.run(60)
    assert ask_ticks(pilot) == list(range(61))


def test_the_last_waypoint_of_the_take_off_is_flown_after_it(make_pilot):
    pilot = make_pilot(mode="lockstep")
    pilot.run(10)
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (9.0, 9.0, 2.0)})
    assert pilot.step(agent_0=WAYPOINT).phase == "taking_off"
    pilot.run_until(lambda body: body.phase == "flying")
    assert pilot.body().waypoint_world_m == (4.0, 4.0, 2.5)
    assert phases(pilot) == ["on_ground", "taking_off", "flying"]


def test_a_new_waypoint_replaces_the_flight_without_a_jump(hovering_pilot):
    pilot = hovering_pilot()
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (9.0, 3.0, 2.0)})
    pilot.run(25)
    before = pilot.body()
    assert before.velocity_world_m_s[0] > 0.5
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (6.0, 7.0, 2.0)})
    change = math.dist(pilot.body().velocity_world_m_s, before.velocity_world_m_s)
    assert change < 0.1 * 2.0 * 1.3
    pilot.run_until(lambda body: body.phase == "holding")
    assert math.dist(pilot.body().position_world_m, (6.0, 7.0, 2.0)) < 0.05


@pytest.mark.parametrize("avoidance", ["none", "3d"])
def test_a_new_waypoint_far_behind_is_flown_to_without_swinging_out(hovering_pilot, avoidance):
    """At 1 m/s braking takes 0.4 m; one quintic to there would go on for metres, and into the wall."""
    pilot = hovering_pilot({"start_m": (4.0, 3.0, 0.2), "avoidance": avoidance})
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (14.0, 3.0, 2.0)})
    body = pilot.run_until(lambda body: body.position_world_m[0] > 11.0)
    assert body.velocity_world_m_s[0] > 0.6
    turned_at_m = body.position_world_m[0]
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (1.0, 8.0, 2.0)})
    body = pilot.run_until(lambda body: body.phase == "holding")
    assert math.dist(body.position_world_m, (1.0, 8.0, 2.0)) < 0.05
    assert body.rejected_command is None
    assert max(m.bodies[0].position_world_m[0] for m in pilot.log) < turned_at_m + 1.0
    assert max(math.hypot(*m.bodies[0].velocity_world_m_s) for m in pilot.log) < 1.1


def test_hold_in_flight_brakes_within_the_limits(hovering_pilot):
    pilot = hovering_pilot()
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (9.0, 3.0, 2.0)})
    pilot.run(25)
    at = pilot.body().position_world_m
    assert pilot.step(agent_0={"kind": "hold"}).phase == "holding"
    pilot.run(30)
    assert math.hypot(*pilot.body().velocity_world_m_s) < 0.01
    assert 0.1 < pilot.body().position_world_m[0] - at[0] < 0.75


def test_a_waypoint_that_was_interrupted_can_be_given_again(hovering_pilot):
    pilot = hovering_pilot()
    pilot.step(agent_0=WAYPOINT)
    pilot.run(5)
    pilot.step(agent_0={"kind": "hold"})
    assert pilot.step(agent_0=WAYPOINT).phase == "flying"


def test_failing_on_the_ground_finishes_the_take_off_without_a_collision(make_pilot):
    pilot = make_pilot(mode="lockstep")
    pilot.step(agent_0={"kind": "failed"})
    body = pilot.run(60)
    assert {m.bodies[0].phase for m in pilot.log[1:]} == {"failed"}
    assert not any(m.bodies[0].awaiting_command or m.bodies[0].contacts for m in pilot.log[1:])
    assert body.position_world_m == pytest.approx((3.0, 3.0, 2.0), abs=0.02)


# ---------------------------------------------------------------- velocity


def velocity(*velocity_world_m_s, **more):
    return {"kind": "velocity", "velocity_world_m_s": velocity_world_m_s, **more}


def test_a_velocity_is_flown_without_stopping_for_the_question(asked_pilot):
    pilot = asked_pilot()
    pilot.step(agent_0=velocity(0.5, 0.0, 0.0, hold_s=2.0))
    asked_at = pilot.tick - 1
    body = pilot.run_until_asked()
    assert pilot.tick == asked_at + 20
    assert body.phase == "flying"
    assert body.velocity_world_m_s == pytest.approx((0.5, 0.0, 0.0), abs=0.02)
    body = pilot.step(agent_0=velocity(0.5, 0.0, 0.0, hold_s=0.0))
    assert body.awaiting_command
    assert body.velocity_world_m_s == pytest.approx((0.5, 0.0, 0.0), abs=0.02)


def test_a_new_velocity_turns_the_flight_within_the_acceleration(hovering_pilot):
    pilot = hovering_pilot()
    pilot.step(agent_0=velocity(1.0, 0.0, 0.0))
    pilot.run(20)
    before = pilot.body().velocity_world_m_s
    pilot.step(agent_0=velocity(0.0, 1.0, 0.0))
    assert math.dist(pilot.body().velocity_world_m_s, before) < 0.1 * 2.0 * 1.3
    assert pilot.run(25).velocity_world_m_s == pytest.approx((0.0, 1.0, 0.0), abs=0.03)


BENDS = ({"position_world_m": (4.0, 3.0, 2.0), "hold_s": 0.5}, {"position_world_m": (4.0, 4.0, 2.0)})


@pytest.mark.parametrize(
    ("command", "n_ticks"),
    [(WAYPOINT, 60), (velocity(0.6, 0.3, 0.0), 30), ({"kind": "mission", "waypoints": BENDS}, 70)],
)
def test_repeating_a_command_changes_nothing(make_pilot, command, n_ticks):
    once, often = make_pilot(mode="lockstep"), make_pilot(mode="lockstep")
    for pilot in (once, often):
        pilot.run(45)
        pilot.step(agent_0=command)
    for _ in range(n_ticks):
        once.step(agent_0={"kind": "noop"})
        often.step(agent_0=command)
    assert often.log == once.log


@pytest.mark.parametrize(
    "wanted", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]
)
@pytest.mark.parametrize("is_repeated", [False, True])
def test_a_velocity_ends_before_the_edge_of_the_room(hovering_pilot, wanted, is_repeated):
    pilot = hovering_pilot()
    pilot.step(agent_0=velocity(*wanted))
    pilot.run_until(lambda body: body.rejected_command)
    assert "expected a stop at" in pilot.body().rejected_command
    for _ in range(60):
        pilot.step(**({"agent_0": velocity(*wanted)} if is_repeated else {}))
    assert pilot.body().phase == "holding"
    assert all(m.bodies[0].contacts == () for m in pilot.log[5:])
    assert math.hypot(*pilot.body().velocity_world_m_s) < 0.05
    axis = next(i for i in range(3) if wanted[i])
    edge_m = (15.0, 10.0, 6.0)[axis] - 0.48 if wanted[axis] > 0 else 0.48
    assert abs(pilot.body().position_world_m[axis] - edge_m) < 0.15


def test_a_waypoint_ends_a_velocity(hovering_pilot):
    pilot = hovering_pilot()
    pilot.step(agent_0=velocity(0.0, 0.8, 0.0))
    pilot.run(10)
    pilot.step(agent_0=WAYPOINT)
    pilot.run_until(lambda body: body.phase == "holding")
    assert math.dist(pilot.body().position_world_m, (4.0, 4.0, 2.5)) < 0.05
