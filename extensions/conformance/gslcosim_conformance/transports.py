"""Transports of a check: an agent's process over Zenoh or the gateway, its events, and its orphans."""

import contextlib
import ctypes
import os
import queue
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

from typing_extensions import override

from gslcosim.base.errors import UsageError
from gslcosim.base.files import ScratchFolder
from gslcosim.bus.interface import AGENT_VARIABLE, JoinData
from gslcosim.bus.zenoh_bus import AgentAccount, generate_password
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Ending, Message, Observation
from gslcosim.gateway.connections import EventKind, Listener, Stream, ThreadedConnection
from gslcosim.gateway.frame_codec import FrameFormat
from gslcosim.methods.card import Needs, find_card_beside
from gslcosim.runtime.agents.loader import resolve_command
from gslcosim.runtime.agents.session import (
    AgentEvent,
    AgentJoined,
    AgentLost,
    AgentTransport,
    CommandReceived,
    CommandRefused,
    ObservationOrHead,
)
from gslcosim.runtime.processes.child_processes import ChildProcesses
from gslcosim_conformance.audit_router import AuditRouter
from gslcosim_conformance.scripted_world import AGENT, OTHER_AGENT

MARK_VARIABLE = "GSLCOSIM_CHECK"
_PR_SET_CHILD_SUBREAPER = 36
_MAX_COMMAND_SHOWN = 80
_PROC = Path("/proc")
# Several checks may share this process: each finds its own by the mark, and one alone those without any, too.
_LOCK = threading.Lock()
_ACTIVE: set[str] = set()
TransportKind = Literal["zenoh", "stdio", "tcp", "unix"]
N_LOG_TAIL_LINES = 6
_NAMESPACE = "gsl/check"
_KEYS_BY_MESSAGE = {Briefing: keys.briefing, Observation: keys.observation, Ending: keys.ending}
# An agent listens to the first or to the second.
_OBSERVATION, _QUESTION = keys.observation(AGENT), keys.question(AGENT)
# What there is in a run that an agent must not see.
_FORBIDDEN_KEYS = (
    keys.BODIES,
    keys.SAMPLES,
    keys.FILAMENTS,
    keys.SCORE,
    keys.VERDICT,
    keys.command(AGENT),
    keys.observation(OTHER_AGENT),
    keys.raw_command(OTHER_AGENT),
)


class OrphanProcesses:
    """Processes that one start of an agent leaves behind.

    A process whose parent ends becomes a child of the nearest ancestor that asks for such. While an agent lives this
    process asks. A mark in the agent's environment, which its descendants inherit, distinguishes them from others.
    """

    def __init__(self, mark: str) -> None:
        self.variables = {MARK_VARIABLE: mark}
        self._mark = f"{MARK_VARIABLE}={mark}".encode()
        self._before: frozenset[int] = frozenset()

    @staticmethod
    def is_possible() -> bool:
        """Return whether this system shows it."""
        return sys.platform == "linux"

    def begin(self) -> None:
        """Ask for descendants that lose their parents; to be called before the agent starts."""
        with _LOCK:
            self._before = frozenset(_list_children())
            _ACTIVE.add(self._mark.decode())
            _set_subreaper(is_asking=True)

    def end(self) -> tuple[str, ...]:
        """End what is left of the agent after its process and its group have ended; return it in words."""
        found: list[str] = []
        while left := self._left():
            for pid in left:
                found.append(f"{_read_command_line(pid)} (process {pid})")
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)
                with contextlib.suppress(ChildProcessError):
                    os.waitpid(pid, 0)
        with _LOCK:
            _ACTIVE.discard(self._mark.decode())
            _set_subreaper(is_asking=bool(_ACTIVE))
        return tuple(found)

    def _left(self) -> list[int]:
        return [pid for pid in _list_children() if self._is_mine(pid)]

    def _is_mine(self, pid: int) -> bool:
        try:
            variables = (_PROC / str(pid) / "environ").read_bytes().split(b"\0")
        except OSError:
            return False
        if self._mark in variables:
            return True
        is_marked = any(variable.startswith(MARK_VARIABLE.encode()) for variable in variables)
        return not is_marked and len(_ACTIVE) == 1 and pid not in self._before and not _is_in_this_session(pid)


# An agent starts in a session of its own, and no process returns to an older one: what is in this process's session
# was started by another of its threads.
def _is_in_this_session(pid: int) -> bool:
    try:
        return os.getsid(pid) == os.getsid(0)
    except ProcessLookupError:
        return False


