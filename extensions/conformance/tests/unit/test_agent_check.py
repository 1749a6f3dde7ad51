"""Rules over what happened, one transcript for each way to break one."""

from dataclasses import replace

import msgpack
import pytest

from gslcosim_conformance.agent_check import find_ending_failures, find_repeat_failures, find_session_failures
from gslcosim_conformance.answers import read_answer
from gslcosim_conformance.check import find_difference
from gslcosim_conformance.session import AgentTranscript, Question, ReceivedAnswer
from gslcosim_conformance.transcript import SessionLimits, SessionScript

LIMITS = SessionLimits(join_s=10.0, answer_s=1.0)


def sent(tick, at_s, open_tick=None, **changes):
    payload = msgpack.packb({"tick": tick, "kind": "hold"} | changes)
    return ReceivedAnswer(answer=read_answer(payload), at_s=at_s, open_tick=open_tick)


@pytest.fixture
def flight():
    """A run in which all is right: observations 0 to 3, of which 2 and 3 ask, and a clean end."""
    return AgentTranscript(
        SessionScript(name="first", seed=1),
        joined_at_s=0.5,
        sent_ticks={0, 1, 2, 3},
        questions=[Question(2, sent_at_s=1.0, closed_at_s=1.1), Question(3, sent_at_s=2.0, closed_at_s=2.1)],
        arrivals=[sent(2, 1.1, 2), sent(3, 2.1, 3)],
        n_arrivals=2,
        end_sent_at_s=3.0,
        left_at_s=3.1,
        exited_at_s=3.2,
        exit_code=0,
    )


def failed(transcript):
    return [*find_session_failures(transcript, LIMITS), *find_ending_failures(transcript, LIMITS)]


def test_a_right_run_breaks_no_rule(flight):
    assert failed(flight) == []


@pytest.mark.parametrize(
    ("rules", "changes"),
    [
        (["joins"], {"joined_at_s": None, "end_sent_at_s": None}),
        (["joins"], {"joined_at_s": None, "exited_at_s": 0.1, "exit_code": 1, "end_sent_at_s": None}),
        (["listens-first"], {"unsubscribed_keys": ("agents/agent_1/observation",)}),
        (["answers"], {"arrivals": [sent(2, 1.1, 2)]}),
        (["deadline"], {"arrivals": [sent(2, 1.1, 2), sent(3, 3.5, 3)]}),
        (["tick"], {"arrivals": [sent(2, 1.1, 2), sent(4, 2.1, 3)]}),
        (["tick"], {"arrivals": [sent(3, 1.1, 2), sent(4, 2.1, 3)]}),
        (["tick"], {"arrivals": [sent(1, 1.1, 2), sent(2, 2.1, 3)]}),
        (["integers"], {"arrivals": [sent(2, 1.1, 2), sent(3.0, 2.1, 3)]}),
        (["schema"], {"arrivals": [sent(2, 1.1, 2, kind="goto"), sent(3, 2.1, 3)]}),
        (["schema"], {"arrivals": [sent(2, 1.1, 2), sent(3, 2.1, 3), sent(3, 2.5, kind="goto")]}),
        (["once"], {"arrivals": [sent(2, 1.1, 2), sent(2, 1.2), sent(3, 2.1, 3)]}),
        (["once"], {"arrivals": [sent(2, 1.1, 2), sent(2, 2.05, 3), sent(3, 2.1, 3)]}),
        (["unasked"], {"arrivals": [sent(1, 0.9), sent(2, 1.1, 2), sent(3, 2.1, 3)]}),
        (["unasked"], {"arrivals": [sent(1, 1.05, 2), sent(2, 1.1, 2), sent(3, 2.1, 3)]}),
        (["unasked"], {"arrivals": [sent(2, 1.1, 2), sent(3, 2.1, 3), sent(7, 2.5)]}),
        (["flood"], {"n_arrivals": 5000}),
        (["own-key"], {"unexpected_messages": ["truth/bodies"]}),
        (["own-ears"], {"foreign_subscriptions": ("truth/bodies",)}),
        (["own-ears"], {"queries": ["truth/bodies"]}),
        (["stays"], {"exited_at_s": 2.5, "left_at_s": 2.4, "end_sent_at_s": None}),
        (["stays"], {"left_at_s": 2.5, "left_how": "its output ended", "exited_at_s": None, "end_sent_at_s": None}),
        (["ending"], {"exited_at_s": None, "exit_code": None}),
        (["exit-code"], {"exit_code": 3}),
        (["exit-code"], {"exit_code": -9}),
    ],
)
def test_each_break_is_found_by_its_rule_alone(flight, rules, changes):
    broken = replace(flight, **changes)
    assert failed(broken) == rules
    for failure in (find_session_failures(broken, LIMITS) | find_ending_failures(broken, LIMITS)).values():
        assert failure.sent
        assert failure.expected
        assert failure.got
        assert failure.flight == "first"


def test_a_run_that_ends_unanswered_because_the_agent_is_gone_blames_the_leaving_only(flight):
    gone = replace(flight, arrivals=[sent(2, 1.1, 2)], exited_at_s=2.05, exit_code=1, end_sent_at_s=None)
    assert failed(gone) == ["stays"]
    assert "exit code 1" in find_session_failures(gone, LIMITS)["stays"].got


def test_the_first_command_that_differs_is_reported(flight):
    other = replace(flight, arrivals=[sent(2, 1.1, 2), sent(3, 2.1, 3, hold_s=1.0)])
    found = find_difference("determinism", flight, other, sent="")
    assert "tick 3" in found["determinism"].sent
    assert '"hold_s":1.0' in found["determinism"].got
    assert find_difference("determinism", flight, flight, sent="") == {}


def test_what_an_agent_says_of_its_contract_makes_no_difference(flight):
    other = replace(flight, arrivals=[sent(2, 1.1, 2, contract="1.0"), sent(3, 2.1, 3)])
    assert find_difference("determinism", flight, other, sent="") == {}


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (None, "nothing"),
        (sent(2, 1.3, 2, hold_s=1.0), "not the same"),
        (sent(2, 1.3, 2), ""),
    ],
)
def test_a_repeated_question_wants_the_same_bytes_again(flight, second, words):
    question = replace(flight.questions[0], n_sent=2)
    arrivals = [flight.arrivals[0], *([second] if second else []), flight.arrivals[1]]
    repeated = replace(flight, questions=[question, flight.questions[1]], arrivals=arrivals)
    found = find_repeat_failures(repeated, may_answer_more=False)
    assert bool(found) == bool(words)
    assert not words or words in found["repeats"].got
