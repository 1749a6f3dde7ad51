"""An agent's process behind one of the two doors, as the flight of a check sees it."""

import queue
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

import msgpack

from gslcosim.bus.port import Join
from gslcosim.bus.zenoh_bus import AgentUser, new_password
from gslcosim.bus.zenoh_witness import ZenohWitness
from gslcosim.conformance.scripted_world import AGENT, OTHER_AGENT
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Ending, Message, Observation
from gslcosim.errors import UsageError
from gslcosim.gateway.framing import FrameFormat
from gslcosim.gateway.link import EventKind, Link
from gslcosim.gateway.listener import Listener
from gslcosim.gateway.streams import PipeStream, Stream
from gslcosim.methods.card import Needs, card_beside
from gslcosim.runtime.agents.guests import AGENT_VARIABLE, GATEWAY_VARIABLE, TOKEN_VARIABLE
from gslcosim.runtime.processes import Children

DoorKind = Literal["zenoh", "stdio", "tcp", "unix"]
Event = tuple[Literal["joined", "command", "refused", "left", "given up", "exit", "stray", "question"], bytes]
N_LAST_LINES = 6
_NAMESPACE = "gsl/check"
_KEY_OF_MESSAGE = {Briefing: keys.briefing, Observation: keys.observation, Ending: keys.ending}
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


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """How an agent is started and spoken to: its command line, its door, and for the gateway format and choice."""

    command: tuple[str, ...]
    door: DoorKind = "zenoh"
    format: FrameFormat = "msgpack"
    observations: Literal["all", "asked"] = "all"
    directory: Path = field(default_factory=Path.cwd)

    def check(self) -> None:
        """Check that there is a program to start.

        Raises:
            UsageError: there is none.
        """
        program = self.command[0] if self.command else ""
        if not program or shutil.which(program, path=None if "/" not in program else str(self.directory)) is None:
            beside = self.directory / program
            if "/" in program and shutil.which(str(beside)) is not None:
                return
            raise UsageError(
                f"expected an agent's command that can be started, was {program!r}.\nFolder: {self.directory}"
            )

    def needs(self) -> Needs:
        """Return what the method card beside the agent's program says that it needs; nothing where there is no card.

        Raises:
            MethodError: the card is wrong.
        """
        for word in self.command:
            program = self.directory / word
            card = card_beside(program) if program.is_file() else None
            if card is not None:
                return card.needs
        return Needs()

    def open(self) -> "Wire":
        """Return a wire to an agent that is yet to be started."""
        return ZenohWire(self) if self.door == "zenoh" else GatewayWire(self)


class Wire(Protocol):
    """One start of an agent. `events` holds what it does, in order.

    `may_lose` says that a message may be lost in the air, so that a run repeats questions;
    `joins_by_start` that an agent joins by being started, without a word of its own.
    """

    events: "queue.SimpleQueue[Event]"
    may_lose: bool
    joins_by_start: bool

    def start(self) -> None:
        """Start the agent's process."""
        ...

    def send(self, message_type: type[Message], fields: Mapping[str, Any]) -> None:
        """Send the agent a message."""
        ...

    def unheard(self) -> tuple[str, ...]:
        """Return which of its own keys the agent did not listen to when it joined."""
        ...

    def overheard(self) -> tuple[str, ...]:
        """Return which keys of others the agent listens to."""
        ...

    def handled(self) -> None:
        """Take note that a command or a refusal has been handled."""
        ...

    def cut(self) -> None:
        """End the link without a word."""
        ...

    def stop(self) -> str:
        """End whatever is left of the agent; return its last words."""
        ...


class _Started:
    """What both wires share: a private folder, the process, and its end as an event."""

    def __init__(self, wiring: Wiring) -> None:
        self.wiring = wiring
        self.events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self.folder = Path(tempfile.mkdtemp(prefix="gslcosim-check-"))
        self.log = self.folder / "log"
        self.children = Children(lambda _, code: self.events.put(("exit", str(code).encode())))

    def command(self) -> list[str]:
        program, *arguments = self.wiring.command
        beside = self.wiring.directory / program
        return [str(beside.absolute()) if "/" in program and beside.exists() else program, *arguments]

    def end(self) -> str:
        self.children.end()
        lines = self.log.read_text(errors="replace").splitlines() if self.log.exists() else []
        shutil.rmtree(self.folder, ignore_errors=True)
        return "\n".join(line[:200] for line in lines if line.strip()[:1] not in ("", "^", "~"))[-N_LAST_LINES * 200 :]