# Living ones only: what is dead does nothing any more, and its parent's record of it may be somebody else's to read.
def _list_children() -> list[int]:
    found: list[int] = []
    for folder in _PROC.glob("[0-9]*"):
        try:
            state, parent = (folder / "stat").read_text(errors="replace").rpartition(")")[2].split()[:2]
        except (OSError, ValueError):
            continue
        if int(parent) == os.getpid() and state not in "ZX":
            found.append(int(folder.name))
    return found


def _read_command_line(pid: int) -> str:
    try:
        words = (_PROC / str(pid) / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
    except OSError:
        words = ""
    return words if len(words) <= _MAX_COMMAND_SHOWN else f"{words[: _MAX_COMMAND_SHOWN - 3]}..."


def _set_subreaper(*, is_asking: bool) -> None:
    if OrphanProcesses.is_possible():
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, int(is_asking), 0, 0, 0)


@dataclass(frozen=True)
class AgentExited:
    """The agent's process has ended."""

    exit_code: int


@dataclass(frozen=True)
class AgentAbandoned:
    """The link has given the agent up, and why."""

    reason: str


@dataclass(frozen=True)
class UnexpectedMessage:
    """The agent wrote something where it must not."""

    text: str


@dataclass(frozen=True)
class QueryReceived:
    """The agent put a question to the bus; nobody answers any."""

    key: str


TransportEvent = AgentEvent | AgentExited | AgentAbandoned | UnexpectedMessage | QueryReceived


@dataclass(frozen=True, kw_only=True)
class ConnectionSpec:
    """Start and connection of an agent: its command line, its transport, and for the gateway format and choice."""

    command: tuple[str, ...]
    transport: TransportKind = "zenoh"
    format: FrameFormat = "msgpack"
    observations: Literal["all", "asked"] = "all"
    directory: Path = field(default_factory=Path.cwd)

    def check(self) -> None:
        """Check that there is a program to start."""
        program = self.command[0] if self.command else ""
        if not program or shutil.which(program, path=None if "/" not in program else str(self.directory)) is None:
            beside = self.directory / program
            if "/" in program and shutil.which(str(beside)) is not None:
                return
            raise UsageError(
                f"expected an agent's command that can be started, was {program!r}.\nFolder: {self.directory}"
            )

    def needs(self) -> Needs:
        """Return what the method card beside the agent's program says that it needs; nothing where there is no card."""
        for word in self.command:
            program = self.directory / word
            card = find_card_beside(program) if program.is_file() else None
            if card is not None:
                return card.needs
        return Needs()


class CheckTransport(AgentTransport, Protocol):
    """One start of an agent, and the transport to it. `events` holds what it does, in order.

    Payloads need not be those of a run: a check may add to them. `repeat` sends briefing and last question again,
    whatever the transport; `joins_by_start` says that an agent joins by being started, without a word of its own;
    `leftover_processes`, after `stop`, are processes that had outlived the agent.
    """

    events: "queue.SimpleQueue[TransportEvent]"
    joins_by_start: bool
    leftover_processes: tuple[str, ...]

    def start(self) -> None:
        """Start the agent's process."""
        ...

    def unsubscribed_keys(self) -> tuple[str, ...]:
        """Return which of its own keys the agent did not listen to when it joined; none where there are no keys."""
        return ()

    def foreign_subscriptions(self) -> tuple[str, ...]:
        """Return which keys of others the agent listens to; none where there is nothing to overhear."""
        return ()

    def cut(self) -> None:
        """End the link without a word."""
        ...

    def stop(self) -> str:
        """End whatever is left of the agent; return the end of its log."""
        ...


def open_transport(connection: ConnectionSpec) -> CheckTransport:
    """Return a wire to an agent that is yet to be started."""
    return ZenohCheckTransport(connection) if connection.transport == "zenoh" else GatewayCheckTransport(connection)


