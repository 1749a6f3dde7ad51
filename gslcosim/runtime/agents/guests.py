"""The agents of a run behind the gateway: their processes, and the link to each of them."""

import threading
from dataclasses import dataclass, field
from pathlib import Path

from gslcosim.agent_kit.framed import AGENT_VARIABLE
from gslcosim.contract.messages import Briefing, Ending
from gslcosim.gateway.framing import agent_of_payload
from gslcosim.gateway.link import EventKind, Link
from gslcosim.gateway.listener import Listener
from gslcosim.gateway.streams import PipeStream, Stream
from gslcosim.runtime.agents.door import door_name
from gslcosim.runtime.agents.events import AgentGone, AgentJoined, CommandCame, CommandRefused, PutEvent
from gslcosim.runtime.agents.links import Seen
from gslcosim.runtime.agents.starting import start_command
from gslcosim.runtime.joining import JOIN_LIMIT_S, Network
from gslcosim.runtime.processes import Children
from gslcosim.runtime.sandbox.confining import confinement_of
from gslcosim.runtime.sandbox.launching import Confinement
from gslcosim.runtime.setup import Setup
from gslcosim.runtime.stops import stop_text
from gslcosim.scenario.models.scenario import AgentSpec

GATEWAY_VARIABLE = "GSLCOSIM_GATEWAY"
TOKEN_VARIABLE = "GSLCOSIM_TOKEN"
# A process's end and its stream's end are seen by two threads; what they say together is one fault.
LAST_WORDS_S = 0.3


@dataclass
class _GuestProcess:
    """One process with the agents it flies; it has the name of the first."""

    spec: AgentSpec
    agents: tuple[str, ...]
    put: PutEvent
    link: Link = field(init=False)
    listener: Listener | None = None
    is_open: bool = False
    refused_connection: str = ""
    _has_stopped_talking: threading.Event = field(default_factory=threading.Event)
    _has_exited: threading.Event = field(default_factory=threading.Event)
    _rest: str = ""
    _is_gone: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self.link = Link(self.spec.start.format, self._on_event)

    def exited(self, how: str) -> None:
        """Take note of the end of the process; what it had said before comes first."""
        self._has_exited.set()
        if self.is_open:
            self._has_stopped_talking.wait(LAST_WORDS_S)
        self._tell_gone(f"the agent's process {how} before the end of the run.")

    def was_stopped(self) -> None:
        """Take note that the process was stopped for too long, and is being killed."""
        self._tell_gone(f"the agent's process {stop_text()}.")

    def _on_event(self, kind: EventKind, data: bytes) -> None:
        if kind == "command":
            self._put_command(data)
        elif kind == "refused":
            self.put(CommandRefused(agent=self.spec.name, text=data.decode(errors="replace")))
        elif kind == "closed":
            self._tell_gone(f"the agent was given up: {data.decode()}")
        else:
            self._rest = data.decode()
            self._has_stopped_talking.set()
            if self.spec.start.attach or not self._has_exited.wait(LAST_WORDS_S):
                self._tell_gone("the agent closed its output before the end of the run.")

    # Where a process flies several agents its frames say which of them speaks.
    def _put_command(self, payload: bytes) -> None:
        name = agent_of_payload(payload)
        if name is None and len(self.agents) > 1:
            text = "Command: agent: expected one of the process's agents, was missing."
            self.put(CommandRefused(agent=self.spec.name, text=text))
        elif name is None or name in self.agents:
            self.put(CommandCame(agent=name or self.spec.name, payload=payload))
        else:
            text = f"Command: agent: expected {' or '.join(self.agents)}, was {name[:80]!r}."
            self.put(CommandRefused(agent=self.spec.name, text=text))

    def _tell_gone(self, text: str) -> None:
        with self._lock:
            if self._is_gone:
                return
            self._is_gone = True
        for addition in (self._rest, self.refused_connection):
            text = f"{text} {_sentence(addition)}".rstrip()
        for name in self.agents:
            self.put(AgentGone(agent=name, reason=text))


