"""An agent's process behind one of the two doors, as the flight of a check sees it."""

import queue

from gslcosim.agent_kit.framed import AGENT_VARIABLE
from gslcosim.bus.access import AgentUser
from gslcosim.bus.port import Join
from gslcosim.bus.zenoh_bus import new_password
from gslcosim.bus.zenoh_witness import ZenohWitness
from gslcosim.conformance.orphans import Orphans
from gslcosim.conformance.scripted_world import AGENT, OTHER_AGENT
from gslcosim.conformance.wiring import AgentExited, AgentGivenUp, QuestionAsked, StrayCame, Wire, WireEvent, Wiring
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Ending, Message, Observation
from gslcosim.gateway.link import EventKind, Link
from gslcosim.gateway.listener import Listener
from gslcosim.gateway.streams import PipeStream, Stream
from gslcosim.runtime.agents.events import AgentGone, AgentJoined, CommandCame, CommandRefused
from gslcosim.runtime.agents.guests import GATEWAY_VARIABLE, TOKEN_VARIABLE
from gslcosim.runtime.agents.links import Seen
from gslcosim.runtime.processes import Children
from gslcosim.scratch import ScratchFolder

N_LAST_LINES = 6
_NAMESPACE = "gsl/check"
_KEY_OF_MESSAGE = {Briefing: keys.briefing, Observation: keys.observation, Ending: keys.ending}
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


def open_wire(wiring: Wiring) -> Wire:
    """Return a wire to an agent that is yet to be started."""
    return ZenohWire(wiring) if wiring.door == "zenoh" else GatewayWire(wiring)


class StartedProcess:
    """What all wires share: a private folder, the process, its end as an event, and what it leaves behind."""

    def __init__(self, wiring: Wiring) -> None:
        self.wiring = wiring
        self.events: queue.SimpleQueue[WireEvent] = queue.SimpleQueue()
        self._scratch = ScratchFolder.for_sockets("check")
        self.folder = self._scratch.path
        self.log = self.folder / "log"
        self.children = Children(lambda _, code, __: self.events.put(AgentExited(code)))
        self.orphans = Orphans(str(self.folder))
        self.left_over: tuple[str, ...] = ()

    def command(self) -> list[str]:
        """Return the command line, its program looked for in the folder of the check."""
        program, *arguments = self.wiring.command
        beside = self.wiring.directory / program
        return [str(beside.absolute()) if "/" in program and beside.exists() else program, *arguments]

    def end_process(self) -> str:
        """End the process with all that it leaves behind; return the end of its log."""
        self.children.end()
        self.left_over = self.orphans.end()
        lines = self.log.read_text(errors="replace").splitlines() if self.log.exists() else []
        self._scratch.close()
        return "\n".join(line[:200] for line in lines if line.strip()[:1] not in ("", "^", "~"))[-N_LAST_LINES * 200 :]