class CheckedProcess:
    """Process under check, as all transports have it: a private folder, its end as an event, its orphans."""

    def __init__(self, connection: ConnectionSpec) -> None:
        self.connection = connection
        self.events: queue.SimpleQueue[TransportEvent] = queue.SimpleQueue()
        self._scratch = ScratchFolder.for_sockets("check")
        self.folder = self._scratch.path
        self.log = self.folder / "log"
        self.children = ChildProcesses(lambda _, code, __: self.events.put(AgentExited(code)), are_foreign=True)
        self.orphans = OrphanProcesses(str(self.folder))
        self.leftover_processes: tuple[str, ...] = ()
        self._listener: Listener | None = None

    def start_behind_gateway(
        self,
        name: str,
        variables: Mapping[str, str],
        on_stream: Callable[[Stream], None],
        on_refusal: Callable[[str], None],
    ) -> None:
        """Start the process with pipes to it, or with a listener that it connects to.

        Args:
            variables: What it finds in its environment, beside the way to the listener.
            on_stream: Gets the pipes, or each connection whose first frame is right.
            on_refusal: Gets what is wrong with each other connection.
        """
        self.orphans.begin()
        connection, variables = self.connection, {**variables, **self.orphans.variables}
        listener = self._listener = Listener.open_at(connection.transport, self.folder / "gateway.sock")
        if listener is not None:
            listener.admit(connection.format, lambda stream, _: on_stream(stream), on_refusal)
        self.children.start_behind_gateway(
            name, self.command(), listener, on_stream, variables=variables, log=self.log, cwd=connection.directory
        )

    def command(self) -> list[str]:
        """Return the command line, its program looked for in the folder of the check."""
        return resolve_command(self.connection.command, self.connection.directory)

    def end_process(self) -> str:
        """End the process with all that it leaves behind; return the end of its log."""
        if self._listener is not None:
            self._listener.close()
        self.children.end()
        self.leftover_processes = self.orphans.end()
        lines = self.log.read_text(errors="replace").splitlines() if self.log.exists() else []
        self._scratch.close()
        return "\n".join(line[:200] for line in lines if line.strip()[:1] not in ("", "^", "~"))[
            -N_LOG_TAIL_LINES * 200 :
        ]


