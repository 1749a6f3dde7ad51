"""Transport of messages to and from one agent: interface, events, and agents that are objects in this process."""

import queue
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from gslcosim.agent_kit import Agent
from gslcosim.contract import codec
from gslcosim.contract.messages import Briefing, Ending, Observation


@dataclass(frozen=True, kw_only=True)
class AgentJoined:
    """The agent can be spoken to."""

    agent: str


@dataclass(frozen=True, kw_only=True)
class CommandReceived:
    """Bytes for the agent's validator; `decided_in_s` is what the decision took by the clock, where that is known."""

    agent: str
    payload: bytes
    decided_in_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class CommandRefused:
    """Something came that is no command, and why."""

    agent: str
    text: str


@dataclass(frozen=True, kw_only=True)
class AnswerMissed:
    """The agent has said all that it says to an observation; what it still owes then never comes."""

    agent: str
    text: str


@dataclass(frozen=True, kw_only=True)
class AgentLost:
    """The agent says nothing any more, and why. It comes once and last."""

    agent: str
    reason: str


AgentEvent = AgentJoined | CommandReceived | CommandRefused | AnswerMissed | AgentLost
EventSink = Callable[[AgentEvent], None]


# An observation, or where its bytes alone are at hand, its head.
ObservationOrHead = Observation | codec.ObservationHead


class AgentTransport(Protocol):
    """Transport of messages to one agent; its answers come back as events, on any thread.

    `is_lossy` says that a message may get lost on its way, so that questions have to be repeated.
    Messages come with their canonical bytes; a link uses what it needs.
    """

    is_lossy: bool

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Send the agent its briefing."""
        ...

    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        """Send the agent an observation."""
        ...

    def repeat(self) -> None:
        """Send the briefing and the last question again."""
        ...

    def acknowledge(self, event: CommandReceived | CommandRefused) -> None:
        """Take note that what the agent said has been judged, so that it may say more."""
        ...

    def end(self, ending: Ending, payload: bytes) -> None:
        """Send the agent the end of the run."""
        ...


class ObjectTransport:
    """Transport to an agent object in this process: it answers at once or never; whatever it raises is a result."""

    is_lossy = False

    def __init__(self, name: str, agent_type: type[Agent], put: EventSink) -> None:
        self._name = name
        self._agent_type = agent_type
        self._put = put
        self._agent: Agent | None = None

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Make the agent; see `AgentTransport`."""
        del payload
        try:
            self._agent = self._agent_type(briefing)
        except (Exception, SystemExit):  # whatever an agent does is a result of the run
            self._fail("the agent failed at its briefing")

    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        """Let the agent look, and decide where it is asked; see `AgentTransport`."""
        agent = self._agent
        if not isinstance(observation, Observation):
            observation = codec.decode_trusted(Observation, payload)
        if agent is None:
            return
        try:
            agent.observe(observation)
            if observation.awaiting_command:
                self._ask(agent, observation)
        except (Exception, SystemExit):  # as above
            self._fail(f"the agent failed at tick {observation.tick}")

    def repeat(self) -> None:
        """Do nothing: no message gets lost; see `AgentTransport`."""

    def acknowledge(self, event: CommandReceived | CommandRefused) -> None:
        """Do nothing: an object waits until it is asked; see `AgentTransport`."""

    def end(self, ending: Ending, payload: bytes) -> None:
        """Send it to the agent; see `AgentTransport`."""
        del payload
        if self._agent is None:
            return
        try:
            self._agent.end(ending.reason)
        except (Exception, SystemExit):  # the run is over; nothing an agent does now counts
            return

    def _ask(self, agent: Agent, observation: Observation) -> None:
        asked_at_s = time.perf_counter()
        answer = agent.decide(observation)
        taken_s = time.perf_counter() - asked_at_s
        self._put(CommandReceived(agent=self._name, payload=codec.encode(answer), decided_in_s=taken_s))
        found = f"expected an answer to the observation of tick {observation.tick}, was one to tick {answer.tick}."
        self._put(AnswerMissed(agent=self._name, text=found))

    def _fail(self, text: str) -> None:
        self._agent = None
        self._put(AgentLost(agent=self._name, reason=f"{text}: {traceback.format_exc(limit=-1).strip()}"))


# An agent that still thinks when the run is over is left to itself.
END_TIMEOUT_S = 2.0


class WorkerThread:
    """A thread that does one thing after another; agents of one process share it, as they share a process elsewhere."""

    def __init__(self) -> None:
        self._tasks: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._has_begun = False

    def do(self, task: Callable[[], None]) -> None:
        """Let the thread do something after all that it was given before."""
        if not self._has_begun:
            self._has_begun = True
            self._thread.start()
        self._tasks.put(task)

    def finish(self) -> None:
        """Wait until all is done, but not for ever."""
        if self._has_begun:
            self._tasks.put(None)
            self._thread.join(END_TIMEOUT_S)

    def _work(self) -> None:
        while (task := self._tasks.get()) is not None:
            task()


class ThreadedTransport:
    """Transport that lets an agent object decide on a worker's thread, while time goes on; see `AgentTransport`.

    An agent that is slower than time sees every observation, but of the questions it is asked the last one alone.
    """

    is_lossy = False

    def __init__(self, link: ObjectTransport, worker: WorkerThread) -> None:
        self._link = link
        self._worker = worker
        self._newest_question = -1
        self._is_over = False

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Let the agent be made; see `AgentTransport`."""
        self._worker.do(lambda: self._link.brief(briefing, payload))

    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        """Let the agent look, and decide unless there is something newer by then; see `AgentTransport`."""
        if observation.awaiting_command:
            self._newest_question = observation.tick
        self._worker.do(lambda: self._look(codec.decode(Observation, payload), payload))

    def repeat(self) -> None:
        """Do nothing: no message gets lost; see `AgentTransport`."""

    def acknowledge(self, event: CommandReceived | CommandRefused) -> None:
        """Do nothing: it says at most one thing to each observation; see `AgentTransport`."""

    def end(self, ending: Ending, payload: bytes) -> None:
        """Send the agent the end after its present work, and wait a moment for that; see `AgentTransport`."""
        self._is_over = True
        self._worker.do(lambda: self._link.end(ending, payload))
        self._worker.finish()

    def _look(self, observation: Observation, payload: bytes) -> None:
        if self._is_over:
            return
        if observation.awaiting_command and observation.tick < self._newest_question:
            observation = observation.model_copy(update={"awaiting_command": False})
        self._link.observe(observation, payload)
