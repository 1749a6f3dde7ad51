"""Session of one agent in a run: its observations, deadlines and faults, and the commands of it that count."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command, Ending
from gslcosim.runtime.agents.transport import (
    AgentEvent,
    AgentJoined,
    AgentLost,
    AgentTransport,
    AnswerMissed,
    CommandReceived,
    CommandRefused,
    ObservationOrHead,
)
from gslcosim.runtime.agents.validator import CommandValidator, build_validator, get_agent_participant
from gslcosim.runtime.digest import HashChain
from gslcosim.runtime.machine_notes import MachineLog
from gslcosim.runtime.replay.snapshot import ObservationLog
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import ParticipantState, ParticipantStatus
from gslcosim.runtime.stepper import SentMessage
from gslcosim.scenario.models.scenario import AgentSpec

REPEAT_QUESTION_AFTER_S = 1.0


@dataclass
class AgentSession:
    """Agent of a run: its validator and its transport, with deadlines, log and statistics.

    Methods return the commands that count now, with their bytes; the holder of the session delivers them. `journal`
    gets each of them; `log_tail` returns the end of the agent's log; `observation_log` keeps the agent's observations
    where the run takes snapshots; `machine` notes decisions and faults where the run is recorded. Times are those of
    the monotonic clock [s].
    """

    agent: str
    validator: CommandValidator
    transport: AgentTransport
    answer_within_s: float
    journal: Callable[[Command], None] = lambda _: None
    log_tail: Callable[[], str] = lambda: ""
    observation_log: ObservationLog | None = None
    machine: MachineLog = field(default_factory=MachineLog)
    trail: HashChain = field(default_factory=HashChain)
    decisions_s: list[float] = field(default_factory=list[float])
    is_ready: bool = False
    last_tick: int = -1
    _n_faults_noted: int = 0
    _asked_at_s: float | None = None
    _repeated_at_s: float = 0.0

    @property
    def is_pending(self) -> bool:
        """True when simulated time may have to wait for the agent."""
        return self._asked_at_s is not None

    @property
    def is_awaited(self) -> bool:
        """True when the run cannot start without the agent; one that is known to be lost is not waited for."""
        return not (self.is_ready or self.validator.faults)

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Send the agent its briefing."""
        self.transport.brief(briefing, payload)

    def observe(self, observation: ObservationOrHead, payload: bytes) -> list[SentMessage]:
        """Send the agent an observation."""
        self.last_tick = observation.tick
        if self.observation_log is not None:
            self.observation_log.add(payload)
        commands = self.validator.on_observation(observation)
        if self.validator.pending and self._asked_at_s is None:
            self._asked_at_s = self._repeated_at_s = time.monotonic()
        passed = self._publish(commands)
        self.transport.observe(observation, payload)
        return passed

    def handle(self, event: AgentEvent) -> list[SentMessage]:
        """Take what the agent did."""
        match event:
            case AgentJoined():
                self.is_ready = True
                return []
            case CommandReceived() | CommandRefused():
                return self._handle_answer(event)
            case AnswerMissed(text=text):
                return self.mark_lost(text) if self.validator.pending else []
            case AgentLost(reason=reason):
                return self.mark_lost(reason)

    def mark_lost(self, reason: str) -> list[SentMessage]:
        """Record that the agent is lost."""
        words = self.log_tail()
        return self._publish(self.validator.on_lost(f"{reason} The end of its log: {words}" if words else reason))

    def check_deadline(self) -> list[SentMessage]:
        """Give the agent up where it has owed an answer for too long; repeat a question that may have got lost."""
        if self._asked_at_s is None:
            return []
        now_s = time.monotonic()
        if now_s - self._asked_at_s > self.answer_within_s:
            return self.mark_lost(f"the agent did not answer within {self.answer_within_s:g} s.")
        if self.transport.is_lossy and now_s - self._repeated_at_s > REPEAT_QUESTION_AFTER_S:
            self._repeated_at_s = now_s
            self.transport.repeat()
        return []

    def extend_deadlines(self, missed_s: float) -> None:
        """Let the agent have its time again that this process has missed [s]."""
        if self._asked_at_s is not None:
            self._asked_at_s = min(self._asked_at_s + missed_s, time.monotonic())

    def end(self, ending: Ending) -> None:
        """Send the agent the end of the run."""
        if self.observation_log is not None:
            self.observation_log.flush()
        self.machine.close()
        self.transport.end(ending, codec.encode(ending))

    def _handle_answer(self, event: CommandReceived | CommandRefused) -> list[SentMessage]:
        match event:
            case CommandReceived(payload=payload, decided_in_s=decided_in_s):
                commands = self.validator.on_answer(payload)
            case CommandRefused(text=text):
                commands, decided_in_s = self.validator.on_refusal(text), None
        if self._asked_at_s is not None:
            waited_s = time.monotonic() - self._asked_at_s
            self.decisions_s.append(waited_s if decided_in_s is None else decided_in_s)
            # What is run again was decided before.
            if decided_in_s != 0.0:
                asked_tick = commands[0].tick if commands else self.last_tick
                self.machine.decided(self.agent, asked_tick, self.decisions_s[-1])
        self.transport.acknowledge(event)
        return self._publish(commands)

    def _publish(self, commands: Iterable[Command]) -> list[SentMessage]:
        for fault in self.validator.faults[self._n_faults_noted :]:
            self.machine.failed(f"agent {fault.agent}", fault.tick, fault.text)
        self._n_faults_noted = len(self.validator.faults)
        passed: list[SentMessage] = []
        for command in commands:
            sent = SentMessage(keys.command(self.agent), command, codec.encode(command))
            self.trail.append(command.tick, sent.payload)
            self.journal(command)
            passed.append(sent)
        if passed:
            self._repeated_at_s = time.monotonic()
            self._asked_at_s = self._repeated_at_s if self.validator.pending else None
        return passed


def build_session(agent: AgentSpec, setup: RunSetup, transport: AgentTransport) -> AgentSession:
    """Return the session of an agent of a run."""
    run_dir = setup.run_dir
    return AgentSession(
        agent.name,
        build_validator(agent, setup.scenario, setup.past),
        transport,
        agent.answer_within_s,
        journal=lambda command: run_dir.log_command(agent.name, command),
        log_tail=lambda: run_dir.log_tail(get_agent_participant(agent.process)),
        observation_log=ObservationLog(run_dir, agent.name) if setup.scenario.snapshots is not None else None,
        machine=MachineLog(run_dir.path if setup.scenario.recording.enabled else None),
    )


def build_agent_statuses(sessions: Mapping[str, AgentSession]) -> list[ParticipantStatus]:
    """Return one moment of all agents."""
    return [
        ParticipantStatus(name=name, state=_get_state(session), tick=session.last_tick)
        for name, session in sessions.items()
    ]


def _get_state(session: AgentSession) -> ParticipantState:
    if session.is_awaited:
        return "joining"
    return "deciding" if session.is_pending else "waiting"