class ZenohCheckTransport(CheckedProcess, CheckTransport):
    """An agent over Zenoh, with a router of its own that lets it do what it wants and sees it."""

    is_lossy = True
    joins_by_start = False

    def __init__(self, connection: ConnectionSpec) -> None:
        super().__init__(connection)
        self._user = AgentAccount(agent=AGENT, password=generate_password())
        self._endpoint = f"unixsock-stream/{self.folder}/router.sock"
        self._router: AuditRouter | None = None
        self._unheard: tuple[str, ...] = ()
        self._sent: dict[str, bytes] = {}
        self._question: bytes | None = None

    @override
    def start(self) -> None:
        router = self._router = AuditRouter.open(endpoint=self._endpoint, agent=self._user, secrets_dir=self.folder)
        for key in (*(key(AGENT) for key in _KEYS_BY_MESSAGE.values()), _QUESTION, *_FORBIDDEN_KEYS):
            router.offer(_to_absolute_key(key))
        router.watch(
            on_put=self._on_put,
            on_question=lambda key, _: self.events.put(QueryReceived(_to_relative_key(key))),
            on_alive=self._on_alive,
        )
        join = JoinData(
            name=AGENT,
            endpoint=self._endpoint,
            namespace=_NAMESPACE,
            user=self._user.user,
            password=self._user.password,
        )
        self.orphans.begin()
        self.children.start(
            AGENT,
            self.command(),
            join=join,
            log=self.log,
            cwd=self.connection.directory,
            variables=self.orphans.variables,
        )

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Publish the briefing; see `AgentTransport`."""
        self._publish(type(briefing), payload)

    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        """Publish an observation; see `AgentTransport`."""
        self._publish(Observation, payload)
        self._question = payload if observation.awaiting_command else None
        self._ask_again()

    @override
    def repeat(self) -> None:
        for message_type in (Briefing, Observation):
            self._publish(message_type, self._sent[message_type.__name__])
        self._ask_again()

    def end(self, ending: Ending, payload: bytes) -> None:
        """Publish the end; see `AgentTransport`."""
        self._publish(type(ending), payload)

    @override
    def unsubscribed_keys(self) -> tuple[str, ...]:
        return self._unheard

    @override
    def foreign_subscriptions(self) -> tuple[str, ...]:
        return tuple(key for key in _FORBIDDEN_KEYS if self._opened().is_read(_to_absolute_key(key)))

    @override
    def cut(self) -> None:
        self._opened().close()

    @override
    def stop(self) -> str:
        last_words = self.end_process()
        if self._router is not None:
            self._router.close()
        return last_words

    def _publish(self, message_type: type[Message], payload: bytes) -> None:
        self._sent[message_type.__name__] = payload
        key = _to_absolute_key(_KEYS_BY_MESSAGE[message_type](AGENT))
        self._opened().publish(key, payload, encoding=codec.get_encoding(message_type))

    def _ask_again(self) -> None:
        if self._question is not None:
            self._opened().publish(
                _to_absolute_key(_QUESTION), self._question, encoding=codec.get_encoding(Observation)
            )

    def _opened(self) -> AuditRouter:
        if self._router is None:
            raise RuntimeError("expected a wire that has been started")
        return self._router

    def _on_put(self, key: str, payload: bytes) -> None:
        if key == _to_absolute_key(keys.raw_command(AGENT)):
            self.events.put(CommandReceived(agent=AGENT, payload=payload))
        else:
            self.events.put(UnexpectedMessage(_to_relative_key(key)))

    def _on_alive(self, key: str, is_alive: bool) -> None:  # noqa: FBT001 - the interface of the bus
        if key == _to_absolute_key(f"agents/{AGENT}/alive"):
            if is_alive:
                own = (key(AGENT) for key in _KEYS_BY_MESSAGE.values())
                unheard = tuple(key for key in own if not self._has_subscriber(key))
                self._unheard = tuple(
                    key for key in unheard if key != _OBSERVATION or not self._has_subscriber(_QUESTION)
                )
                self.events.put(AgentJoined(agent=AGENT))
            else:
                self.events.put(AgentLost(agent=AGENT, reason="its liveliness token vanished"))
        elif is_alive:
            self.events.put(UnexpectedMessage(f"liveliness token {_to_relative_key(key)}"))

    def _has_subscriber(self, key: str) -> bool:
        return self._opened().is_read(_to_absolute_key(key))


class GatewayCheckTransport(CheckedProcess, CheckTransport):
    """An agent behind the gateway, over the very link that a run uses."""

    def __init__(self, connection: ConnectionSpec) -> None:
        super().__init__(connection)
        self.joins_by_start = connection.transport == "stdio"
        self._link = ThreadedConnection(connection.format, self._on_event)
        self._sent: dict[str, bytes] = {}

    @override
    def start(self) -> None:
        self.start_behind_gateway(AGENT, {AGENT_VARIABLE: AGENT}, self._open, self._on_refused_connection)

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Send the agent its briefing; see `AgentTransport`."""
        self._send(type(briefing), payload)

    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        """Send the agent an observation, if it wants that kind; see `AgentTransport`."""
        if self.connection.observations == "all" or observation.awaiting_command:
            self._send(Observation, payload)

    @override
    def repeat(self) -> None:
        for message_type in (Briefing, Observation):
            self._send(message_type, self._sent[message_type.__name__])

    def end(self, ending: Ending, payload: bytes) -> None:
        """Send the agent the end of the run, and go on listening; see `AgentTransport`."""
        self._send(type(ending), payload)

    def acknowledge(self, event: CommandReceived | CommandRefused) -> None:
        """Let the next command come; see `AgentTransport`."""
        del event
        self._link.acknowledge()

    @override
    def cut(self) -> None:
        self._link.end()

    @override
    def stop(self) -> str:
        self._link.end()
        return self.end_process()

    def _open(self, stream: Stream) -> None:
        self._link.open(stream)
        self.events.put(AgentJoined(agent=AGENT))

    def _send(self, message_type: type[Message], payload: bytes) -> None:
        self._sent[message_type.__name__] = payload
        self._link.send(message_type.__name__, payload)

    def _on_refused_connection(self, text: str) -> None:
        with self.log.open("a") as log:
            log.write(f"the gateway says: {text}\n")

    def _on_event(self, kind: EventKind, data: bytes) -> None:
        if kind == "command":
            self.events.put(CommandReceived(agent=AGENT, payload=data))
            return
        if kind == "refused" or data:
            self.events.put(CommandRefused(agent=AGENT, text=data.decode(errors="replace")))
        if kind == "closed":
            self.events.put(AgentAbandoned(data.decode(errors="replace")))
        elif kind == "ended":
            self.events.put(AgentLost(agent=AGENT, reason="its output ended"))


def _to_absolute_key(key: str) -> str:
    return f"{_NAMESPACE}/{key}"


def _to_relative_key(key: str) -> str:
    inside = key.removeprefix(f"{_NAMESPACE}/")
    return inside if inside != key else f"{key} (outside of the namespace {_NAMESPACE} that GSLCOSIM_JOIN names)"
