"""Python agents: their base class, the group that one process runs, and its connection to a run."""

import os
import queue
import sys
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import msgpack  # pyright: ignore[reportMissingTypeStubs]

from gslcosim.base.errors import GslCosimError, cut_contract_frames
from gslcosim.bus.interface import AGENT_VARIABLE, JOIN_VARIABLE, Bus, JoinData
from gslcosim.contract import codec, keys
from gslcosim.contract.length_prefix import prefix_length, read_frame
from gslcosim.contract.messages import Briefing, Command, Ending, Observation
from gslcosim.contract.version import check_contract, format_own_contract

# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack
_Event = tuple[str, bytes]
_LINK_LOST = "lost"


class Agent(ABC):
    """A search method. It is built with the briefing, receives every observation, and decides on request.

    It is independent of processes: the same object runs over Zenoh and inside the framework's own process.
    All randomness must come from `briefing.seed`, otherwise runs cannot be repeated.
    """

    @abstractmethod
    def __init__(self, briefing: Briefing) -> None:
        """Read the task, the bounds, the sensors and the seed."""

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
            cut_contract_frames(error)
            if len(self._members) == 1:
                raise
            traceback.print_exception(error)
            member.has_failed = True
            self._leave(member.name)


def is_behind_gateway() -> bool:
    """Return True if this process was started to speak frames on its standard input and output."""
    return AGENT_VARIABLE in os.environ and JOIN_VARIABLE not in os.environ


def run_over_gateway(agent_type: Callable[[Briefing], Agent]) -> None:
    """Run the agents that `GSLCOSIM_AGENT` names, until the run or the stream ends.

    Output that the agents print goes to the log: standard output is reserved for frames.
    """
    with os.fdopen(os.dup(1), "wb", buffering=0) as output, os.fdopen(os.dup(0), "rb") as source:
        os.dup2(2, 1)
        sys.stdout.flush()
        answer_frames(agent_type, os.environ[AGENT_VARIABLE].split(","), source, output)


def answer_frames(
    agent_type: Callable[[Briefing], Agent], names: Sequence[str], source: BinaryIO, output: BinaryIO
) -> None:
    """Answer observations that come in frames until the run ends or the frames do.

    Args:
        output: Where answers go, unbuffered.

    Raises:
        Exception: what an agent raised; a stream has no other sign that one of several has gone.
    """
    failures: list[str] = []
    group = AgentGroup(
        agent_type,
        names,
        send=lambda name, answer: _write_frame(output, _add_agent_name(name, answer) if len(names) > 1 else answer),
        leave=failures.append,
    )
    while not failures and (frame := read_frame(source)) is not None:
        fields: dict[str, Any] = _msgpack.unpackb(frame, use_list=False)
        kind = fields.pop("message", None)
        if kind == "Ending":
            group.end(codec.build_message(Ending, fields).reason)
            return
        if kind == "Briefing":
            briefing = codec.build_message(Briefing, fields)
            group.brief(briefing.agent, briefing)
        elif kind == "Observation":
            observation = codec.build_message(Observation, fields)
            group.observe(observation.agent, observation)
    if failures:
        sys.exit(f"Failed before the end of the run: {', '.join(failures)}.")
    group.end("the link to the run was lost")


def _write_frame(output: BinaryIO, payload: bytes) -> None:
    left = prefix_length(payload)
    while left:
        left = left[output.write(left) or 0 :]


def _add_agent_name(name: str, answer: bytes) -> bytes:
    return _msgpack.packb({**_msgpack.unpackb(answer, use_list=False), "agent": name})


def run(agent_type: Callable[[Briefing], Agent]) -> None:
    """Run the agents in the run named by the environment variable `GSLCOSIM_JOIN`, and return when the run is over.

    A process behind the gateway (`door: stdio`) flies the agents of `GSLCOSIM_AGENT` by frames instead.

    One agent is made for each that the process is to fly: mostly one, or all that name it with `process_of`.
    Exits with a message when the run cannot be joined, and with code 1 when one of several agents has failed.
    """
    if is_behind_gateway():
        run_over_gateway(agent_type)
        return
    _run_on_bus(lambda _: agent_type)


def run_free(agent_type: Callable[[Briefing, Callable[[Command], None]], Agent]) -> None:
    """Run the agents of a process in free mode: as `run` does over Zenoh, and they may also speak unasked.

    Args:
        agent_type: Makes an agent of its briefing and of what sends a command of it, from any thread.
    """

    def build_maker(bus: Bus) -> Callable[[Briefing], Agent]:
        def make(briefing: Briefing) -> Agent:
            def speak(command: Command) -> None:
                # This command may be the agent's first message to the run.
                told = command.model_copy(update={"contract": format_own_contract()})
                _send(bus, briefing.agent, codec.encode(told))

            return agent_type(briefing, speak)

        return make

    _run_on_bus(build_maker)


def _run_on_bus(build_maker: Callable[[Bus], Callable[[Briefing], Agent]]) -> None:
    from gslcosim.bus.zenoh_bus import ZenohBus

    try:
        join = JoinData.from_environment()
        with ZenohBus.open_member(join) as bus:
            events: queue.SimpleQueue[_Event] = queue.SimpleQueue()
            bus.on_disconnect(lambda: events.put((_LINK_LOST, b"")))
            failed = answer_observations(build_maker(bus), bus, join.agents or (join.name,), events)
    except GslCosimError as error:
        sys.exit(str(error))
    if failed:
        sys.exit(f"Failed before the end of the run: {', '.join(failed)}.")


def answer_observations(
    agent_type: Callable[[Briefing], Agent],
    bus: Bus,
    names: Sequence[str],
    events: "queue.SimpleQueue[_Event] | None" = None,
) -> tuple[str, ...]:
    """Connect agents to a bus and answer their observations until the run ends, the link is lost, or all have failed.

    Args:
        events: Where `("lost", b"")` is put when the link is lost.

    Returns:
        The names of those that have failed, if there are several; a single one's failure is raised.
    """
    inbox: queue.SimpleQueue[_Event] = events or queue.SimpleQueue()
    group = AgentGroup(
        agent_type,
        names,
        send=lambda name, answer: _send(bus, name, answer),
        leave=lambda name: bus.withdraw_alive(_build_liveliness_key(name)),
    )
    actions: dict[str, Callable[[bytes], None]] = {}
    endings = {keys.ending(name) for name in names}
    # An agent that does not override `observe` has no use for observations that await no command, except among several:
    # one that is asked is shown its observation once all others have come as far.
    is_asked_only = getattr(agent_type, "observe", None) is Agent.observe and len(names) == 1
    key_of_observation = keys.question if is_asked_only else keys.observation
    for name in names:
        actions[keys.briefing(name)] = lambda got, name=name: group.brief(name, codec.decode_trusted(Briefing, got))
        actions[key_of_observation(name)] = lambda got, name=name: group.observe(
            name, codec.decode_trusted(Observation, got)
        )
    for key in (*actions, *endings):
        bus.subscribe(key, lambda at, payload: inbox.put((at, payload)))
    for name in names:
        bus.declare_alive(_build_liveliness_key(name))
    while len(group.failed) < len(names):
        key, payload = inbox.get()
        if key == _LINK_LOST or key in endings:
            group.end(codec.decode_trusted(Ending, payload).reason if payload else "the link to the run was lost")
            break
        actions[key](payload)
    return group.failed


def _build_liveliness_key(name: str) -> str:
    return f"agents/{name}/alive"


def _send(bus: Bus, name: str, answer: bytes) -> None:
    bus.publish(keys.raw_command(name), answer, encoding=codec.get_encoding(Command), urgent=True)