class ZenohWire(StartedProcess):
    """An agent over Zenoh, with a router of its own that lets it do what it wants and sees it."""

    may_lose = True
    joins_by_start = False

    def __init__(self, wiring: Wiring) -> None:
        super().__init__(wiring)
        self._user = AgentUser(agent=AGENT, password=new_password())
        self._endpoint = f"unixsock-stream/{self.folder}/router.sock"
        self._router: ZenohWitness | None = None
        self._unheard: tuple[str, ...] = ()
        self._told: dict[str, bytes] = {}
        self._question: bytes | None = None

    def start(self) -> None:
        """Open the router and start the agent; see `Wire`."""
        router = self._router = ZenohWitness.open(endpoint=self._endpoint, agent=self._user, secrets_dir=self.folder)
        for key in (*(key(AGENT) for key in _KEY_OF_MESSAGE.values()), _QUESTION, *_FORBIDDEN_KEYS):
            router.offer(_whole(key))
        router.watch(
            on_put=self._on_put,
            on_question=lambda key, _: self.events.put(QuestionAsked(_relative(key))),
            on_alive=self._on_alive,
        )
        join = Join(
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
            cwd=self.wiring.directory,
            variables=self.orphans.variables,
        )

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Publish the briefing; see `AgentLink`."""
        self._publish(type(briefing), payload)

    def observe(self, observation: Seen, payload: bytes) -> None:
        """Publish an observation; see `AgentLink`."""
        self._publish(Observation, payload)
        self._question = payload if observation.awaiting_command else None
        self._ask_again()

    def repeat(self) -> None:
        """Publish briefing and last observation again; see `Wire`."""
        for message_type in (Briefing, Observation):
            self._publish(message_type, self._told[message_type.__name__])
        self._ask_again()

    def end(self, ending: Ending, payload: bytes) -> None:
        """Publish the end; see `AgentLink`."""
        self._publish(type(ending), payload)

    def unheard(self) -> tuple[str, ...]:
        """Return which of its own keys the agent did not listen to when it joined; see `Wire`."""
        return self._unheard

    def overheard(self) -> tuple[str, ...]:
        """Return which keys of others the agent listens to; see `Wire`."""
        return tuple(key for key in _FORBIDDEN_KEYS if self._opened().is_read(_whole(key)))

    def handled(self, event: CommandCame | CommandRefused) -> None:
        """Do nothing: Zenoh has its own flow control; see `AgentLink`."""

    def cut(self) -> None:
        """Close the router; see `Wire`."""
        self._opened().close()

    def stop(self) -> str:
        """End the process, then the router; see `Wire`."""
        last_words = self.end_process()
        if self._router is not None:
            self._router.close()
        return last_words

    def _publish(self, message_type: type[Message], payload: bytes) -> None:
        self._told[message_type.__name__] = payload
        key = _whole(_KEY_OF_MESSAGE[message_type](AGENT))
        self._opened().publish(key, payload, encoding=codec.encoding_of(message_type))

    def _ask_again(self) -> None:
        if self._question is not None:
            self._opened().publish(_whole(_QUESTION), self._question, encoding=codec.encoding_of(Observation))

    def _opened(self) -> ZenohWitness:
        if self._router is None:
            raise RuntimeError("expected a wire that has been started")
        return self._router

    def _on_put(self, key: str, payload: bytes) -> None:
        if key == _whole(keys.raw_command(AGENT)):
            self.events.put(CommandCame(agent=AGENT, payload=payload))
        else:
            self.events.put(StrayCame(_relative(key)))

    def _on_alive(self, key: str, is_alive: bool) -> None:  # noqa: FBT001 - the interface of the bus
        if key == _whole(f"agents/{AGENT}/alive"):
            if is_alive:
                own = (key(AGENT) for key in _KEY_OF_MESSAGE.values())
                unheard = tuple(key for key in own if not self._is_heard(key))
                self._unheard = tuple(key for key in unheard if key != _OBSERVATION or not self._is_heard(_QUESTION))
                self.events.put(AgentJoined(agent=AGENT))
            else:
                self.events.put(AgentGone(agent=AGENT, reason="its liveliness token vanished"))
        elif is_alive:
            self.events.put(StrayCame(f"liveliness token {_relative(key)}"))

    def _is_heard(self, key: str) -> bool:
        return self._opened().is_read(_whole(key))


class GatewayWire(StartedProcess):
    """An agent behind the gateway, over the very link that a run uses."""

    may_lose = False

    def __init__(self, wiring: Wiring) -> None:
        super().__init__(wiring)
        self.joins_by_start = wiring.door == "stdio"
        self._link = Link(wiring.format, self._on_event)
        self._listener: Listener | None = None
        self._told: dict[str, bytes] = {}

    def start(self) -> None:
        """Start the agent, and listen for it where it connects; see `Wire`."""
        self.orphans.begin()
        variables = {AGENT_VARIABLE: AGENT, **self.orphans.variables}
        log, cwd = self.log, self.wiring.directory
        if self.wiring.door == "stdio":
            pipes = self.children.start_piped(AGENT, self.command(), variables=variables, log=log, cwd=cwd)
            self._open(PipeStream(*pipes))
            return
        is_unix = self.wiring.door == "unix"
        listener = self._listener = Listener.open_unix(self.folder / "gateway.sock") if is_unix else Listener.open_tcp()
        listener.admit(self.wiring.format, lambda stream, _: self._open(stream), self._on_refused_connection)
        variables |= {GATEWAY_VARIABLE: listener.address, TOKEN_VARIABLE: listener.token}
        self.children.start_guest(AGENT, self.command(), variables=variables, log=log, cwd=cwd)

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Tell the agent its briefing; see `AgentLink`."""
        self._tell(type(briefing), payload)

    def observe(self, observation: Seen, payload: bytes) -> None:
        """Tell the agent an observation, if it wants that kind; see `AgentLink`."""
        if self.wiring.observations == "all" or observation.awaiting_command:
            self._tell(Observation, payload)

    def repeat(self) -> None:
        """Tell briefing and last observation again; see `Wire`."""
        for message_type in (Briefing, Observation):
            self._tell(message_type, self._told[message_type.__name__])

    def end(self, ending: Ending, payload: bytes) -> None:
        """Tell the agent the end, and go on listening; see `AgentLink`."""
        self._tell(type(ending), payload)

    def unheard(self) -> tuple[str, ...]:
        """Return nothing: there are no keys; see `Wire`."""
        return ()

    def overheard(self) -> tuple[str, ...]:
        """Return nothing: there is nothing to overhear; see `Wire`."""
        return ()

    def handled(self, event: CommandCame | CommandRefused) -> None:
        """Let the next command come; see `AgentLink`."""
        del event
        self._link.handled()

    def cut(self) -> None:
        """End the stream; see `Wire`."""
        self._link.end()

    def stop(self) -> str:
        """End the link and the process; see `Wire`."""
        self._link.end()
        if self._listener is not None:
            self._listener.close()
        return self.end_process()

    def _open(self, stream: Stream) -> None:
        self._link.open(stream)
        self.events.put(AgentJoined(agent=AGENT))

    def _tell(self, message_type: type[Message], payload: bytes) -> None:
        self._told[message_type.__name__] = payload
        self._link.tell(message_type.__name__, payload)

    def _on_refused_connection(self, text: str) -> None:
        with self.log.open("a") as log:
            log.write(f"the gateway says: {text}\n")

    def _on_event(self, kind: EventKind, data: bytes) -> None:
        if kind == "command":
            self.events.put(CommandCame(agent=AGENT, payload=data))
            return
        if kind == "refused" or data:
            self.events.put(CommandRefused(agent=AGENT, text=data.decode(errors="replace")))
        if kind == "closed":
            self.events.put(AgentGivenUp(data.decode(errors="replace")))
        elif kind == "ended":
            self.events.put(AgentGone(agent=AGENT, reason="its output ended"))


def _whole(key: str) -> str:
    return f"{_NAMESPACE}/{key}"


def _relative(key: str) -> str:
    inside = key.removeprefix(f"{_NAMESPACE}/")
    return inside if inside != key else f"{key} (outside of the namespace {_NAMESPACE} that GSLCOSIM_JOIN names)"
