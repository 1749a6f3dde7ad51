"""Base class of Python agents, and the group of agents that one process runs."""

import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from gslcosim.contract import codec
from gslcosim.contract.messages import Briefing, Command, Observation
from gslcosim.contract.schema import check_contract, format_own_contract


class Agent(ABC):
    """A search method. It is made with the briefing, sees every observation, and decides when asked.

    Nothing here knows about processes: the same object flies over Zenoh and inside the framework's own process.
    All randomness must come from `briefing.seed`, otherwise runs cannot be repeated.
    """

    @abstractmethod
    def __init__(self, briefing: Briefing) -> None:
        """Read the mission, the bounds, the sensors and the seed."""

    def observe(self, observation: Observation) -> None:  # noqa: B027 - optional, not abstract
        """Take note of an observation; called for every tick, before `decide` where that is called too."""

    @abstractmethod
    def decide(self, observation: Observation) -> Command:
        """Return the command that answers an observation with `awaiting_command`; its tick must be the same."""

    def end(self, reason: str) -> None:  # noqa: B027 - optional, not abstract
        """Take note that the run is over."""


@dataclass
class _GroupMember:
    """Agent of a group, with the observations that it waits for and its last answer."""

    name: str
    briefing: Briefing | None = None
    agent: Agent | None = None
    waiting: dict[int, Observation] = field(default_factory=dict[int, Observation])
    newest_tick: int = -1
    seen_tick: int = -1
    answer: bytes | None = None
    has_answered: bool = False
    has_failed: bool = False

    def decide(self, observation: Observation) -> bytes | None:
        """Show the agent an observation; return its answer when it is asked."""
        assert self.agent is not None
        self.seen_tick, self.answer = observation.tick, None
        self.agent.observe(observation)
        if observation.awaiting_command:
            self.answer = codec.encode(self._answer(self.agent.decide(observation)))
        return self.answer

    def _answer(self, command: Command) -> Command:
        if self.has_answered:
            return command
        self.has_answered = True
        return command.model_copy(update={"contract": format_own_contract()})


class AgentGroup:
    """One or several agents of a run in one process, created from their briefings and asked in a fixed order.

    Observations are handed out tick by tick, and within a tick in the order of the names, so that agents which share
    what they know inside their process fly the same run again. For that, an observation waits until each of the
    others has come as far; they are sent together, so it does not wait long. A question that comes a second time does
    not wait: what it waited for was lost.

    Observations may arrive twice: the answer is then repeated, not decided again. An agent that fails among several
    leaves the others alone; a single agent's failure is raised.
    """

    def __init__(
        self,
        agent_type: Callable[[Briefing], Agent],
        names: Sequence[str],
        send: Callable[[str, bytes], None],
        leave: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Prepare a group.

        Args:
            agent_type: Makes an agent of its briefing.
            names: The agents, in the order of the scenario.
            send: Sends an agent's answer.
            leave: Receives the name of an agent that has failed and takes no part any more.
        """
        self._agent_type = agent_type
        self._members = {name: _GroupMember(name) for name in names}
        self._send = send
        self._leave = leave

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the agents that have failed."""
        return tuple(member.name for member in self._members.values() if member.has_failed)

    def brief(self, name: str, briefing: Briefing) -> None:
        """Take an agent's briefing; when all have theirs, the agents are made.

        Raises:
            ContractError: the run speaks another contract.
        """
        member = self._members[name]
        if member.briefing is not None:
            return
        check_contract(briefing.contract_version)
        member.briefing = briefing
        if all(member.briefing for member in self._members.values()):
            for member in self._members.values():
                self._try(member, lambda member=member: self._make(member))
            self._hand_out()

    def observe(self, name: str, observation: Observation) -> None:
        """Take an observation; hand out what can be, and send the answers."""
        member, tick = self._members[name], observation.tick
        if member.has_failed:
            return
        if tick <= member.seen_tick:
            if tick == member.seen_tick and member.answer is not None:
                self._send(name, member.answer)
            return
        has_come_twice = tick in member.waiting
        member.waiting[tick] = observation
        member.newest_tick = max(member.newest_tick, tick)
        self._hand_out(at_once_until=tick if has_come_twice else -1)

    def end(self, reason: str) -> None:
        """Send all agents the end of the run."""
        for member in self._flying():
            if member.agent is not None:
                self._try(member, lambda agent=member.agent: agent.end(reason))

    def _make(self, member: _GroupMember) -> None:
        assert member.briefing is not None
        member.agent = self._agent_type(member.briefing)

    def _hand_out(self, *, at_once_until: int = -1) -> None:
        if any(member.agent is None for member in self._flying()):
            return
        while ticks := [min(member.waiting) for member in self._flying() if member.waiting]:
            tick = min(ticks)
            if tick > at_once_until and any(member.newest_tick < tick for member in self._flying()):
                return
            for member in self._flying():
                observation = member.waiting.pop(tick, None)
                if observation is not None:
                    self._try(member, lambda member=member, observation=observation: self._decide(member, observation))

    def _decide(self, member: _GroupMember, observation: Observation) -> None:
        answer = member.decide(observation)
        if answer is not None:
            self._send(member.name, answer)

    def _flying(self) -> list[_GroupMember]:
        return [member for member in self._members.values() if not member.has_failed]

    def _try(self, member: _GroupMember, action: Callable[[], None]) -> None:
        try:
            action()
        except (Exception, SystemExit) as error:
            if len(self._members) == 1:
                raise
            traceback.print_exception(error)
            member.has_failed = True
            self._leave(member.name)
