"""Core of an external participant: starts its program, sends it the inputs of each step, and waits for the answer."""

import hashlib
import queue
import shutil
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from gslcosim.base.errors import ContractError, SimulationFault
from gslcosim.base.files import ScratchFolder, append_bytes
from gslcosim.base.quantities import Vec3
from gslcosim.base.rng import stream
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.bus.interface import GATEWAY_VARIABLE
from gslcosim.contract import codec
from gslcosim.contract.messages import Bounds, Ending, Message
from gslcosim.contract.participant import Episode, Inbox, Outbox, ParticipantSpec
from gslcosim.contract.participant_messages import (
    PARTICIPATION_VERSION,
    ParticipantBriefing,
    ParticipantHello,
    ParticipantOutputs,
    PortRead,
    PortWrite,
    VehicleOfRun,
    encode_inputs,
    find_room_output,
)
from gslcosim.gateway.connections import (
    AnswerTimeoutError,
    BlockingConnection,
    Listener,
    Stream,
    StreamEndedError,
)
from gslcosim.runtime.agents.loader import resolve_command
from gslcosim.runtime.external.protocol import (
    build_external_spec,
    check_hello,
    get_period_ticks,
    read_hello,
    read_outputs,
)
from gslcosim.runtime.processes.child_processes import ChildProcesses
from gslcosim.runtime.processes.sandbox.selection import build_confinement
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario.models.participants import ParticipantProgramSpec

# Beside the time that a run waits for joining hosts; a program that has to load much first sends its hello before that.
HELLO_TIMEOUT_S = 60.0
EXIT_TIMEOUT_S = 2.0
PARTICIPANT_VARIABLE = "GSLCOSIM_PARTICIPANT"
# A process's end and its stream's end are seen by two threads.
_LOG_TAIL_WAIT_S = 1.0
_POLL_PERIOD_S = 0.1
_PREFIX = "participant_"
END_REASON = "the run is over"


def hash_programs(participants: Iterable[ParticipantProgramSpec], directory: Path) -> dict[str, dict[str, str]]:
    """Return for each participant the words of its command that are files, with the SHA-256 of what is in them."""
    return {
        each.name: {
            word: hashlib.sha256(path.read_bytes()).hexdigest()
            for i, word in enumerate(each.start.words)
            # The program of an extension's start is part of the extension.
            if word in each.start.given_words
            if (path := _find_file(each.start.words, i, directory)) is not None
        }
        for each in participants
    }


# The program itself may be one of the system's; its arguments are looked for where it is started.
def _find_file(command: tuple[str, ...], i: int, directory: Path) -> Path | None:
    word = resolve_command(command, directory)[i]
    found = shutil.which(word) if i == 0 else None
    path = Path(found) if found is not None else directory / Path(word).expanduser()
    try:
        return path if path.is_file() else None
    except OSError:
        return None


