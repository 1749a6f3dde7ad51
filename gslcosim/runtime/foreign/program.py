"""The program of a participant: started beside its core, spoken to in turn, and ended with it."""

import queue
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

from gslcosim.contract import codec
from gslcosim.contract.messages import Ending, Message
from gslcosim.errors import ContractError, SimulationFault
from gslcosim.gateway.exchange import AnswerLateError, FrameExchange, StreamEndedError
from gslcosim.gateway.listener import Listener
from gslcosim.gateway.streams import PipeStream, Stream
from gslcosim.runtime.agents.guests import GATEWAY_VARIABLE, TOKEN_VARIABLE
from gslcosim.runtime.agents.starting import resolved_command
from gslcosim.runtime.processes import Children
from gslcosim.runtime.sandbox.confining import confinement_of
from gslcosim.runtime.setup import Setup
from gslcosim.scenario.models.own_models import OwnModelSpec
from gslcosim.scratch import ScratchFolder

# Beside the time that a run waits for whoever joins; a program that has to load much first says hello before that.
HELLO_WITHIN_S = 60.0
EXIT_WITHIN_S = 2.0
PARTICIPANT_VARIABLE = "GSLCOSIM_PARTICIPANT"
# A process's end and its stream's end are seen by two threads.
_LAST_WORDS_S = 0.3
_LOOK_EVERY_S = 0.1
_PREFIX = "participant_"


class ForeignProgram:
    """One start of a participant's program.

    Whatever it does wrong becomes a `SimulationFault` that says what was expected, with the end of its log.
    """

    def __init__(self, own: OwnModelSpec, setup: Setup) -> None:
        self._own = own
        self._setup = setup
        self._directory = setup.directory or Path.cwd()
        self._stack = ExitStack()
        self._exchange: FrameExchange | None = None
        self._children = Children(self._exited)
        self._has_exited = threading.Event()
        self._how = ""
        self._has_failed = False

    def start(self) -> None:
        """Start the program; over tcp and unix, wait until it has connected.

        Raises:
            UsageError: it cannot be started.
            SimulationFault: it does not connect.
        """
        private_dir = self._stack.enter_context(ScratchFolder.for_sockets()).path
        self._stack.enter_context(self._children)
        own = self._own
        command = resolved_command(own.start.command, self._directory)
        listener = self._listener(private_dir)
        kind, _, place = listener.address.partition(":") if listener else ("", "", "")
        confinement = confinement_of(
            own,
            command,
            self._setup,
            directory=self._directory,
            private_dir=private_dir,
            sockets=[Path(place)] if kind == "unix" else (),
            tcp_port=int(place.rpartition(":")[2]) if kind == "tcp" else None,
        )
        name, log, cwd = self._process, self._setup.run_dir.log(self._process), self._directory
        variables = {PARTICIPANT_VARIABLE: own.name}
        if listener is None:
            pipes = self._children.start_piped(
                name, command, variables=variables, log=log, cwd=cwd, confinement=confinement
            )
            self._open(PipeStream(*pipes))
            return
        connected: queue.SimpleQueue[Stream] = queue.SimpleQueue()
        refused: list[str] = []
        listener.admit(own.start.format, lambda stream, _: connected.put(stream), refused.append)
        variables |= {GATEWAY_VARIABLE: listener.address, TOKEN_VARIABLE: listener.token}
        self._children.start_guest(name, command, variables=variables, log=log, cwd=cwd, confinement=confinement)
        self._open(self._awaited(connected, refused))

    def say(self, name: str, payload: bytes) -> None:
        """Send the canonical bytes of a message, named by its type.

        Raises:
            SimulationFault: the program does not read it.
        """
        try:
            self._opened.send(name, payload, within_s=self._own.answer_within_s)
        except StreamEndedError as error:
            raise self.fault(f"expected a program that reads {name}, {self._ended(error)}.") from error
        except AnswerLateError as error:
            raise self.fault(f"expected a program that reads {name}, {error}.") from error

    def hear(self, message_type: type[Message], what: str, *, within_s: float) -> bytes:
        """Return what the program says next, as msgpack.

        Args:
            message_type: What it is meant to be.
            what: What is expected, for the fault.
            within_s: How long to wait for it [s].

        Raises:
            SimulationFault: nothing comes, or no frame.
        """
        try:
            return self._opened.receive(message_type, within_s=within_s)
        except StreamEndedError as error:
            raise self.fault(f"expected {what}, {self._ended(error)}.") from error
        except (AnswerLateError, ContractError) as error:
            raise self.fault(f"expected {what}, {error}") from error

    def check_silence(self, what: str) -> None:
        """Check that the program has said nothing more.

        Raises:
            SimulationFault: it has.
        """
        if self._opened.has_more:
            raise self.fault(f"expected {what}, something came before it was asked.")

    def fault(self, text: str) -> SimulationFault:
        """Return the fault of the program, with the end of its log."""
        self._has_failed = True
        words = self._setup.run_dir.last_words(self._process)
        text = f"{text.rstrip('.')}."
        return SimulationFault(f"{text} The end of its log:\n{words}" if words else text)

    def end(self, reason: str) -> None:
        """Tell the program that the run is over, and end it where it does not; nothing of it is left.

        One that has failed is not waited for.
        """
        exchange, self._exchange = self._exchange, None
        if exchange is not None:
            # Where it is gone already, or does not read, it hears nothing.
            with suppress(StreamEndedError, AnswerLateError):
                within_s = 0.0 if self._has_failed else EXIT_WITHIN_S
                exchange.send("Ending", codec.encode(Ending(tick=0, reason=reason)), within_s=within_s)
            exchange.close_output()
            self._has_exited.wait(0.0 if self._has_failed else EXIT_WITHIN_S)
            exchange.close_input()
        self._stack.close()

    @property
    def _process(self) -> str:
        return f"{_PREFIX}{self._own.name}"

    @property
    def _opened(self) -> FrameExchange:
        if self._exchange is None:
            raise SimulationFault(f"{self._own.name}: expected a program that has been started.")
        return self._exchange

    def _open(self, stream: Stream) -> None:
        self._exchange = FrameExchange(stream, self._own.start.format)

    def _ended(self, error: Exception) -> str:
        if self._has_exited.wait(_LAST_WORDS_S):
            return f"but its process {self._how}"
        return str(error)

    def _exited(self, name: str, code: int, how: str) -> None:
        del name, code
        self._how = how
        self._has_exited.set()

    def _listener(self, private_dir: Path) -> Listener | None:
        if self._own.start.door == "stdio":
            return None
        is_unix = self._own.start.door == "unix"
        listener = Listener.open_unix(private_dir / "door.sock") if is_unix else Listener.open_tcp()
        self._stack.callback(listener.close)
        return listener

    def _awaited(self, connected: "queue.SimpleQueue[Stream]", refused: list[str]) -> Stream:
        deadline_s = time.monotonic() + HELLO_WITHIN_S
        while time.monotonic() < deadline_s:
            try:
                return connected.get(timeout=_LOOK_EVERY_S)
            except queue.Empty:
                if self._has_exited.is_set() and connected.empty():
                    break
        how = f"but its process {self._how}" if self._has_exited.is_set() else f"nobody within {HELLO_WITHIN_S:g} s"
        note = f" ({refused[-1].rstrip('.')})" if refused else ""
        raise self.fault(f"expected its program to connect to {GATEWAY_VARIABLE}, {how}{note}.")
