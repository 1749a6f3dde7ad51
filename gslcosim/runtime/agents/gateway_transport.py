"""Agents behind the gateway: their processes, and the transport to each of them."""

import threading
from collections.abc import Container, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from typing_extensions import override

from gslcosim.base.files import ScratchFolder
from gslcosim.bus.interface import AGENT_VARIABLE
from gslcosim.contract.messages import Briefing, Ending
from gslcosim.contract.participant import get_agent_participant
from gslcosim.gateway.connections import EventKind, Listener, Stream, ThreadedConnection
from gslcosim.gateway.frame_codec import read_agent_name
from gslcosim.runtime.agents.loader import build_start_command
from gslcosim.runtime.agents.session import (
    AgentJoined,
    AgentLost,
    AgentTransport,
    CommandReceived,
    CommandRefused,
    EventSink,
    ObservationOrHead,
)
from gslcosim.runtime.network import Network, describe_absence
from gslcosim.runtime.processes.child_processes import EXIT_TIMEOUT_S, ChildProcesses
from gslcosim.runtime.processes.sandbox.selection import build_confinement
from gslcosim.runtime.processes.stop_detection import StopMonitor, describe_stop
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario.models.scenario import AgentSpec

# Two threads detect the ends of a process and of its stream; both together make one fault.
LOG_TAIL_WAIT_S = 0.3
# Its stream ends first where a launcher kills all that it has left; on a busy machine its own end takes a while.
_EXIT_WAIT_S = 5.0


@dataclass
class _AgentProcess:
    """Process of one or several agents; it has the name of the first."""

    spec: AgentSpec
    agents: tuple[str, ...]
    put: EventSink
    link: ThreadedConnection = field(init=False)
    listener: Listener | None = None
    is_open: bool = False
    refused_connection: str = ""
    _has_stopped_talking: threading.Event = field(default_factory=threading.Event)
    _has_exited: threading.Event = field(default_factory=threading.Event)
    _rest: str = ""
    _is_gone: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self.link = ThreadedConnection(self.spec.start.format, self._on_event)

    def exited(self, how: str) -> None:
        """Take note of the end of the process; its earlier messages come first."""
        self._has_exited.set()
        if self.is_open:
            self._has_stopped_talking.wait(LOG_TAIL_WAIT_S)
        self.report_end(f"the agent's process {how} before the end of the run.")

    def refuse(self, text: str) -> None:
        """Keep the reason why a connection was refused."""
        self.refused_connection = text

    def _on_event(self, kind: EventKind, data: bytes) -> None:
        if kind == "command":
            self._put_command(data)
        elif kind == "refused":
            self.put(CommandRefused(agent=self.spec.name, text=data.decode(errors="replace")))
        elif kind == "closed":
            self.report_end(f"the agent was given up: {data.decode()}")
        else:
            self._rest = data.decode()
            self._has_stopped_talking.set()
            if self.spec.start.attach or not self._has_exited.wait(_EXIT_WAIT_S):
                self.report_end("the agent closed its output before the end of the run.")

    # Frames of a process with several agents name the agent.
    def _put_command(self, payload: bytes) -> None:
        name = read_agent_name(payload)
        if name is None and len(self.agents) > 1:
            text = "Command: agent: expected one of the process's agents, was missing."
            self.put(CommandRefused(agent=self.spec.name, text=text))
        elif name is None or name in self.agents:
            self.put(CommandReceived(agent=name or self.spec.name, payload=payload))
        else:
            text = f"Command: agent: expected {' or '.join(self.agents)}, was {name[:80]!r}."
            self.put(CommandRefused(agent=self.spec.name, text=text))

    def report_end(self, text: str) -> None:
        """Report once that the process sends nothing any more."""
        with self._lock:
            if self._is_gone:
                return
            self._is_gone = True
        for addition in (self._rest, self.refused_connection):
            text = f"{text} {_end_sentence(addition)}".rstrip()
        for name in self.agents:
            self.put(AgentLost(agent=name, reason=text))


class GatewayTransport(AgentTransport):
    """Transport to one agent behind the gateway; agents of one process have one stream."""

    def __init__(self, process: _AgentProcess) -> None:
        self._process = process
        self._waiting: list[bytes] | None = []

    @override
    def brief(self, briefing: Briefing, payload: bytes) -> None:
        del briefing
        if self._waiting is None:
            return
        waiting, self._waiting = self._waiting, None
        self._process.link.send("Briefing", payload)
        for observation in waiting:
            self._process.link.send("Observation", observation)

    @override
    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        if self._process.spec.start.observations == "asked" and not observation.awaiting_command:
            return
        if self._waiting is None:
            self._process.link.send("Observation", payload)
        else:
            self._waiting.append(payload)

    @override
    def acknowledge(self, event: CommandReceived | CommandRefused) -> None:
        del event
        self._process.link.acknowledge()

    @override
    def end(self, ending: Ending, payload: bytes) -> None:
        del ending
        self._process.link.send("Ending", payload)
        self._process.link.end()

    @override
    def describe_absence(self) -> str:
        return f"{describe_absence()} {_end_sentence(self._process.refused_connection)}".rstrip()