class ParticipantProgram:
    """One start of a participant's program.

    Each error of the program becomes a `SimulationFault` that states the expected behaviour and the end of its log.

    Args:
        arguments: Words that follow its command.
        describe_place: Returns the place of a fault within the program, as words that follow the expected behaviour.
    """

    def __init__(
        self,
        own: ParticipantProgramSpec,
        setup: RunSetup,
        *,
        arguments: Sequence[str] = (),
        keep: Sequence[int] = (),
        describe_place: Callable[[], str] = lambda: "",
    ) -> None:
        self._own = own
        self._arguments = arguments
        self._keep = keep
        self._describe_place = describe_place
        self._setup = setup
        self._directory = setup.directory or Path.cwd()
        self._stack = ExitStack()
        self._exchange: BlockingConnection | None = None
        self._children = ChildProcesses(self._exited)
        self._has_exited = threading.Event()
        self._how = ""
        self._has_failed = False

    def start(self) -> None:
        """Start the program; over tcp and unix, wait until it has connected."""
        private_dir = self._stack.enter_context(ScratchFolder.for_sockets()).path
        self._stack.enter_context(self._children)
        own = self._own
        command = [*resolve_command(own.start.words, self._directory), *self._arguments]
        listener = Listener.open_at(own.start.door, private_dir / "door.sock")
        connected: queue.SimpleQueue[Stream] = queue.SimpleQueue()
        refused: list[str] = []
        if listener is not None:
            self._stack.callback(listener.close)
            listener.admit(own.start.format, lambda stream, _: connected.put(stream), refused.append)
        address = "" if listener is None else listener.address
        confinement = build_confinement(
            own, command, self._setup, directory=self._directory, private_dir=private_dir, address=address
        )
        variables = {PARTICIPANT_VARIABLE: own.name}
        start = own.start.registered
        if start is not None and start.unpacks_files and confinement.policy is None:
            # Files that it unpacks there, and leaves when it is killed, are removed with the folder.
            variables["TMPDIR"] = str(private_dir)
        self._children.start_behind_gateway(
            self._process,
            command,
            listener,
            connected.put,
            log=self._setup.run_dir.log(self._process),
            variables=variables,
            cwd=self._directory,
            confinement=confinement,
            keep=self._keep,
        )
        self._exchange = BlockingConnection(self._awaited(connected, refused), own.start.format)

    def send(self, name: str, payload: bytes) -> None:
        """Send the canonical bytes of a message, named by its type."""
        with self._expecting(f"a program that reads {name}"):
            self._opened.send(name, payload, within_s=self._own.answer_within_s)

    def receive(self, message_type: type[Message], what: str, *, within_s: float) -> bytes:
        """Return the program's next message, as msgpack."""
        with self._expecting(what):
            return self._opened.receive(message_type, within_s=within_s)

    @contextmanager
    def _expecting(self, what: str) -> Generator[None]:
        try:
            yield
        except StreamEndedError as error:
            # Its process may have ended too; the exit status is more informative.
            ended = f"but its process {self._how}" if self._has_exited.wait(_LOG_TAIL_WAIT_S) else str(error)
            raise self.fault(f"expected {what}{self._describe_place()}, {ended}.") from error
        except (AnswerTimeoutError, ContractError) as error:
            raise self.fault(f"expected {what}{self._describe_place()}, {error}") from error

    def check_silence(self, what: str) -> None:
        """Check that the program has sent nothing more."""
        if self._opened.has_more:
            raise self.fault(f"expected {what}, something came before it was asked.")

    def fault(self, text: str) -> SimulationFault:
        """Return the fault of the program, with the end of its log."""
        self._has_failed = True
        words = self._setup.run_dir.log_tail(self._process)
        text = f"{text.rstrip('.')}."
        return SimulationFault(f"{text} The end of its log:\n{words}" if words else text)

    @property
    def has_failed(self) -> bool:
        """True where it does not run, or has a fault."""
        return self._has_failed or self._exchange is None

    def note(self, text: str) -> None:
        """Add a line to the log of a program that has ended."""
        log = self._setup.run_dir.log(self._process)
        # A disk without room costs the note, not the run.
        with suppress(OSError):
            append_bytes(log.parent, log.name, f"{text}\n".encode())

    def end(self, reason: str) -> None:
        """Send the program the end of the run, and end it if it does not exit; no process of it is left.

        A failed program is ended without waiting.
        """
        exchange, self._exchange = self._exchange, None
        if exchange is not None:
            # A program that has ended, or does not read, does not get the message.
            with suppress(StreamEndedError, AnswerTimeoutError):
                within_s = 0.0 if self._has_failed else EXIT_TIMEOUT_S
                exchange.send("Ending", codec.encode(Ending(tick=0, reason=reason)), within_s=within_s)
            exchange.close_output()
            self._has_exited.wait(0.0 if self._has_failed else EXIT_TIMEOUT_S)
            exchange.close_input()
        self._stack.close()

    @property
    def _process(self) -> str:
        return f"{_PREFIX}{self._own.name}"

    @property
    def _opened(self) -> BlockingConnection:
        if self._exchange is None:
            raise SimulationFault(f"{self._own.name}: expected a program that has been started.")
        return self._exchange

    def _exited(self, _name: str, _code: int, how: str) -> None:
        self._how = how
        self._has_exited.set()

    def _awaited(self, connected: "queue.SimpleQueue[Stream]", refused: list[str]) -> Stream:
        deadline_s = time.monotonic() + HELLO_TIMEOUT_S
        while time.monotonic() < deadline_s:
            try:
                return connected.get(timeout=_POLL_PERIOD_S)
            except queue.Empty:
                if self._has_exited.is_set() and connected.empty():
                    break
        how = f"but its process {self._how}" if self._has_exited.is_set() else f"nobody within {HELLO_TIMEOUT_S:g} s"
        note = f" ({refused[-1].rstrip('.')})" if refused else ""
        raise self.fault(f"expected its program to connect to {GATEWAY_VARIABLE}, {how}{note}.")


