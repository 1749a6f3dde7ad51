"""Guests: the agents of a run behind the gateway, with their processes, their links, and what they say as events."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from gslcosim.gateway.framing import agent_of_payload
from gslcosim.gateway.link import EventKind, Link
from gslcosim.gateway.listener import Listener
from gslcosim.gateway.streams import PipeStream, Stream
from gslcosim.runtime.agents.door import door_name
from gslcosim.runtime.agents.starting import start_command
from gslcosim.runtime.joining import JOIN_LIMIT_S, Network
from gslcosim.runtime.processes import Children, exit_text
from gslcosim.runtime.setup import Setup
from gslcosim.scenario.models.scenario import AgentSpec

AGENT_VARIABLE = "GSLCOSIM_AGENT"
GATEWAY_VARIABLE = "GSLCOSIM_GATEWAY"
TOKEN_VARIABLE = "GSLCOSIM_TOKEN"
# A process's end and its stream's end are seen by two threads; what they say together is one fault.
LAST_WORDS_S = 0.3
READY, COMMAND, REFUSED, GONE = "guest ready", "guest command", "guest refused", "guest gone"
Put = Callable[[str, str, bytes], None]


@dataclass
class _Guest:
    """One process with the agents it flies; it has the name of the first."""

    spec: AgentSpec
    agents: tuple[str, ...]
    put: Put
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

    def exited(self, code: int) -> None:
        """Take note of the end of the process; what it had said before comes first."""
        self._has_exited.set()
        if self.is_open:
            self._has_stopped_talking.wait(LAST_WORDS_S)
        self._tell_gone(f"the agent's process {exit_text(code)} before the end of the run.")

    def _on_event(self, kind: EventKind, data: bytes) -> None:
        if kind == "command":
            self._put_command(data)
        elif kind == "refused":
            self.put(REFUSED, self.spec.name, data)
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
            self.put(REFUSED, self.spec.name, b"Command: agent: expected one of the process's agents, was missing.")
        elif name is None or name in self.agents:
            self.put(COMMAND, name or self.spec.name, payload)
        else:
            text = f"Command: agent: expected {' or '.join(self.agents)}, was {name[:80]!r}."
            self.put(REFUSED, self.spec.name, text.encode(errors="replace"))

    def _tell_gone(self, text: str) -> None:
        with self._lock:
            if self._is_gone:
                return
            self._is_gone = True
        for addition in (self._rest, self.refused_connection):
            text = f"{text} {_sentence(addition)}".rstrip()
        for name in self.agents:
            self.put(GONE, name, text.encode())


class Guests:
    """All agents of a run behind the gateway.

    Their events are put from many threads, in order for each agent: `READY`; `COMMAND` with bytes for the door;
    `REFUSED` with the reason why a frame is not one; `GONE` with the reason, once and last. Whoever handles a
    `COMMAND` or `REFUSED` then calls `handled`.
    """

    def __init__(self, setup: Setup, directory: Path, network: Network, put: Put) -> None:
        self._setup = setup
        self._directory = directory
        self._network = network
        self._put = put
        self._told: dict[str, list[tuple[str, bytes]] | None] = {}
        self._by_agent: dict[str, _Guest] = {}
        specs = {agent.name: agent for agent in setup.scenario.agents}
        for process, agents in setup.scenario.agents_by_process().items():
            if specs[process].start.is_behind_gateway:
                guest = _Guest(specs[process], agents, put)
                self._by_agent |= dict.fromkeys(agents, guest)
                self._told |= {name: [] for name in agents}

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
                self._start_piped(guest, children)
            else:
                self._start_connecting(guest, children, socket_dir)

    def brief(self, agent: str, payload: bytes) -> None:
        """Send an agent its briefing, and what has waited for it."""
        waiting = self._told[agent]
        if waiting is None:
            return
        self._told[agent] = None
        link = self._by_agent[agent].link
        link.tell("Briefing", payload)
        for name, message in waiting:
            link.tell(name, message)

    def observe(self, agent: str, payload: bytes, *, is_question: bool) -> None:
        """Send an agent an observation, after its briefing; only questions where it wants no others."""
        guest = self._by_agent[agent]
        if guest.spec.start.observations == "asked" and not is_question:
            return
        waiting = self._told[agent]
        if waiting is None:
            guest.link.tell("Observation", payload)
        else:
            waiting.append(("Observation", payload))

    def handled(self, agent: str) -> None:
        """Take note that a command or a refusal of an agent has been handled."""
        self._by_agent[agent].link.handled()

    def exited(self, process: str, code: int) -> bool:
        """Take note of a process's end, on any thread; return whether it is one of these."""
        for guest in self._processes():
            if door_name(guest.spec.name) == process:
                guest.exited(code)
                return True
        return False

    def absence_text(self, agent: str) -> str:
        """Return what to say of an agent that has not come in time."""
        note = self._by_agent[agent].refused_connection if agent in self._by_agent else ""
        return f"expected to join within {JOIN_LIMIT_S:g} s, did not. {_sentence(note)}".rstrip()

    def with_last_words(self, agent: str, text: str) -> str:
        """Return a text about an agent with the end of its log."""
        words = self._setup.run_dir.last_words(door_name(self._by_agent[agent].spec.name))
        return f"{text} Its last words: {words}" if words else text

    def end(self, payload: bytes) -> None:
        """Tell all agents the end of the run, and end their streams."""
        for guest in self._processes():
            guest.link.tell("Ending", payload)
        self.close()

    def close(self) -> None:
        """End all streams, and let nobody in any more."""
        for guest in self._processes():
            guest.link.end()
            if guest.listener is not None:
                guest.listener.close()

    def _processes(self) -> list[_Guest]:
        return [guest for name, guest in self._by_agent.items() if guest.spec.name == name]

    def _start_piped(self, guest: _Guest, children: Children) -> None:
        name = guest.spec.name
        pipes = children.start_piped(
            door_name(name),
            start_command(guest.spec, self._directory) or [],
            variables=self._variables(guest),
            log=self._setup.run_dir.log(door_name(name)),
            cwd=self._directory,
        )
        self._open(guest, PipeStream(*pipes))

    def _start_connecting(self, guest: _Guest, children: Children, socket_dir: Path) -> None:
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
        )

    def _listener(self, guest: _Guest, socket_dir: Path) -> Listener:
        if guest.spec.start.door == "unix":
            return Listener.open_unix(socket_dir / f"{guest.spec.name}.sock")
        if guest.spec.start.attach and (endpoint := self._network.public_endpoint):
            return Listener.open_tcp("0.0.0.0", public_name=_host_of(endpoint))
        return Listener.open_tcp()

    def _variables(self, guest: _Guest) -> dict[str, str]:
        return {AGENT_VARIABLE: ",".join(guest.agents)}

    def _open(self, guest: _Guest, stream: Stream) -> None:
        guest.is_open = True
        guest.link.open(stream)
        for name in guest.agents:
            self._put(READY, name, b"")


def _host_of(endpoint: str) -> str:
    return endpoint.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")[0]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