class GatewayAgents:
    """Processes of all agents of a run behind the gateway. Their events are put from many threads.

    The agents that `without` names have none.
    """

    def __init__(
        self, setup: RunSetup, directory: Path, network: Network, put: EventSink, *, without: Container[str] = ()
    ) -> None:
        self._setup = setup
        self._directory = directory
        self._network = network
        self._put = put
        self._by_agent: dict[str, _AgentProcess] = {}
        specs = {agent.name: agent for agent in setup.scenario.agents}
        for process, agents in setup.scenario.agents_by_process().items():
            if specs[process].start.is_behind_gateway and process not in without:
                member = _AgentProcess(specs[process], agents, put)
                self._by_agent |= dict.fromkeys(agents, member)

    def __contains__(self, agent: str) -> bool:
        return agent in self._by_agent

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_agent)

    @contextmanager
    def open(self) -> Generator[None]:
        """Start every process, or write its join file, with nothing beside it; leaving the context ends all of them."""
        with (
            ScratchFolder.for_sockets() as sockets,
            ChildProcesses(self.exited) as children,
            StopMonitor(lambda: children.pids, self.stopped),
            closing(self),
        ):
            self.start(children, sockets.path)
            yield
            children.wait(EXIT_TIMEOUT_S)

    def start(self, children: ChildProcesses, socket_dir: Path) -> None:
        """Start every process, or write the join files of those that attach themselves."""
        for process in self._processes():
            self._start(process, children, socket_dir)

    def get_transport(self, agent: str) -> GatewayTransport:
        """Return the transport to an agent."""
        return GatewayTransport(self._by_agent[agent])

    def exited(self, process: str, code: int, how: str) -> bool:
        """Take note of a process's end, in words, on any thread; return whether it is one of these."""
        del code
        if (member := self._find(process)) is not None:
            member.exited(how)
        return member is not None

    def stopped(self, process: str) -> bool:
        """Take note, on any thread, that a process was stopped for too long; return whether it is one of these."""
        if (member := self._find(process)) is not None:
            member.report_end(f"the agent's process {describe_stop()}.")
        return member is not None

    def close(self) -> None:
        """End all streams, and admit no connection any more."""
        for process in self._processes():
            process.link.end()
            if process.listener is not None:
                process.listener.close()

    def _processes(self) -> list[_AgentProcess]:
        return [process for name, process in self._by_agent.items() if process.spec.name == name]

    def _find(self, process: str) -> _AgentProcess | None:
        return next((each for each in self._processes() if get_agent_participant(each.spec.name) == process), None)

    def _start(self, process: _AgentProcess, children: ChildProcesses, private_dir: Path) -> None:
        spec = process.spec
        listener = process.listener = self._listen(process, private_dir)
        if listener is not None:
            listener.admit(spec.start.format, lambda stream, _: self._open(process, stream), process.refuse)
        command = build_start_command(spec, self._directory)
        if command is None:
            self._write_join_file(process)
            return
        participant = get_agent_participant(spec.name)
        address = "" if listener is None else listener.address
        confinement = build_confinement(
            spec, command, self._setup, directory=self._directory, private_dir=private_dir, address=address
        )
        children.start_behind_gateway(
            participant,
            command,
            listener,
            lambda stream: self._open(process, stream),
            log=self._setup.run_dir.log(participant),
            variables={AGENT_VARIABLE: ",".join(process.agents)},
            cwd=self._directory,
            confinement=confinement,
        )

    def _write_join_file(self, process: _AgentProcess) -> None:
        spec, listener = process.spec, process.listener
        assert listener is not None
        fields = {"name": spec.name, "gateway": listener.address, "token": listener.token, "format": spec.start.format}
        agents = {"agents": process.agents} if len(process.agents) > 1 else {}
        self._network.write_join_file("agents", spec.name, {**fields, **agents}, self._setup.run_dir.path)

    def _listen(self, process: _AgentProcess, socket_dir: Path) -> Listener | None:
        start = process.spec.start
        if start.door == "tcp" and start.attach and (endpoint := self._network.public_endpoint):
            host = endpoint.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")[0]
            return Listener.open_tcp("0.0.0.0", public_name=host)
        # Addresses of sockets are short, agents' names may be long.
        return Listener.open_at(start.door, socket_dir / f"{list(self._by_agent).index(process.spec.name)}.sock")

    def _open(self, process: _AgentProcess, stream: Stream) -> None:
        process.is_open = True
        process.link.open(stream)
        for name in process.agents:
            self._put(AgentJoined(agent=name))


def _end_sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
