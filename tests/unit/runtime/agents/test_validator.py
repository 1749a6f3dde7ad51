"""Whatever an agent sends, exactly one valid command passes for each observation that awaits one."""

import pytest
from built_messages import build_observation
from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim.runtime.agents.validator import (
    AGENT_LOST_REASON,
    MAX_COMMAND_BYTES,
    MAX_EARLY_ANSWERS,
    MAX_FAULTS,
    CommandValidator,
)


def observation(tick, *, awaiting=True):
    return build_observation(tick, awaiting_command=awaiting)


def waypoint(tick):
    return Command(tick=tick, kind="waypoint", position_world_m=(1.0, 2.0, 3.0))


def test_a_valid_answer_passes_unchanged():
    validator = CommandValidator("beetle")
    assert validator.on_observation(observation(5)) == []
    assert validator.on_answer(codec.encode(waypoint(5))) == [waypoint(5)]
    assert validator.faults == []
    assert validator.pending == ()


def test_an_answer_that_overtakes_its_observation_is_kept():
    """Two links have no order between them: the early answer passes when its observation arrives."""
    validator = CommandValidator("beetle")
    assert validator.on_answer(codec.encode(waypoint(5))) == []
    assert validator.on_observation(observation(4, awaiting=False)) == []
    assert validator.on_observation(observation(5)) == [waypoint(5)]
    assert validator.faults == []


BAD_ANSWERS = {
    "garbage": (b"\xc1garbage", "expected a msgpack map"),
    "future tick": (codec.encode(waypoint(6)), "tick: expected 5, was 6"),
    "failed": (codec.encode(Command(tick=5, kind="failed")), "expected one of waypoint, hold"),
    "too large": (bytes(MAX_COMMAND_BYTES + 1), f"expected at most {MAX_COMMAND_BYTES} bytes"),
}


@pytest.mark.parametrize("name", BAD_ANSWERS)
def test_a_bad_answer_becomes_a_hold_and_a_fault(name):
    payload, expected = BAD_ANSWERS[name]
    validator = CommandValidator("beetle")
    validator.on_observation(observation(5))
    (command,) = validator.on_answer(payload)
    assert (command.tick, command.kind) == (5, "hold")
    assert expected in validator.faults[0].text
    assert validator.pending == ()


def test_a_repeated_answer_is_ignored_without_a_fault():
    validator = CommandValidator("beetle")
    validator.on_observation(observation(5))
    validator.on_answer(codec.encode(waypoint(5)))
    assert validator.on_answer(codec.encode(waypoint(5))) == []
    validator.on_observation(observation(6))
    assert validator.on_answer(codec.encode(waypoint(5))) == []
    assert len(validator.pending) == 1
    assert validator.n_faults == 0


def test_a_flood_is_counted_not_kept():
    validator = CommandValidator("beetle")
    validator.on_observation(observation(5, awaiting=False))
    for tick in range(1000):
        assert validator.on_answer(codec.encode(waypoint(100 + tick))) == []
    assert validator.n_faults == 1000 - MAX_EARLY_ANSWERS
    assert len(validator.faults) == MAX_FAULTS


def test_an_agent_that_is_gone_fails_where_it_owes_an_answer():
    validator = CommandValidator("beetle")
    assert validator.on_lost("was killed") == []
    (command,) = validator.on_observation(observation(5))
    assert (command.tick, command.kind, command.reason) == (5, "failed", AGENT_LOST_REASON)
    assert validator.on_observation(observation(6)) == []
    assert validator.on_answer(codec.encode(waypoint(6))) == []
    validator = CommandValidator("beetle")
    validator.on_observation(observation(3))
    assert validator.on_lost("was killed")[0].tick == 3


def test_in_latency_mode_several_answers_may_be_open():
    validator = CommandValidator("beetle", may_overlap=True)
    for tick in range(3):
        validator.on_observation(observation(tick))
    assert validator.on_answer(codec.encode(waypoint(1))) == [waypoint(1)]
    assert validator.on_answer(codec.encode(waypoint(3))) == []
    assert validator.on_answer(codec.encode(waypoint(0))) == [waypoint(0)]
    assert validator.on_observation(observation(3)) == [waypoint(3)]
    assert validator.pending == (2,)


@settings(deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=40), st.integers(0, 12)), max_size=30))
def test_one_command_for_each_question(events):
    validator = CommandValidator("beetle")
    passed = []
    tick = 0
    for event in events:
        if not validator.pending:
            passed += validator.on_observation(observation(tick, awaiting=tick % 2 == 0))
            tick += 1
        payload = event if isinstance(event, bytes) else codec.encode(waypoint(event))
        passed += validator.on_answer(payload)
    ticks = [command.tick for command in passed]
    assert ticks == sorted(set(ticks))
    assert all(t % 2 == 0 and t < tick for t in ticks)


@pytest.mark.parametrize("name", ["garbage", "too large"])
def test_an_unreadable_answer_that_overtakes_its_observation_is_one_too(name):
    """The question is answered with a hold; waiting for a second answer would be waiting for ever."""
    payload, expected = BAD_ANSWERS[name]
    validator = CommandValidator("beetle")
    validator.on_observation(observation(1, awaiting=False))
    assert validator.on_answer(payload) == []
    assert validator.on_observation(observation(2, awaiting=False)) == []
    (command,) = validator.on_observation(observation(5))
    assert (command.tick, command.kind) == (5, "hold")
    assert [expected in fault.text for fault in validator.faults] == [True]
    assert validator.pending == ()
