"""The validator of a fork: before the fork the commands of the past pass, whatever the agent says."""

import pytest
from built_messages import build_observation

from gslcosim.base.errors import RunFolderError
from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim.runtime.agents.validator import ReplayValidator


def hold(tick, hold_s=0.0):
    return Command(tick=tick, kind="hold", hold_s=hold_s)


def observation(tick):
    return build_observation(tick, agent="moth")


def validator(*past, until_tick=10, **others):
    return ReplayValidator("moth", past={command.tick: command for command in past}, until_tick=until_tick, **others)


def test_answers_count_from_the_fork_on():
    it = validator(hold(3, 7.0))
    it.on_observation(observation(3))
    assert it.on_answer(codec.encode(hold(3, 1.0))) == [hold(3, 7.0)]
    it.on_observation(observation(10))
    assert it.on_answer(codec.encode(hold(10, 1.0))) == [hold(10, 1.0)]


def test_time_waits_for_the_agent_in_the_past_too():
    it = validator(hold(3))
    assert it.on_observation(observation(3)) == []
    assert it.pending == (3,)


def test_what_it_does_wrong_in_the_past_is_noted_and_changes_nothing():
    it = validator(hold(3, 7.0))
    it.on_observation(observation(3))
    assert it.on_answer(b"garbage") == [hold(3, 7.0)]
    assert len(it.faults) == 1


def test_an_agent_that_is_gone_before_the_fork_fails_after_it():
    it = validator(hold(3), hold(4), hold(5))
    it.on_observation(observation(3))
    assert it.on_lost("gone") == [hold(3)]
    assert it.on_observation(observation(4)) == [hold(4)]
    assert it.on_observation(observation(5)) == [hold(5)]
    assert [command.kind for command in it.on_observation(observation(12))] == ["failed"]
    assert it.is_closed


def test_with_latency_all_that_is_owed_from_the_past_passes():
    it = validator(hold(8), hold(9), may_overlap=True)
    for tick in (8, 9, 10):
        it.on_observation(observation(tick))
    passed = it.on_lost("gone")
    assert [(command.tick, command.kind) for command in passed] == [(8, "hold"), (9, "hold"), (10, "failed")]


def test_nothing_follows_where_the_past_agent_failed():
    it = validator(Command(tick=3, kind="failed", reason="gone"))
    it.on_observation(observation(3))
    assert [command.kind for command in it.on_answer(codec.encode(hold(3)))] == ["failed"]
    assert it.is_closed


def test_a_command_that_lacks_is_reported():
    it = validator()
    it.on_observation(observation(3))
    with pytest.raises(RunFolderError, match="expected a command of moth for tick 3"):
        it.on_answer(codec.encode(hold(3)))