class ProgramCore(ABC):
    """Core that stands for a program in a run. State: the program, and its changes to the room.

    The state of a program cannot be read, so a snapshot holds all inputs sent to it: to go on from there, a new start
    of the program steps through them. They are kept only in runs with snapshots.
    """

    def __init__(self, own: ParticipantProgramSpec, setup: RunSetup) -> None:
        self.spec: ParticipantSpec = build_external_spec(own, setup.scenario)
        self._own = own
        self._setup = setup
        self._period_ticks = get_period_ticks(own, setup.scenario)
        self._program: ParticipantProgram | None = None
        self._room_outputs: dict[str, Message] = {}
        self._is_kept = setup.scenario.snapshots is not None or setup.snapshot is not None
        self._past: list[tuple[int, bytes]] = []
        self._answers_hash = b""

    def reset(self, episode: Episode) -> Outbox:
        """Start the program again."""
        self.close()
        self._room_outputs, self._past, self._answers_hash = {}, [], b""
        self._program = self._start(episode)
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Let the program step, where its period is over; the room stays as it was in between."""
        if tick % self._period_ticks:
            return {port: held.model_copy(update={"tick": tick}) for port, held in self._room_outputs.items()}
        return self._ask(tick, self._encode_inputs(tick, inbox))

    def state(self) -> Mapping[str, Any]:
        """Return all inputs that the program was sent, and a hash of its answers; see `Snapshots`."""
        return {"past": list(self._past), "answers_hash": self._answers_hash}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Let the program step through its past again; see `Snapshots`."""
        for tick, inputs in state["past"]:
            self._ask(int(tick), bytes(inputs))
        if self._answers_hash != bytes(state["answers_hash"]):
            raise self._running().fault(
                f"expected the answers of the past {len(self._past)} steps again, were others: it is not "
                "deterministic, or has changed. Repeat the run from its start, with --from-start."
            )

    def close(self) -> None:
        """Send the program the end of the run, and end it."""
        program, self._program = self._program, None
        if program is not None:
            program.end(END_REASON)

    @abstractmethod
    def _start(self, episode: Episode) -> ParticipantProgram:
        """Return the program, ready for its first inputs."""

    @abstractmethod
    def _encode_inputs(self, tick: int, inbox: Inbox) -> bytes:
        """Return the frame of a step's inputs."""

    @abstractmethod
    def _request_outputs(self, program: ParticipantProgram, tick: int, inputs: bytes) -> Mapping[str, Message]:
        """Return the program's answer to a step's inputs, by word."""

    def _running(self) -> ParticipantProgram:
        if self._program is None:
            raise SimulationFault(f"{self._own.name}: expected a reset before the first step.")
        return self._program

    def _ask(self, tick: int, inputs: bytes) -> Outbox:
        answers = self._request_outputs(self._running(), tick, inputs)
        self._room_outputs = {room.port: answers[word] for word in answers if (room := find_room_output(word))}
        if self._is_kept:
            self._past.append((tick, inputs))
            digest = hashlib.blake2b(self._answers_hash, digest_size=16)
            for answer in answers.values():
                digest.update(codec.encode(answer))
            self._answers_hash = digest.digest()
        return {self._own.port_of(word): answer for word, answer in answers.items()}


class ExternalCore(ProgramCore):
    """Stands for a program that speaks the gateway's frames."""

    def __init__(self, own: ParticipantProgramSpec, setup: RunSetup, message_types: Mapping[str, str]) -> None:
        super().__init__(own, setup)
        self._message_types = message_types

    def _start(self, episode: Episode) -> ParticipantProgram:
        program = self._program = ParticipantProgram(self._own, self._setup)
        program.start()
        payload = program.receive(ParticipantHello, "its hello (ParticipantHello)", within_s=HELLO_TIMEOUT_S)
        try:
            hello = read_hello(payload)
            check_hello(hello, reads=(read.port for read in self._own.reads), writes=self._own.writes)
        except ContractError as error:
            raise program.fault(str(error)) from error
        program.send("ParticipantBriefing", codec.encode(self._briefing(episode)))
        return program

    def _encode_inputs(self, tick: int, inbox: Inbox) -> bytes:
        time_s = seconds_from_ticks(tick, self._setup.scenario.tick_ns)
        ports = (read.port for read in self._own.reads if read.port in inbox)
        return encode_inputs(tick, time_s, {port: codec.encode(inbox[port]) for port in ports})

    def _request_outputs(self, program: ParticipantProgram, tick: int, inputs: bytes) -> Mapping[str, Message]:
        program.check_silence(f"no answer before the inputs of tick {tick}")
        program.send("ParticipantInputs", inputs)
        what = f"an answer to the inputs of tick {tick}"
        payload = program.receive(ParticipantOutputs, what, within_s=self._own.answer_within_s)
        try:
            return read_outputs(payload, tick, self._own.writes)
        except ContractError as error:
            raise program.fault(str(error)) from error

    def _briefing(self, episode: Episode) -> ParticipantBriefing:
        scenario, own = self._setup.scenario, self._own
        grid = self._setup.environment.grid
        return ParticipantBriefing(
            tick=0,
            participant=own.name,
            contract_version=PARTICIPATION_VERSION,
            scenario=scenario.name,
            tick_ns=scenario.tick_ns,
            period_ticks=self._period_ticks,
            seed=int(stream(episode.seed, f"participant.{own.name}").integers(2**31)),
            time_limit_s=scenario.referee.stop.time_limit_s,
            bounds=Bounds(min_m=_to_floats(grid.origin_m), max_m=_to_floats(grid.max_m)),
            gases=scenario.substances,
            vehicles=tuple(
                VehicleOfRun(agent=agent.name, sensors=tuple(sensor.name for sensor in agent.sensors))
                for agent in scenario.agents
            ),
            reads=tuple(
                PortRead(port=read.port, delay_ticks=read.delay, message=self._message_types[read.port])
                for read in own.reads
            ),
            writes=tuple(
                PortWrite(word=word, port=own.port_of(word), message=self._message_types[own.port_of(word)])
                for word in own.writes
            ),
            parameters=own.parameters,
        )


def _to_floats(corner_m: Sequence[float]) -> Vec3:
    x_m, y_m, z_m = corner_m
    return (float(x_m), float(y_m), float(z_m))
