"""Session of a check with an agent: plays the scripted world and records everything that happens."""

import queue
import time
from dataclasses import dataclass, field
from typing import Any

import msgpack
from typing_extensions import override

from gslcosim.base.ticks import NS_PER_S
from gslcosim.contract.messages import Command, Ending, Message
from gslcosim.methods.card import Needs
from gslcosim.runtime.agents.session import (
    REPEAT_QUESTION_AFTER_S,
    AgentJoined,
    AgentLost,
    AgentSession,
    CommandReceived,
    CommandRefused,
)
from gslcosim.runtime.agents.validator import BELIEF_PERIOD_S, CommandValidator
from gslcosim_conformance.answers import Answer, build_refused_answer, format_command, read_answer
from gslcosim_conformance.scripted_world import (
    AGENT,
    TICK_NS,
    ScriptedWorld,
    add_unknown_fields,
    build_briefing,
    iter_ticks,
)
from gslcosim_conformance.transcript import SessionLimits, SessionScript, Transcript
from gslcosim_conformance.transports import (
    AgentAbandoned,
    AgentExited,
    CheckTransport,
    QueryReceived,
    TransportEvent,
    UnexpectedMessage,
)

MAX_SURPLUS_MESSAGES = 100
MAX_MESSAGES = 2000
MAX_WRONG_ANSWERS = 3
QUESTION_REPEAT_PERIOD = 3
END_REASON = "time_limit"
BELIEF_PERIOD_TICKS = BELIEF_PERIOD_S * NS_PER_S // TICK_NS


@dataclass
class Question:
    """An observation that awaited a command, when it was sent, how often, and when it was no longer waited for."""

    tick: int
    sent_at_s: float
    n_sent: int = 1
    closed_at_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class ReceivedAnswer:
    """Something the agent sent, when, which question was open then, and how a run's validator judges it."""

    answer: Answer
    at_s: float
    open_tick: int | None
    fault: str = ""


@dataclass
class AgentTranscript(Transcript):
    """All that happened in a session with an agent."""

    joined_at_s: float | None = None
    joins_by_start: bool = False
    unsubscribed_keys: tuple[str, ...] = ()
    foreign_subscriptions: tuple[str, ...] = ()
    unexpected_messages: list[str] = field(default_factory=list[str])
    queries: list[str] = field(default_factory=list[str])
    briefed_at_s: float | None = None
    sent_ticks: set[int] = field(default_factory=set[int])
    questions: list[Question] = field(default_factory=list[Question])
    arrivals: list[ReceivedAnswer] = field(default_factory=list[ReceivedAnswer])
    n_arrivals: int = 0
    left_at_s: float | None = None
    left_how: str = ""
    exited_at_s: float | None = None
    is_abandoned: bool = False

    @property
    @override
    def title(self) -> str:
        return f"the flight '{self.script.name}'"

    def answers(self) -> dict[int, Command]:
        """Return the commands by tick; what one says of its contract does not count."""
        return {tick: command.model_copy(update={"contract": None}) for tick, command in self.commands().items()}

    @override
    def describe_question(self, tick: int) -> str:
        return f"Observation, tick {tick}, awaiting_command true"

    @override
    def format_answer(self, tick: int) -> str:
        command = self.commands().get(tick)
        return f"Command {format_command(command)}" if command else "nothing"

    def answers_to(self, question: Question) -> list[ReceivedAnswer]:
        """Return the valid commands with a question's tick; none if the first came only when it was no longer open."""
        found = [a for a in self.arrivals if a.answer.command and a.answer.tick == question.tick]
        found = [arrival for arrival in found if arrival.at_s >= question.sent_at_s]
        return found if found and found[0].open_tick == question.tick else []

    def commands(self) -> dict[int, Command]:
        """Return the first valid command for each question that has one."""
        found = {question.tick: self.answers_to(question) for question in self.questions}
        return {tick: arrivals[0].answer.command for tick, arrivals in found.items() if arrivals}  # type: ignore[misc]

    @property
    def n_surplus(self) -> int:
        """Number of messages that came unasked."""
        return self.n_arrivals - sum(question.n_sent for question in self.questions)


