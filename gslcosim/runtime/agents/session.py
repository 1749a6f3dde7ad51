"""Session of one agent in a run: transport of messages, observations, deadlines and faults, and its commands."""

import queue
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from typing_extensions import override

from gslcosim.agent_kit import Agent
from gslcosim.base.errors import cut_contract_frames
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command, Ending, Observation, Verdict
from gslcosim.contract.participant import get_agent_participant
from gslcosim.runtime.agents.validator import AgentFault, CommandValidator, build_validator
from gslcosim.runtime.digest import HashChain
from gslcosim.runtime.network import describe_absence
from gslcosim.runtime.participant_status import ParticipantStatus
from gslcosim.runtime.processes.stop_detection import PauseDetector
from gslcosim.runtime.replay.snapshot import ObservationLog
from gslcosim.runtime.run_dir import MachineLog
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.stepper import SentMessage
from gslcosim.scenario.models.scenario import AgentSpec

# An observation, or where its bytes alone are at hand, its head.
ObservationOrHead = Observation | codec.ObservationHead
# An agent that still decides after that is left to itself.
END_TIMEOUT_S = 2.0
REPEAT_QUESTION_AFTER_S = 1.0


@dataclass(frozen=True, kw_only=True)
class AgentJoined:
    """The agent has joined and can receive messages."""

    agent: str


@dataclass(frozen=True, kw_only=True)
class CommandReceived:
    """Bytes for the agent's validator; `decided_in_s` is what the decision took by the clock, where that is known."""

    agent: str
    payload: bytes
    decided_in_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class CommandRefused:
    """An agent sent something that is no command, and the reason."""

    agent: str
    text: str


@dataclass(frozen=True, kw_only=True)
class AnswerMissed:
    """The agent has finished with an observation; an answer that it still owes never comes."""

    agent: str
    text: str


@dataclass(frozen=True, kw_only=True)
class AgentLost:
    """The agent sends nothing any more, and the reason. This event comes once and last."""

    agent: str
    reason: str


AgentEvent = AgentJoined | CommandReceived | CommandRefused | AnswerMissed | AgentLost
EventSink = Callable[[AgentEvent], None]


