"""When an agent is asked for which time does not wait."""

from gslcosim_services.world.autopilot import REQUEST_PERIOD_S

ASK_AGAIN_TICKS = round(REQUEST_PERIOD_S / 0.1)


def test_it_is_asked_once_and_again_when_it_has_said_nothing_for_long(asked_pilot):
    pilot = asked_pilot(mode="free")
    asked_at = pilot.tick
    pilot.run(ASK_AGAIN_TICKS)
    asked = [poses.tick for poses in pilot.log if poses.bodies[0].awaiting_command]
    assert asked == [asked_at, asked_at + ASK_AGAIN_TICKS]


def test_it_is_asked_again_when_it_has_arrived(make_pilot):
    pilot = make_pilot(mode="free")
    x_m, y_m, z_m = pilot.run_until_asked().position_world_m
    arrived = pilot.fly({"kind": "waypoint", "position_world_m": (x_m + 1, y_m, z_m)})
    assert abs(arrived.position_world_m[0] - x_m - 1) < 0.1


def test_a_noop_is_no_answer(asked_pilot):
    pilot = asked_pilot(mode="free")
    for _ in range(ASK_AGAIN_TICKS - 1):
        assert not pilot.step(agent_0={"kind": "noop"}).awaiting_command


def test_it_may_speak_unasked(make_pilot):
    pilot = make_pilot(mode="free")
    x_m, y_m, z_m = pilot.run_until_asked().position_world_m
    pilot.step(agent_0={"kind": "waypoint", "position_world_m": (x_m + 2, y_m, z_m)})
    pilot.run(3)
    body = pilot.step(agent_0={"kind": "waypoint", "position_world_m": (x_m, y_m + 1, z_m)})
    assert not body.awaiting_command
    there = pilot.run_until_asked().position_world_m
    assert abs(there[1] - y_m - 1) < 0.1