class ScriptedSession:
    """Session that plays one script with one start of an agent."""

    def __init__(
        self, transport: CheckTransport, script: SessionScript, limits: SessionLimits, needs: Needs | None = None
    ) -> None:
        self._transport = transport
        self._limits = limits
        self._began = time.monotonic()
        self._needs = needs or Needs()
        self._world = ScriptedWorld(script.seed, self._needs)
        validator = CommandValidator(AGENT, belief_every_ticks=BELIEF_PERIOD_TICKS)
        self._session = AgentSession(AGENT, validator, transport, answer_within_s=limits.answer_s)
        self._open_tick: int | None = None
        self._transcript = AgentTranscript(script, joins_by_start=transport.joins_by_start)

    def play(self) -> AgentTranscript:
        """Play the script from the agent's start to its end; nothing of the agent is left when this returns."""
        transcript = self._transcript
        try:
            self._transport.start()
            self._await(lambda: transcript.joined_at_s is not None, self._limits.join_s)
            if transcript.joined_at_s is not None:
                self._fly()
                self._end()
        finally:
            transcript.log_tail = self._transport.stop()
            transcript.leftover_processes = self._transport.leftover_processes
        return transcript

    def _fly(self) -> None:
        transcript = self._transcript
        transcript.unsubscribed_keys = self._transport.unsubscribed_keys()
        transcript.briefed_at_s = self._now()
        briefing = build_briefing(transcript.script.seed, self._needs)
        self._session.brief(briefing, self._payload(briefing))
        # Over Zenoh the keys of an agent have no order among each other.
        self._await(lambda: not self._transport.is_lossy, self._limits.settle_s)
        if transcript.script.variation != "ending at once":
            for tick, is_asked in iter_ticks():
                if self._is_hopeless():
                    break
                self._observe(tick, is_asked=is_asked)
        if transcript.script.variation == "plain":
            self._await(lambda: False, self._limits.settle_s)
        transcript.foreign_subscriptions = self._transport.foreign_subscriptions()

    def _end(self) -> None:
        transcript = self._transcript
        if self._is_flooded():
            return
        if not self._is_gone():
            transcript.end_sent_at_s = self._now()
            if transcript.script.variation == "lost link":
                self._transport.cut()
            else:
                ending = Ending(tick=max(transcript.sent_ticks, default=0), reason=END_REASON)
                self._transport.end(ending, self._payload(ending))
            limit_s = transcript.script.exit_within_s(self._limits)
            self._await(lambda: transcript.exited_at_s is not None, limit_s)
        elif transcript.exited_at_s is None:
            self._await(lambda: transcript.exited_at_s is not None, self._limits.settle_s)

    def _observe(self, tick: int, *, is_asked: bool) -> None:
        transcript = self._transcript
        observation = self._world.observe(tick, is_asked=is_asked)
        if is_asked:
            transcript.questions.append(Question(tick, self._now()))
            self._open_tick = tick
        transcript.sent_ticks.add(tick)
        self._session.observe(observation, self._payload(observation))
        if not is_asked:
            self._await(lambda: True, 0.0)
            return
        self._await_answer(transcript.questions[-1])
        if transcript.script.variation == "repeats" and len(transcript.questions) % QUESTION_REPEAT_PERIOD == 0:
            self._repeat()
        self._open_tick, transcript.questions[-1].closed_at_s = None, self._now()
        if answers := transcript.answers_to(transcript.questions[-1]):
            self._world.obey(answers[0].answer.command)  # type: ignore[arg-type]

    def _repeat(self) -> None:
        question = self._transcript.questions[-1]
        if self._transcript.answers_to(question):
            question.n_sent = len(self._transcript.answers_to(question))
            self._send_again()
            self._await_answer(question)

    # What a run does when a question may have got lost: briefing and observation come again.
    def _send_again(self) -> None:
        self._transcript.questions[-1].n_sent += 1
        self._transport.repeat()

    # Twice the limit, to distinguish a late answer from none. Where something wrong has come instead, a run does not
    # wait
    # either; the right answer might still follow at once.
    def _await_answer(self, question: Question) -> None:
        transcript, settle_s = self._transcript, self._limits.settle_s
        n_wanted = question.n_sent

        def is_settled() -> bool:
            if len(transcript.answers_to(question)) >= n_wanted:
                return True
            wrong = [arrival for arrival in transcript.arrivals[-3:] if self._is_instead(arrival, question)]
            return bool(wrong) and self._now() - wrong[-1].at_s > settle_s

        deadline = self._now() + 2 * self._limits.answer_s
        while True:
            rest_s = deadline - self._now()
            self._await(is_settled, min(rest_s, REPEAT_QUESTION_AFTER_S) if self._transport.is_lossy else rest_s)
            if is_settled() or self._now() >= deadline or self._is_over():
                return
            self._send_again()

    def _is_instead(self, arrival: ReceivedAnswer, question: Question) -> bool:
        is_unasked = arrival.answer.command is not None and arrival.answer.tick in self._transcript.sent_ticks
        return arrival.open_tick == question.tick and not is_unasked

    # Handles what comes until the condition holds, the agent is gone, or the time is over.
    def _await(self, condition: Any, limit_s: float) -> None:
        deadline = self._now() + limit_s
        while True:
            while not self._transport.events.empty():
                self._handle(self._transport.events.get())
            rest_s = deadline - self._now()
            if condition() or rest_s <= 0 or self._is_over():
                return
            try:
                self._handle(self._transport.events.get(timeout=min(rest_s, 0.05)))
            except queue.Empty:
                continue

    def _handle(self, event: TransportEvent) -> None:
        transcript = self._transcript
        match event:
            case CommandReceived(payload=payload):
                self._record_answer(read_answer(payload), event)
            case CommandRefused(text=text):
                self._record_answer(build_refused_answer(text), event)
            case AgentJoined():
                transcript.joined_at_s = transcript.joined_at_s or self._now()
            case AgentLost(reason=reason):
                self._note_end(reason, is_given_up=False)
            case AgentAbandoned(reason):
                self._note_end(reason, is_given_up=True)
            case AgentExited(exit_code):
                transcript.exited_at_s, transcript.exit_code = self._now(), exit_code
            case UnexpectedMessage(text) if len(transcript.unexpected_messages) < MAX_SURPLUS_MESSAGES:
                transcript.unexpected_messages.append(text)
            case QueryReceived(key) if len(transcript.queries) < MAX_SURPLUS_MESSAGES:
                transcript.queries.append(key)
            case _:
                return

    def _note_end(self, reason: str, *, is_given_up: bool) -> None:
        if self._transcript.left_at_s is None:
            self._transcript.left_at_s, self._transcript.left_how = self._now(), reason
            self._transcript.is_abandoned = is_given_up

    def _record_answer(self, answer: Answer, event: CommandReceived | CommandRefused) -> None:
        transcript, faults = self._transcript, self._session.validator.faults
        transcript.n_arrivals += 1
        n_faults = len(faults)
        self._session.handle(event)
        fault = faults[-1].text if len(faults) > n_faults else ""
        if len(transcript.arrivals) < MAX_MESSAGES:
            arrival = ReceivedAnswer(answer=answer, at_s=self._now(), open_tick=self._open_tick, fault=fault)
            transcript.arrivals.append(arrival)

    # As a run sends it, apart from what the script's variation adds or leaves out.
    def _payload(self, message: Message) -> bytes:
        variation = self._transcript.script.variation
        fields = message.model_dump(exclude_defaults=variation == "optional fields")
        payload: Any = msgpack.packb(
            add_unknown_fields(fields) if variation == "unknown fields" else fields, use_bin_type=True
        )
        return payload

    def _is_gone(self) -> bool:
        return self._transcript.exited_at_s is not None or self._transcript.left_at_s is not None

    def _is_over(self) -> bool:
        transcript = self._transcript
        has_left = transcript.left_at_s is not None and transcript.end_sent_at_s is None
        is_left_behind = has_left and self._now() - (transcript.left_at_s or 0.0) > self._limits.settle_s
        return transcript.exited_at_s is not None or is_left_behind or self._is_flooded()

    def _is_flooded(self) -> bool:
        return self._transcript.n_surplus > MAX_MESSAGES // 2

    # Nothing new is learned by asking an agent further that does not answer, or answers wrongly again and again.
    def _is_hopeless(self) -> bool:
        transcript = self._transcript
        if self._is_gone() or self._is_flooded():
            return True
        unanswered = [question for question in transcript.questions if not transcript.answers_to(question)]
        closed = [(question.sent_at_s, question.closed_at_s or 0.0) for question in transcript.questions]
        is_slow = any(closed_s - sent_s > self._limits.answer_s for sent_s, closed_s in closed)
        return len(unanswered) >= MAX_WRONG_ANSWERS or is_slow

    def _now(self) -> float:
        return time.monotonic() - self._began
