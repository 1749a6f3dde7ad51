"""Agents of one process: order, repetition, and the failure of one among several."""

import traceback
from pathlib import Path

import pytest
from built_messages import build_briefing, build_observation

from gslcosim.agent_kit import Agent, Command
from gslcosim.agent_kit.agent import AgentGroup
from gslcosim.base.errors import ContractError
from gslcosim.contract import codec


def briefing(name, **changes):
    return build_briefing(**{"agent": name, "mode": "lockstep", **changes})


def observation(name, tick, *, is_question=True):
    return build_observation(tick, agent=name, awaiting_command=is_question)


class Flight:
    """A crew with a diary of what its agents saw, what was sent, and who left."""

    def __init__(self, *names, fails_at=None):
        self.seen, self.sent, self.left = [], [], []
        flight = self

        class Noting(Agent):
            def __init__(self, briefing):
                self.name = briefing.agent
                flight.note(self.name, "made")

            def observe(self, observation):
                flight.note(self.name, observation.tick)

            def decide(self, observation):
                return Command(tick=observation.tick, kind="hold", reason=f"{len(flight.seen)}")

            def end(self, reason):
                flight.note(self.name, reason)

        self._fails_at = fails_at
        self.group = AgentGroup(Noting, names, send=lambda *what: self.sent.append(what), leave=self.left.append)

    def note(self, name, what):
        self.seen.append((name, what))
        if (name, what) == self._fails_at:
            raise RuntimeError("lost my way")

    def brief(self, *names):
        for name in names:
            self.group.brief(name, briefing(name))
        return self

    def observe(self, *steps, is_question=True):
        for name, tick in steps:
            self.group.observe(name, observation(name, tick, is_question=is_question))


def test_agents_are_made_in_order_when_all_are_briefed():
    flight = Flight("a", "b")
    assert flight.brief("b").seen == []
    assert flight.brief("a").seen == [("a", "made"), ("b", "made")]


@pytest.mark.parametrize(
    "arrivals",
    [
        [("a", 0), ("b", 0), ("a", 1), ("b", 1)],
        [("b", 0), ("b", 1), ("a", 0), ("a", 1)],
        [("a", 0), ("a", 1), ("b", 0), ("b", 1)],
    ],
)
def test_observations_are_handed_out_by_tick_and_name_however_they_arrive(arrivals):
    flight = Flight("a", "b").brief("a", "b")
    flight.observe(*arrivals)
    assert flight.seen[2:] == [("a", 0), ("b", 0), ("a", 1), ("b", 1)]
    assert [name for name, _ in flight.sent] == ["a", "b", "a", "b"]


def test_observations_before_the_briefings_are_kept():
    flight = Flight("a", "b")
    flight.observe(("a", 0), ("b", 0))
    flight.brief("a", "b")
    assert flight.seen[2:] == [("a", 0), ("b", 0)]


def test_a_lost_observation_holds_nobody_up_for_ever():
    """When the others are further, or the question is repeated, it is not waited for."""
    flight = Flight("a", "b").brief("a", "b")
    flight.observe(("a", 0), ("b", 1))
    assert flight.seen[2:] == [("a", 0)]
    flight.observe(("a", 1), ("a", 2))
    assert flight.seen[3:] == [("a", 1), ("b", 1)]
    flight.observe(("a", 2))
    assert flight.seen[5:] == [("a", 2)]


def test_a_repeated_question_gets_the_same_bytes_and_is_not_decided_again():
    flight = Flight("a").brief("a")
    flight.observe(("a", 0), ("a", 0))
    assert flight.sent[0] == flight.sent[1]
    assert flight.seen == [("a", "made"), ("a", 0)]


def test_a_repeated_observation_that_asks_nothing_is_not_answered():
    flight = Flight("a").brief("a")
    flight.observe(("a", 0), ("a", 0), is_question=False)
    assert flight.sent == []


def test_each_agent_states_its_contract_once():
    flight = Flight("a", "b").brief("a", "b")
    flight.observe(("a", 0), ("b", 0), ("a", 1), ("b", 1))
    contracts = [(name, codec.decode(Command, answer).contract is not None) for name, answer in flight.sent]
    assert contracts == [("a", True), ("b", True), ("a", False), ("b", False)]


@pytest.mark.parametrize("when", ["made", 0, 1])
def test_one_of_several_may_fail_and_the_others_go_on(when, capsys):
    flight = Flight("a", "b", fails_at=("a", when)).brief("a", "b")
    flight.observe(("a", 0), ("b", 0), ("a", 1), ("b", 1), ("a", 2), ("b", 2))
    flight.group.end("success")
    assert [what for name, what in flight.seen if name == "b"] == ["made", 0, 1, 2, "success"]
    assert (flight.left, flight.group.failed) == (["a"], ("a",))
    assert flight.seen.count(("a", "success")) == 0
    assert "lost my way" in capsys.readouterr().err


def test_a_single_agents_failure_is_raised():
    flight = Flight("a", fails_at=("a", 1)).brief("a")
    flight.observe(("a", 0))
    with pytest.raises(RuntimeError, match="lost my way"):
        flight.observe(("a", 1))


def test_another_contract_is_refused():
    with pytest.raises(ContractError, match="major version"):
        Flight("a").group.brief("a", briefing("a", contract_version="99.0"))


class Mistaken(Agent):
    """Takes another word for a field of its command."""

    def __init__(self, briefing):
        pass

    def decide(self, observation):
        return Command(tick=observation.tick, kind="waypoint", position_m=(1.0, 2.0, 3.0))


def test_a_wrong_keyword_ends_with_the_authors_own_line_and_the_nearest_word():
    group = AgentGroup(Mistaken, ["a"], send=lambda *_: None)
    group.brief("a", briefing("a"))
    with pytest.raises(TypeError, match="Did you mean position_world_m") as raised:
        group.observe("a", observation("a", 0))
    last = traceback.extract_tb(raised.value.__traceback__)[-1]
    assert Path(last.filename).name == Path(__file__).name
    assert "position_m=(1.0, 2.0, 3.0)" in (last.line or "")