class ZenohWire(_Started):
    """An agent over Zenoh, with a router of its own that lets it do what it wants and sees it."""

    may_lose = True
    joins_by_start = False

    def __init__(self, wiring: Wiring) -> None:
        super().__init__(wiring)
        self._user = AgentUser(agent=AGENT, password=new_password())
        self._endpoint = f"unixsock-stream/{self.folder}/router.sock"
        self._router: ZenohWitness | None = None
        self._unheard: tuple[str, ...] = ()

    def start(self) -> None:
        """Open the router and start the agent; see `Wire`."""
        router = self._router = ZenohWitness.open(endpoint=self._endpoint, agent=self._user, secrets_dir=self.folder)
        for key in (*(key(AGENT) for key in _KEY_OF_MESSAGE.values()), *_FORBIDDEN_KEYS):
            router.offer(_whole(key))
        router.watch(
            on_put=self._on_put,
            on_question=lambda key, _: self.events.put(("question", _relative(key).encode())),
            on_alive=self._on_alive,
        )
        join = Join(
            name=AGENT,
            endpoint=self._endpoint,
            namespace=_NAMESPACE,
            user=self._user.user,
            password=self._user.password,
        )
        self.children.start(AGENT, self.command(), join=join, log=self.log, cwd=self.wiring.directory)

    def send(self, message_type: type[Message], fields: Mapping[str, Any]) -> None:
        """Publish a message; see `Wire`."""
        key = _whole(_KEY_OF_MESSAGE[message_type](AGENT))
        self._opened().publish(key, _packed(fields), encoding=codec.encoding_of(message_type))

    def unheard(self) -> tuple[str, ...]:
        """Return which of its own keys the agent did not listen to when it joined; see `Wire`."""
        return self._unheard

    def overheard(self) -> tuple[str, ...]:
        """Return which keys of others the agent listens to; see `Wire`."""
        return tuple(key for key in _FORBIDDEN_KEYS if self._opened().is_read(_whole(key)))

    def handled(self) -> None:
        """Do nothing: Zenoh has its own flow control; see `Wire`."""

    def cut(self) -> None:
        """Close the router; see `Wire`."""
        self._opened().close()

    def stop(self) -> str:
        """End the process, then the router; see `Wire`."""
        last_words = self.end()
        if self._router is not None:
            self._router.close()
        return last_words

    def _opened(self) -> ZenohWitness:
        if self._router is None:
            raise RuntimeError("expected a wire that has been started")
        return self._router

    def _on_put(self, key: str, payload: bytes) -> None:
        if key == _whole(keys.raw_command(AGENT)):
            self.events.put(("command", payload))
        else:
            self.events.put(("stray", _relative(key).encode()))

    def _on_alive(self, key: str, is_alive: bool) -> None:  # noqa: FBT001 - the interface of the bus
        if key == _whole(f"agents/{AGENT}/alive"):
            if is_alive:
                own = (key(AGENT) for key in _KEY_OF_MESSAGE.values())
                self._unheard = tuple(key for key in own if not self._opened().is_read(_whole(key)))
            self.events.put(("joined" if is_alive else "left", b"its liveliness token vanished"))
        elif is_alive:
            self.events.put(("stray", f"liveliness token {_relative(key)}".encode()))


class GatewayWire(_Started):
    """An agent behind the gateway, over the very link that a run uses."""

    may_lose = False

    def __init__(self, wiring: Wiring) -> None:
        super().__init__(wiring)
        self.joins_by_start = wiring.door == "stdio"
        self._link = Link(wiring.format, self._on_event)
        self._listener: Listener | None = None

    def start(self) -> None:
        """Start the agent, and listen for it where it connects; see `Wire`."""
        variables = {AGENT_VARIABLE: AGENT}
        places = {"log": self.log, "cwd": self.wiring.directory}
        if self.wiring.door == "stdio":
            pipes = self.children.start_piped(AGENT, self.command(), variables=variables, **places)
            self._open(PipeStream(*pipes))
            return
        is_unix = self.wiring.door == "unix"
        listener = self._listener = Listener.open_unix(self.folder / "gateway.sock") if is_unix else Listener.open_tcp()
        listener.admit(self.wiring.format, lambda stream, _: self._open(stream), self._on_refused_connection)
        variables |= {GATEWAY_VARIABLE: listener.address, TOKEN_VARIABLE: listener.token}
        self.children.start_guest(AGENT, self.command(), variables=variables, **places)

    def send(self, message_type: type[Message], fields: Mapping[str, Any]) -> None:
        """Tell the agent a message, if it wants that kind; see `Wire`."""
        is_question = fields.get("awaiting_command", True)
        if self.wiring.observations == "all" or is_question:
            self._link.tell(message_type.__name__, _packed(fields))

    def unheard(self) -> tuple[str, ...]:
        """Return nothing: there are no keys; see `Wire`."""
        return ()

    def overheard(self) -> tuple[str, ...]:
        """Return nothing: there is nothing to overhear; see `Wire`."""
        return ()

    def handled(self) -> None:
        """Let the next command come; see `Wire`."""
        self._link.handled()

    def cut(self) -> None:
        """End the stream; see `Wire`."""
        self._link.end()

    def stop(self) -> str:
        """End the link and the process; see `Wire`."""
        self._link.end()
        if self._listener is not None:
            self._listener.close()
        return self.end()

    def _open(self, stream: Stream) -> None:
        self._link.open(stream)
        self.events.put(("joined", b""))

    def _on_refused_connection(self, text: str) -> None:
        with self.log.open("a") as log:
            log.write(f"the gateway says: {text}\n")

    def _on_event(self, kind: EventKind, data: bytes) -> None:
        if kind in ("command", "refused"):
            self.events.put(("command" if kind == "command" else "refused", data))
            return
        if data:
            self.events.put(("refused", data))
        self.events.put(("given up", data) if kind == "closed" else ("left", b"its output ended"))


def _whole(key: str) -> str:
    return f"{_NAMESPACE}/{key}"


def _relative(key: str) -> str:
    inside = key.removeprefix(f"{_NAMESPACE}/")
    return inside if inside != key else f"{key} (outside of the namespace {_NAMESPACE} that GSLCOSIM_JOIN names)"


def _packed(fields: Mapping[str, Any]) -> bytes:
    payload: Any = msgpack.packb(dict(fields), use_bin_type=True)
    return payload
