"""What a link to an agent can do, and the link to an agent that is an object in this process."""

import time
import traceback
from typing import Protocol

from gslcosim.agent_kit import Agent
from gslcosim.contract import codec
from gslcosim.contract.messages import Briefing, Ending, Observation
from gslcosim.runtime.agents.events import AgentGone, AnswerMissed, CommandCame, CommandRefused, PutEvent

# An observation, or where its bytes alone are at hand, its head.
Seen = Observation | codec.ObservationHead


class AgentLink(Protocol):
    """Carries messages to one agent; what the agent does comes back as events, on any thread.

    `may_lose` says that a message may get lost on its way, so that questions have to be repeated.
    Messages come with their canonical bytes; a link uses what it needs.
    """

    may_lose: bool

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Send the agent its briefing."""
        ...

    def observe(self, observation: Seen, payload: bytes) -> None:
        """Send the agent an observation."""
        ...

    def repeat(self) -> None:
        """Send the briefing and the last question again."""
        ...

    def handled(self, event: CommandCame | CommandRefused) -> None:
        """Take note that what the agent said has been judged, so that it may say more."""
        ...

    def end(self, ending: Ending, payload: bytes) -> None:
        """Tell the agent that the run is over."""
        ...


class ObjectLink:
    """An agent that is an object in this process. It answers at once or never; whatever it raises is a result."""

    may_lose = False

    def __init__(self, name: str, agent_type: type[Agent], put: PutEvent) -> None:
        self._name = name
        self._agent_type = agent_type
        self._put = put
        self._agent: Agent | None = None

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Make the agent; see `AgentLink`."""
        del payload
        try:
            self._agent = self._agent_type(briefing)
        except (Exception, SystemExit):  # whatever an agent does is a result of the run
            self._fail("the agent failed at its briefing")

    def observe(self, observation: Seen, payload: bytes) -> None:
        """Let the agent look, and decide where it is asked; see `AgentLink`."""
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
        """Do nothing: no message gets lost; see `AgentLink`."""

    def handled(self, event: CommandCame | CommandRefused) -> None:
        """Do nothing: an object waits until it is asked; see `AgentLink`."""

    def end(self, ending: Ending, payload: bytes) -> None:
        """Tell the agent; see `AgentLink`."""
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
        self._put(CommandCame(agent=self._name, payload=codec.encode(answer), decided_in_s=taken_s))
        found = f"expected an answer to the observation of tick {observation.tick}, was one to tick {answer.tick}."
        self._put(AnswerMissed(agent=self._name, text=found))

    def _fail(self, text: str) -> None:
        self._agent = None
        self._put(AgentGone(agent=self._name, reason=f"{text}: {traceback.format_exc(limit=-1).strip()}"))
