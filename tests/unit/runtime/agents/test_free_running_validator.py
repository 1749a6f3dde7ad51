"""The validator of an agent in free mode: one command at each tick, the last that has come, whenever it came."""

import pytest
from built_messages import build_observation

from gslcosim.base.errors import RunFolderError
from gslcosim.contract import codec
from gslcosim.contract.messages import Command, Declaration, RadioMessage
from gslcosim.runtime.agents.validator import FreeRunningValidator


def observation(tick, *, awaiting=False):
    return build_observation(tick, agent="moth", awaiting_command=awaiting)


def waypoint(tick, x_m, **fields):
    return Command(tick=tick, kind="waypoint", position_world_m=(x_m, 0.0, 1.0), **fields)


def declaration(tick):
    return Command(tick=tick, kind="declare_source", declaration=Declaration(position_world_m=(1.0, 1.0, 1.0)))


def noop(tick):
    return Command(tick=tick, kind="noop")


def said(validator, *commands):
    for command in commands:
        assert validator.on_answer(codec.encode(command)) == []


def test_one_command_passes_at_each_tick_whether_or_not_one_has_come():
    validator = FreeRunningValidator("moth")
    assert validator.on_observation(observation(0)) == [noop(0)]
    said(validator, waypoint(0, 2.0))
    assert validator.on_observation(observation(1)) == [waypoint(1, 2.0)]
    assert validator.on_observation(observation(2)) == [noop(2)]
    assert validator.pending == ()


@pytest.mark.parametrize("told_tick", [0, 3, 99])
def test_a_command_gets_the_tick_at_which_it_passes(told_tick):
    validator = FreeRunningValidator("moth")
    said(validator, waypoint(told_tick, 2.0))
    assert validator.on_observation(observation(7)) == [waypoint(7, 2.0)]
    assert not validator.faults


def test_the_last_of_several_passes_and_a_noop_replaces_none():
    validator = FreeRunningValidator("moth")
    said(validator, waypoint(0, 1.0), waypoint(0, 2.0), noop(0))
    assert validator.on_observation(observation(1)) == [waypoint(1, 2.0)]
    assert validator.on_observation(observation(2)) == [noop(2)]


def test_a_declaration_is_made_whatever_follows_it():
    validator = FreeRunningValidator("moth")
    said(validator, declaration(0), waypoint(0, 1.0), waypoint(0, 2.0))
    assert validator.on_observation(observation(1)) == [declaration(1)]
    assert validator.on_observation(observation(2)) == [waypoint(2, 2.0)]


def test_texts_of_a_replaced_command_are_sent():
    validator = FreeRunningValidator("moth")
    texts = [RadioMessage(channel="air", text=text) for text in ("first", "second")]
    said(validator, waypoint(0, 1.0, outgoing=(texts[0],)), waypoint(0, 2.0, outgoing=(texts[1],)))
    (passed,) = validator.on_observation(observation(1))
    assert passed.outgoing == tuple(texts)


def test_what_is_said_twice_byte_for_byte_counts_once():
    validator = FreeRunningValidator("moth")
    said(validator, waypoint(3, 1.0))
    validator.on_observation(observation(4))
    said(validator, waypoint(3, 1.0))
    assert validator.on_observation(observation(5)) == [noop(5)]


@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        (codec.encode(Command(tick=0, kind="failed")), "was 'failed'"),
    ],
)
def test_a_bad_command_becomes_a_hold_and_a_fault(payload, expected):
    validator = FreeRunningValidator("moth")
    validator.on_answer(payload)
    (passed,) = validator.on_observation(observation(3))
    assert (passed.kind, passed.tick) == ("hold", 3)
    assert expected in validator.faults[0].text


def test_an_agent_that_is_gone_fails_at_the_next_tick_and_nothing_follows():
    validator = FreeRunningValidator("moth")
    assert validator.on_lost("it left") == []
    assert [command.kind for command in validator.on_observation(observation(3))] == ["failed"]
    assert validator.on_observation(observation(4)) == []


def test_the_past_passes_until_the_fork_and_then_what_comes():
    validator = FreeRunningValidator("moth", past={0: noop(0), 1: waypoint(1, 5.0)}, until_tick=2)
    assert validator.on_observation(observation(0)) == [noop(0)]
    said(validator, waypoint(0, 2.0))
    assert validator.on_observation(observation(1)) == [waypoint(1, 5.0)]
    assert validator.on_observation(observation(2)) == [noop(2)]
    said(validator, waypoint(2, 3.0))
    assert validator.on_observation(observation(3)) == [waypoint(3, 3.0)]


def test_a_past_with_a_hole_is_reported():
    validator = FreeRunningValidator("moth", past={}, until_tick=2)
    with pytest.raises(RunFolderError, match="expected a command of moth for tick 0"):
        validator.on_observation(observation(0))
