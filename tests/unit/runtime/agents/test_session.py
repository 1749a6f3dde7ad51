"""A session lets commands pass, keeps what they leave, and gives up an agent that owes an answer for too long."""

import pytest
from built_messages import build_observation

from gslcosim.agent_kit import Agent
from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim.runtime.agents import session as session_module
from gslcosim.runtime.agents.session import (
    REPEAT_QUESTION_AFTER_S,
    AgentJoined,
    AgentLost,
    AgentSession,
    CommandReceived,
    ObjectTransport,
)
from gslcosim.runtime.agents.validator import CommandValidator
from gslcosim.runtime.run_dir import MachineLog, read_machine_notes


class Line:
    """A link that notes what it carries."""

    def __init__(self, *, is_lossy):
        self.is_lossy = is_lossy
        self.carried = []
        self.n_repeats = 0
        self.n_handled = 0

    def brief(self, briefing, payload):
        self.carried.append((briefing, payload))

    def observe(self, observation, payload):
        self.carried.append((observation, payload))

    def repeat(self):
        self.n_repeats += 1

    def acknowledge(self, event):
        self.n_handled += 1

    def end(self, ending, payload):
        self.carried.append((ending, payload))


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(session_module.time, "monotonic", lambda: now[0])
    return now


def seen(tick, *, is_asked):
    observation = build_observation(tick, awaiting_command=is_asked)
    return observation, codec.encode(observation)


def question(tick):
    return seen(tick, is_asked=True)


def session_with(*, is_lossy=False):
    sent = []
    line = Line(is_lossy=is_lossy)
    session = AgentSession(
        "beetle", CommandValidator("beetle"), line, 10.0, deliver=sent.append, log_tail=lambda: "it hurts"
    )
    return session, line, sent


def hold(tick):
    return CommandReceived(agent="beetle", payload=codec.encode(Command(tick=tick, kind="hold")))


def test_an_answer_passes_with_its_bytes_and_leaves_a_trail(clock):
    session, line, sent = session_with()
    journal = []
    session.journal = journal.append
    session.observe(*question(3))
    assert session.is_pending
    assert not sent
    session.handle(hold(3))
    [command] = sent
    assert (command.port, command.message.kind) == ("command/beetle", "hold")
    assert codec.decode(Command, command.payload) == command.message
    assert session.trail.ticks.tolist() == [3]
    assert journal == [command.message]
    assert not session.is_pending
    assert line.n_handled == 1


def test_an_agent_that_owes_an_answer_for_too_long_fails_with_the_end_of_its_log(clock):
    session, _, sent = session_with()
    session.observe(*question(3))
    clock[0] += 9.9
    session.check_deadline()
    assert not sent
    clock[0] += 0.2
    session.check_deadline()
    assert [command.message.kind for command in sent] == ["failed"]
    assert session.validator.faults[0].text == "the agent did not answer within 10 s. The end of its log: it hurts"


def test_time_that_this_process_has_missed_is_not_the_agents(clock):
    """A supervisor that was stopped for a minute has not heard the answer that may have come meanwhile."""
    session, _, sent = session_with()
    session.extend_deadlines(60.0)
    assert not session.is_pending
    session.observe(*question(3))
    clock[0] += 65.0
    session.extend_deadlines(60.0)
    session.check_deadline()
    assert not sent
    clock[0] += 5.1
    session.check_deadline()
    assert [command.message.kind for command in sent] == ["failed"]


@pytest.mark.parametrize(("is_lossy", "n_repeats"), [(True, 2), (False, 0)])
def test_a_question_is_repeated_only_where_it_may_have_got_lost(clock, is_lossy, n_repeats):
    session, line, _ = session_with(is_lossy=is_lossy)
    session.observe(*question(3))
    for _ in range(2):
        clock[0] += 1.01 * REPEAT_QUESTION_AFTER_S
        session.check_deadline()
        session.check_deadline()
    assert line.n_repeats == n_repeats


def test_a_gone_agent_is_not_waited_for(clock):
    session, _, _ = session_with()
    assert session.is_awaited
    session.handle(AgentLost(agent="beetle", reason="it flew away."))
    assert not session.is_awaited


def test_an_agent_that_has_joined_is_ready(clock):
    session, _, _ = session_with()
    session.handle(AgentJoined(agent="beetle"))
    assert not session.is_awaited


class Late(Agent):
    """Answers to an observation that nobody asked about."""

    def __init__(self, briefing):
        pass

    def decide(self, observation):
        return Command(tick=observation.tick - 1, kind="hold")


class Broken(Agent):
    """Fails at its first look."""

    def __init__(self, briefing):
        pass

    def observe(self, observation):
        raise RuntimeError("no nose")

    def decide(self, observation):
        return Command(tick=observation.tick, kind="hold")


def session_of_object(agent_type):
    events, sent = [], []
    session = AgentSession(
        "beetle",
        CommandValidator("beetle"),
        ObjectTransport("beetle", agent_type, events.append),
        10.0,
        deliver=sent.append,
    )
    session.brief(None, b"")
    return session, events, sent


def test_an_object_answers_at_once_or_never():
    session, events, sent = session_of_object(Late)
    session.observe(*question(3))
    for event in events:
        session.handle(event)
    assert [command.message.kind for command in sent] == ["failed"]
    expected = "expected an answer to the observation of tick 3, was one to tick 2."
    assert [fault.text for fault in session.validator.faults] == [expected]


def test_an_object_that_raises_is_gone():
    session, events, sent = session_of_object(Broken)
    session.observe(*seen(2, is_asked=False))
    for event in events:
        session.handle(event)
    assert "RuntimeError: no nose" in session.validator.faults[0].text
    session.observe(*question(3))
    assert [command.message.kind for command in sent] == ["failed"]


def test_what_an_agent_took_and_did_wrong_is_noted_beside_the_recording_but_nothing_of_what_is_run_again(
    clock, tmp_path
):
    session, _, _ = session_with()
    session.machine = MachineLog(tmp_path)
    session.observe(*question(3))
    clock[0] += 0.25
    session.handle(hold(3))
    session.observe(*question(7))
    session.handle(CommandReceived(agent="beetle", payload=hold(7).payload, decided_in_s=0.0))
    session.observe(*question(9))
    session.handle(CommandReceived(agent="beetle", payload=b"nonsense", decided_in_s=0.5))
    notes = read_machine_notes(tmp_path)
    assert notes.decisions_ms == {"beetle": [(3, 250.0), (9, 500.0)]}
    assert [(tick, who) for tick, who, _ in notes.faults] == [(9, "agent beetle")]
    assert notes.faults[0][2] == session.validator.faults[0].text