class AgentTransport(Protocol):
    """Transport of messages to one agent; its answers come back as events, on any thread.

    A transport that `is_lossy` may lose a message, so that questions have to be repeated.
    Messages come with their canonical bytes; a transport uses either.
    """

    is_lossy: bool = False

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Send the agent its briefing."""

    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        """Send the agent an observation."""
        ...

    def repeat(self) -> None:
        """Send the briefing and the last question again; nothing where no message gets lost."""

    def acknowledge(self, event: CommandReceived | CommandRefused) -> None:
        """Take note that an answer has been judged, so that the agent may send more where it waits for that."""

    def end(self, ending: Ending, payload: bytes) -> None:
        """Send the agent the end of the run."""

    def describe_absence(self) -> str:
        """Return the fault of an agent that has not joined in time."""
        return describe_absence()


class ObjectTransport(AgentTransport):
    """Transport to an agent object in this process, which answers at once or never; an exception is a result."""

    def __init__(self, name: str, agent_type: type[Agent], put: EventSink) -> None:
        self._name = name
        self._agent_type = agent_type
        self._put = put
        self._agent: Agent | None = None

    @override
    def brief(self, briefing: Briefing, payload: bytes) -> None:
        del payload
        try:
            self._agent = self._agent_type(briefing)
        except (Exception, SystemExit) as error:  # whatever an agent does is a result of the run
            self._fail("the agent failed at its briefing", error)

    @override
    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        agent = self._agent
        if not isinstance(observation, Observation):
            observation = codec.decode_trusted(Observation, payload)
        if agent is None:
            return
        try:
            agent.observe(observation)
            if observation.awaiting_command:
                self._ask(agent, observation)
        except (Exception, SystemExit) as error:  # as above
            self._fail(f"the agent failed at tick {observation.tick}", error)

    @override
    def end(self, ending: Ending, payload: bytes) -> None:
        del payload
        if self._agent is None:
            return
        try:
            self._agent.end(ending.reason)
        except (Exception, SystemExit):  # the run is over
            return

    def _ask(self, agent: Agent, observation: Observation) -> None:
        asked_at_s = time.perf_counter()
        answer = agent.decide(observation)
        taken_s = time.perf_counter() - asked_at_s
        self._put(CommandReceived(agent=self._name, payload=codec.encode(answer), decided_in_s=taken_s))
        found = f"expected an answer to the observation of tick {observation.tick}, was one to tick {answer.tick}."
        self._put(AnswerMissed(agent=self._name, text=found))

    def _fail(self, text: str, error: BaseException) -> None:
        self._agent = None
        cut_contract_frames(error)
        trace = "".join(traceback.format_exception(error, limit=-1))
        self._put(AgentLost(agent=self._name, reason=f"{text}: {trace.strip()}"))


class WorkerThread:
    """Thread that does one task after another, for agents that are one process when they are not objects."""

    def __init__(self) -> None:
        self._tasks: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._has_begun = False

    def do(self, task: Callable[[], None]) -> None:
        """Queue a task for the thread."""
        if not self._has_begun:
            self._has_begun = True
            self._thread.start()
        self._tasks.put(task)

    def finish(self) -> None:
        """Wait until all tasks are done, at most `END_TIMEOUT_S`."""
        if self._has_begun:
            self._tasks.put(None)
            self._thread.join(END_TIMEOUT_S)

    def _work(self) -> None:
        while (task := self._tasks.get()) is not None:
            task()


class ThreadedTransport(AgentTransport):
    """Transport that lets an agent object decide on a worker's thread, while time goes on; see `AgentTransport`.

    An agent that is slower than time gets every observation, but decides on the latest question alone.
    """

    def __init__(self, link: ObjectTransport, worker: WorkerThread) -> None:
        self._link = link
        self._worker = worker
        self._newest_question = -1
        self._is_over = False

    @override
    def brief(self, briefing: Briefing, payload: bytes) -> None:
        self._worker.do(lambda: self._link.brief(briefing, payload))

    @override
    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        if observation.awaiting_command:
            self._newest_question = observation.tick
        self._worker.do(lambda: self._look(codec.decode(Observation, payload), payload))

    @override
    def end(self, ending: Ending, payload: bytes) -> None:
        self._is_over = True
        self._worker.do(lambda: self._link.end(ending, payload))
        self._worker.finish()

    def _look(self, observation: Observation, payload: bytes) -> None:
        if self._is_over:
            return
        if observation.awaiting_command and observation.tick < self._newest_question:
            observation = observation.model_copy(update={"awaiting_command": False})
        self._link.observe(observation, payload)


class SteppedTransport(AgentTransport):
    """Transport to an agent that the caller of a stepped run commands; it keeps the questions."""

    def __init__(self) -> None:
        # With a latency several observations may await their commands, the oldest first.
        self.questions: deque[Observation] = deque()

    @override
    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        if observation.awaiting_command:
            is_whole = isinstance(observation, Observation)
            self.questions.append(observation if is_whole else codec.decode(Observation, payload))

    @override
    def end(self, ending: Ending, payload: bytes) -> None:
        del ending, payload
        self.questions.clear()


@dataclass
class AgentSession:
    """Agent of a run: its validator and its transport, with deadlines, log and statistics.

    `deliver` and `journal` get each command that counts, the former with its bytes; `log_tail` returns the end of the
    agent's log; `observation_log` keeps the agent's observations where the run takes snapshots; `machine` notes
    decisions and faults where the run is recorded. Times are those of the monotonic clock [s].
    """

    agent: str
    validator: CommandValidator
    transport: AgentTransport
    answer_within_s: float
    deliver: Callable[[SentMessage], None] = lambda _: None
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

    def look(self) -> ParticipantStatus:
        """Return the agent's status; may be called on any thread."""
        asked_at_s = self._asked_at_s
        return ParticipantStatus(
            name=self.agent,
            state="joining" if self.is_awaited else "waiting" if asked_at_s is None else "deciding",
            tick=self.last_tick,
            occupied_s=None if asked_at_s is None else time.monotonic() - asked_at_s,
        )

    @property
    def is_pending(self) -> bool:
        """True when simulated time may have to wait for the agent."""
        return self._asked_at_s is not None

    @property
    def is_awaited(self) -> bool:
        """True when the run cannot start without the agent; a lost one is not waited for."""
        return not (self.is_ready or self.validator.faults)

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Send the agent its briefing."""
        self.transport.brief(briefing, payload)

    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        """Send the agent an observation."""
        self.last_tick = observation.tick
        if self.observation_log is not None:
            self.observation_log.add(payload)
        commands = self.validator.on_observation(observation)
        if self.validator.pending and self._asked_at_s is None:
            self._asked_at_s = self._repeated_at_s = time.monotonic()
        self._publish(commands)
        self.transport.observe(observation, payload)

    def handle(self, event: AgentEvent) -> None:
        """Handle an event of the agent."""
        match event:
            case AgentJoined():
                self.is_ready = True
            case CommandReceived() | CommandRefused():
                self._handle_answer(event)
            case AnswerMissed(text=text):
                if self.validator.pending:
                    self.mark_lost(text)
            case AgentLost(reason=reason):
                self.mark_lost(reason)

    def mark_lost(self, reason: str) -> None:
        """Record that the agent is lost."""
        words = self.log_tail()
        self._publish(self.validator.on_lost(f"{reason} The end of its log: {words}" if words else reason))

    def check_deadline(self) -> None:
        """Give the agent up where it has owed an answer for too long; repeat a question that may have got lost."""
        if self._asked_at_s is None:
            return
        now_s = time.monotonic()
        if now_s - self._asked_at_s > self.answer_within_s:
            self.mark_lost(f"the agent did not answer within {self.answer_within_s:g} s.")
        elif self.transport.is_lossy and now_s - self._repeated_at_s > REPEAT_QUESTION_AFTER_S:
            self._repeated_at_s = now_s
            self.transport.repeat()

    def extend_deadlines(self, missed_s: float) -> None:
        """Add the time [s] in which this process stood still to the agent's deadline."""
        if self._asked_at_s is not None:
            self._asked_at_s = min(self._asked_at_s + missed_s, time.monotonic())

    def end(self, ending: Ending) -> None:
        """Send the agent the end of the run."""
        if self.observation_log is not None:
            self.observation_log.flush()
        self.machine.close()
        self.transport.end(ending, codec.encode(ending))

    def _handle_answer(self, event: CommandReceived | CommandRefused) -> None:
        match event:
            case CommandReceived(payload=payload, decided_in_s=decided_in_s):
                commands = self.validator.on_answer(payload)
            case CommandRefused(text=text):
                commands, decided_in_s = self.validator.on_refusal(text), None
        if self._asked_at_s is not None:
            waited_s = time.monotonic() - self._asked_at_s
            self.decisions_s.append(waited_s if decided_in_s is None else decided_in_s)
            # A repeated command was decided before.
            if decided_in_s != 0.0:
                asked_tick = commands[0].tick if commands else self.last_tick
                self.machine.decided(self.agent, asked_tick, self.decisions_s[-1])
        self.transport.acknowledge(event)
        self._publish(commands)

    def _publish(self, commands: Sequence[Command]) -> None:
        for fault in self.validator.faults[self._n_faults_noted :]:
            self.machine.failed(f"agent {fault.agent}", fault.tick, fault.text)
        self._n_faults_noted = len(self.validator.faults)
        for command in commands:
            sent = SentMessage(keys.command(self.agent), command, codec.encode(command))
            self.trail.append(command.tick, sent.payload)
            self.journal(command)
            self.deliver(sent)
        if commands:
            self._repeated_at_s = time.monotonic()
            self._asked_at_s = self._repeated_at_s if self.validator.pending else None


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