class GatewayLink:
    """The link to one agent behind the gateway; agents of one process share its stream."""

    may_lose = False

    def __init__(self, process: _GuestProcess) -> None:
        self._process = process
        self._waiting: list[bytes] | None = []

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Send the briefing, then what has waited for it; see `AgentLink`."""
        del briefing
        if self._waiting is None:
            return
        waiting, self._waiting = self._waiting, None
        self._process.link.tell("Briefing", payload)
        for observation in waiting:
            self._process.link.tell("Observation", observation)

    def observe(self, observation: Seen, payload: bytes) -> None:
        """Send an observation, after the briefing; only questions where the agent wants no others; see `AgentLink`."""
        if self._process.spec.start.observations == "asked" and not observation.awaiting_command:
            return
        if self._waiting is None:
            self._process.link.tell("Observation", payload)
        else:
            self._waiting.append(payload)

    def repeat(self) -> None:
        """Do nothing: a stream loses nothing; see `AgentLink`."""

    def handled(self, event: CommandCame | CommandRefused) -> None:
        """Let the next frame come; see `AgentLink`."""
        del event
        self._process.link.handled()

    def end(self, ending: Ending, payload: bytes) -> None:
        """Tell the process the end of the run, and end its stream; see `AgentLink`."""
        del ending
        self._process.link.tell("Ending", payload)
        self._process.link.end()


class Guests:
    """The processes of all agents of a run behind the gateway. Their events are put from many threads."""

    def __init__(self, setup: Setup, directory: Path, network: Network, put: PutEvent) -> None:
        self._setup = setup
        self._directory = directory
        self._network = network
        self._put = put
        self._by_agent: dict[str, _GuestProcess] = {}
        specs = {agent.name: agent for agent in setup.scenario.agents}
        for process, agents in setup.scenario.agents_by_process().items():
            if specs[process].start.is_behind_gateway:
                guest = _GuestProcess(specs[process], agents, put)
                self._by_agent |= dict.fromkeys(agents, guest)

    def __contains__(self, agent: str) -> bool:
        return agent in self._by_agent

    def start(self, children: Children, socket_dir: Path) -> None:
        """Start every process, or write the join files of those that attach themselves.

        Args:
            children: What the processes become part of.
            socket_dir: A private folder for unix sockets.

        Raises:
            GslCosimError: a command cannot be started, or an address not be listened on.
        """
        for guest in self._processes():
            if guest.spec.start.door == "stdio":
                self._start_piped(guest, children, socket_dir)
            else:
                self._start_connecting(guest, children, socket_dir)

    def link_of(self, agent: str) -> GatewayLink:
        """Return a link to an agent."""
        return GatewayLink(self._by_agent[agent])

    def exited(self, process: str, code: int, how: str) -> bool:
        """Take note of a process's end, in words, on any thread; return whether it is one of these."""
        del code
        for guest in self._processes():
            if door_name(guest.spec.name) == process:
                guest.exited(how)
                return True
        return False

    def stopped(self, process: str) -> bool:
        """Take note, on any thread, that a process was stopped for too long; return whether it is one of these."""
        for guest in self._processes():
            if door_name(guest.spec.name) == process:
                guest.was_stopped()
                return True
        return False

    def absence_text(self, agent: str) -> str:
        """Return what to say of an agent, behind the gateway or not, that has not come in time."""
        note = self._by_agent[agent].refused_connection if agent in self._by_agent else ""
        return f"{absence_text()} {_sentence(note)}".rstrip()

    def close(self) -> None:
        """End all streams, and let nobody in any more."""
        for guest in self._processes():
            guest.link.end()
            if guest.listener is not None:
                guest.listener.close()

    def _processes(self) -> list[_GuestProcess]:
        return [guest for name, guest in self._by_agent.items() if guest.spec.name == name]

    def _start_piped(self, guest: _GuestProcess, children: Children, private_dir: Path) -> None:
        name = guest.spec.name
        command = start_command(guest.spec, self._directory) or []
        pipes = children.start_piped(
            door_name(name),
            command,
            variables=self._variables(guest),
            log=self._setup.run_dir.log(door_name(name)),
            cwd=self._directory,
            confinement=self._confinement(guest, command, private_dir),
        )
        self._open(guest, PipeStream(*pipes))

    def _start_connecting(self, guest: _GuestProcess, children: Children, socket_dir: Path) -> None:
        name = guest.spec.name
        listener = guest.listener = self._listener(guest, socket_dir)
        listener.admit(
            guest.spec.start.format,
            lambda stream, _: self._open(guest, stream),
            lambda text: setattr(guest, "refused_connection", text),
        )
        command = start_command(guest.spec, self._directory)
        if command is None:
            fields = {
                "name": name,
                "gateway": listener.address,
                "token": listener.token,
                "format": guest.spec.start.format,
                **({"agents": guest.agents} if len(guest.agents) > 1 else {}),
            }
            self._network.write_join_file("agents", name, fields, self._setup.run_dir.path)
            return
        children.start_guest(
            door_name(name),
            command,
            variables=self._variables(guest) | {GATEWAY_VARIABLE: listener.address, TOKEN_VARIABLE: listener.token},
            log=self._setup.run_dir.log(door_name(name)),
            cwd=self._directory,
            confinement=self._confinement(guest, command, socket_dir, listener.address),
        )

    def _confinement(
        self, guest: _GuestProcess, command: list[str], private_dir: Path, address: str = ""
    ) -> Confinement:
        kind, _, place = address.partition(":")
        return confinement_of(
            guest.spec,
            command,
            self._setup,
            directory=self._directory,
            private_dir=private_dir,
            sockets=[Path(place)] if kind == "unix" else (),
            tcp_port=int(place.rpartition(":")[2]) if kind == "tcp" else None,
        )

    def _listener(self, guest: _GuestProcess, socket_dir: Path) -> Listener:
        if guest.spec.start.door == "unix":
            # Addresses of sockets are short, agents' names may be long.
            return Listener.open_unix(socket_dir / f"{list(self._by_agent).index(guest.spec.name)}.sock")
        if guest.spec.start.attach and (endpoint := self._network.public_endpoint):
            return Listener.open_tcp("0.0.0.0", public_name=_host_of(endpoint))
        return Listener.open_tcp()

    def _variables(self, guest: _GuestProcess) -> dict[str, str]:
        return {AGENT_VARIABLE: ",".join(guest.agents)}

    def _open(self, guest: _GuestProcess, stream: Stream) -> None:
        guest.is_open = True
        guest.link.open(stream)
        for name in guest.agents:
            self._put(AgentJoined(agent=name))


def absence_text() -> str:
    """Return what to say of a participant that has not come in time."""
    return f"expected to join within {JOIN_LIMIT_S:g} s, did not."


def _host_of(endpoint: str) -> str:
    return endpoint.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")[0]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
