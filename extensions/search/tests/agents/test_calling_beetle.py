import math

import pytest
from briefings import briefing, observation

from gslcosim_agents.calling_beetle.agent import CallingBeetle

HERE_M = (7.0, 5.0, 2.0)
CLEAN, GAS = 50_000.0, 20_000.0


def beetle(*, members=("searcher", "other"), **parameters) -> CallingBeetle:
    return CallingBeetle(briefing(members=members, parameters=parameters))


def seen(ohm, **changes):
    return observation(position_m=HERE_M, readings={"nose": ohm, "vane": (0.5, math.pi)}, **changes)


def direction_deg(command):
    x_m, y_m, _ = command.position_world_m
    return math.degrees(math.atan2(y_m - HERE_M[1], x_m - HERE_M[0]))


def test_in_gas_it_calls_with_its_place_and_zigzags():
    caller = beetle()
    assert caller.decide(seen(CLEAN)).outgoing == ()
    commands = [caller.decide(seen(GAS)) for _ in range(2)]
    assert [message.text for command in commands for message in command.outgoing] == ["7.00 5.00"] * 2
    assert sorted(abs(direction_deg(command)) for command in commands) == pytest.approx([120.0, 120.0])
    assert direction_deg(commands[0]) == pytest.approx(-direction_deg(commands[1]))


def test_called_it_comes_until_it_is_near():
    called = beetle()
    called.observe(seen(CLEAN, asked=False, heard=[("other", "10.00 5.00")]))
    assert direction_deg(called.decide(seen(CLEAN))) == pytest.approx(0.0)
    called.observe(seen(CLEAN, asked=False, heard=[("other", "7.50 5.00")]))
    assert abs(direction_deg(called.decide(seen(CLEAN)))) == pytest.approx(90.0)


def test_without_a_channel_it_searches_alone():
    alone = beetle(members=())
    alone.decide(seen(CLEAN))
    assert alone.decide(seen(GAS)).outgoing == ()