class AgentSessions(dict[str, AgentSession]):
    """Sessions of all agents of a run, by agent.

    Args:
        events: Queue of their events, and of those of the run's host.
    """

    def __init__(self, events: "queue.SimpleQueue[Any]") -> None:
        super().__init__()
        self.events = events
        self._pauses = PauseDetector()

    @property
    def are_pending(self) -> bool:
        """True when simulated time may have to wait for an agent."""
        return any(session.is_pending for session in self.values())

    @property
    def awaited(self) -> list[str]:
        """Agents without which the run cannot start."""
        return [name for name, session in self.items() if session.is_awaited]

    @property
    def faults(self) -> list[AgentFault]:
        """Faults of all agents, by tick."""
        found = (fault for session in self.values() for fault in session.validator.faults)
        return sorted(found, key=lambda fault: fault.tick)

    @property
    def trails(self) -> dict[str, HashChain]:
        """Chains of the commands that have passed, by port."""
        return {keys.command(name): session.trail for name, session in self.items()}

    def look(self) -> list[ParticipantStatus]:
        """Return the status of all agents."""
        return [session.look() for session in self.values()]

    def check_deadlines(self) -> None:
        """Give up each agent that has owed an answer for too long; repeat questions that may have got lost."""
        for session in self.values():
            session.check_deadline()

    def renew_deadlines(self) -> float:
        """Extend all deadlines by the time [s] in which this process stood still since the last call, and return it."""
        missed_s = self._pauses.missed_s(time.monotonic())
        if missed_s > 0:
            for session in self.values():
                session.extend_deadlines(missed_s)
        return missed_s

    def end(self, verdict: Verdict | None) -> None:
        """Send all agents the end of the run."""
        if verdict is None:
            ending = Ending(tick=0, reason="the run was ended")
        else:
            ending = Ending(tick=verdict.tick, reason=verdict.end_reason)
        for session in self.values():
            session.end(ending)
