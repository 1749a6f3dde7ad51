"""Fork server: a process that imports shared modules once, and then forks the processes that need them.

It has one thread. It reads requests, one JSON object a line, from a socket that it inherits, and answers
`{"name": name, "pid": n}` when a process has started and `{"name": name, "code": n}` when it has ended. It holds no
data of a run: the inputs of a process come with its request and exist in the fork alone. At the end of the requests it
ends the remaining processes.

`ForkServer` starts a server and requests processes; `serve_forks` is the server itself. The work of the forks is
passed in by the caller of `serve_forks`.
"""

import contextlib
import ctypes
import gc
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any, Self

from gslcosim.base.errors import ExitCode, SimulationFault, format_machine_error
from gslcosim.base.files import append_bytes, build_temporary_directory_error, open_for_writing
from gslcosim.base.processes import build_python_command, describe_exit
from gslcosim.base.spawn import Streams, spawn
from gslcosim.runtime.processes.current_process import keep_memory_private, release_code

FORK_SERVER = "fork_server"
CLOSE_TIMEOUT_S = 2.0
# A service needs no threads for linear algebra, and a process that forks must have none.
SINGLE_THREAD_VARIABLES = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1") | {
    # Each of many threads would keep a heap of its own, of 20 MB together in the recorder.
    "MALLOC_ARENA_MAX": "2",
    # Arrow's own keeps 10 MB of what the recorder has freed.
    "ARROW_DEFAULT_MEMORY_POOL": "system",
}
TITLE_PADDING = "." * 200
_COMPILER = "libllvmlite"
_READ_BYTES = 1 << 16
_PR_SET_PDEATHSIG = 1


class JsonLines:
    """Objects over a socket, one JSON a line."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self._unread = b""

    def send(self, message: object) -> None:
        """Send an object."""
        self.connection.sendall(json.dumps(message).encode() + b"\n")

    def receive(self) -> list[Any] | None:
        """Read once; return the objects that are whole now, None where the other end is closed."""
        received = self.connection.recv(_READ_BYTES)
        *lines, self._unread = (self._unread + received).split(b"\n")
        if not received:
            return None
        return [json.loads(line) for line in lines]

    def __iter__(self) -> Iterator[Any]:
        while (messages := self.receive()) is not None:
            yield from messages


def fork_child(main: Callable[[], object], *, unwanted: Sequence[int] = ()) -> int:
    """Fork this process, which must have one thread; return the number of the fork, which leads a session of its own.

    Args:
        main: Work of the fork, which never returns from here: it exits with 0 when `main` returns, with the code of
            `SystemExit`, or with 1 after an error, which it prints.
    """
    parent = os.getpid()
    if pid := os.fork():
        return pid
    code = 1
    try:
        # Linux kills it when this process ends.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
        os.setsid()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for fd in unwanted:
            os.close(fd)
        main()
        code = 0
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    except BaseException:  # printed to the log, as by an interpreter that ends
        traceback.print_exc()
    finally:
        # Flushes its output, and leaves out the exit handlers of its parent.
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


class ForkedProcess:
    """A process of the fork server, which the supervisor uses like a child of its own."""

    def __init__(self, name: str) -> None:
        self.name = name
        # Its number, 0 until the server has sent it.
        self.pid = 0
        self._code: int | None = None
        self._has_ended = threading.Event()

    def poll(self) -> int | None:
        """Return how it has ended; None while it runs."""
        return self._code

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end and return how it has ended."""
        if not self._has_ended.wait(timeout):
            raise subprocess.TimeoutExpired(self.name, timeout or 0.0)
        assert self._code is not None
        return self._code

    def mark_ended(self, code: int) -> None:
        """Take note of its end."""
        self._code = code
        self._has_ended.set()


class ForkServer:
    """Running fork server; leaving the context ends it and all that it has forked.

    It starts to import when it is made, so it is made before anything else is prepared. `words` start it.
    """

    def __init__(self, words: Sequence[str] = ("-m", "gslcosim_services", "--fork-server")) -> None:
        try:
            self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - `close` does
        except OSError as error:
            raise build_temporary_directory_error(error) from error
        self._socket, theirs = socket.socketpair()
        self._lines = JsonLines(self._socket)
        self._lock = threading.Lock()
        self._forked: dict[str, ForkedProcess] = {}
        self._is_gone = self._is_closing = self._was_asked = False
        self._code: int | None = None
        inherited = {key: value for key, value in os.environ.items() if not key.startswith("GSLCOSIM_JOIN")}
        with theirs:
            number = os.dup(theirs.fileno())
            self._process = spawn(
                FORK_SERVER,
                build_python_command(*words, str(number), TITLE_PADDING),
                environment={**inherited, **SINGLE_THREAD_VARIABLES},
                streams=Streams(stdout=self._log.fileno()),
                inherited=[number],
            )
        self.pid = self._process.pid
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @staticmethod
    def is_possible() -> bool:
        """Return whether this machine forks safely."""
        return sys.platform == "linux"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def has_failed(self) -> bool:
        """True when it has ended without a request to."""
        return self._is_gone and not self._is_closing

    def fork(self, name: str, request: Mapping[str, Any], *, log: Path) -> ForkedProcess:
        """Ask for a process."""
        process = ForkedProcess(name)
        with self._lock:
            self._was_asked = True
            if not self._is_gone:
                self._forked[name] = process
                with contextlib.suppress(OSError):
                    self._lines.send({"name": name, "log": str(log.resolve()), "request": request})
                    return process
                del self._forked[name]
        self._reader.join(CLOSE_TIMEOUT_S)
        how = "closed its socket" if self._code is None else describe_exit(self._code)
        raise SimulationFault(f"fork server: expected it to run, it {how}.")

    def release_unused(self) -> None:
        """Let the server end the forks that it keeps ready for processes without a request."""
        with contextlib.suppress(OSError), self._lock:
            self._lines.send({})

    def log_tail(self) -> str:
        """Return the last lines that it has written, each on a line of its own; empty when there are none."""
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").splitlines()[-5:]
        return "\n" + "\n".join(lines) if lines else ""

    def wake(self) -> None:
        """Continue a stopped server: it reports the ends of its forks."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGCONT)

    def wait_until_gone(self, limit_s: float) -> None:
        """Return when it has ended and all its forks with it, or after the limit."""
        self._reader.join(limit_s)

    def close(self) -> None:
        """End the server, and with it what it has forked."""
        self._is_closing = True
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        # A server without a request so far is still importing, and does not react meanwhile.
        self._reader.join(CLOSE_TIMEOUT_S if self._was_asked else 0.0)
        if self._reader.is_alive():
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)  # it may have no group of its own yet
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)
            self._reader.join()
        self._socket.close()
        self._log.close()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            for answer in self._lines:
                process = self._forked.get(answer["name"])
                if process is not None and "pid" in answer:
                    process.pid = answer["pid"]
                elif process is not None:
                    process.mark_ended(answer["code"])
        with self._lock:
            self._is_gone = True
        # Linux has killed them with it.
        for process in self._forked.values():
            if process.poll() is None:
                process.mark_ended(-signal.SIGKILL)
        self._code = self._process.wait()


@dataclass(frozen=True, kw_only=True)
class ForkWork:
    """Work of the forks of a server, of which the server is independent.

    `become` does the work of a request in a fork. `preload` imports the modules that all share; it starts no thread.
    `early` are long imports, by the name of their process: each process is forked before `preload`, and waits for its
    request. Such an import may start threads, which the server must not have.
    """

    become: Callable[[Mapping[str, Any]], None]
    preload: Callable[[], None]
    early: Mapping[str, Callable[[], None]]


def serve_forks(fd: int, work: ForkWork) -> None:
    """Serve requests from a socket until its other end is closed."""
    keep_memory_private()
    # Imported objects stay; collecting garbage among them would take a fifth of the start.
    gc.disable()
    server = _Server(socket.socket(fileno=fd), work)
    work.preload()
    gc.freeze()
    # 60 MB that forks alone need, a few of them each.
    release_code(_COMPILER)
    server.serve()


# A service can run without a log; the error that ends it is reported over the bus.
def _open_log(log: Path) -> int:
    try:
        return open_for_writing(log.parent, log.name, is_appended=True)
    except OSError:
        return os.open(os.devnull, os.O_RDWR)


def _become(work: ForkWork, order: dict[str, Any]) -> None:
    source, output = os.open(os.devnull, os.O_RDWR), _open_log(Path(order["log"]))
    for fd, target in ((source, 0), (output, 1), (output, 2)):
        os.dup2(fd, target)
    os.close(source)
    os.close(output)
    gc.enable()
    work.become(order["request"])


# Imports, then waits for its request.
def _await_order(work: ForkWork, name: str, requests: socket.socket) -> None:
    # An import that fails is reported by the service that needs it, in its log.
    with contextlib.suppress(Exception):
        work.early[name]()
    order = next(iter(JsonLines(requests)), None)
    if order is not None:
        requests.close()
        _become(work, order)


class _Server:
    def __init__(self, requests: socket.socket, work: ForkWork) -> None:
        # The supervisor handles Ctrl-C.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        self._work = work
        self._requests, self._lines = requests, JsonLines(requests)
        self._woken, self._waker = os.pipe()
        os.set_blocking(self._waker, False)
        signal.set_wakeup_fd(self._waker, warn_on_full_buffer=False)
        # With a handler of its own the signal writes to the descriptor; by default it would be discarded.
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        self._names: dict[int, str] = {}
        # Forks that wait for their request, with the sockets over which it comes.
        self._preforked: dict[str, tuple[int, socket.socket]] = {}
        # A process that cannot be forked now is forked at its request.
        with contextlib.suppress(OSError):
            for name in work.early:
                ours, theirs = socket.socketpair()
                with theirs:
                    unwanted = [*self._open_descriptors, ours.fileno()]
                    pid = fork_child(partial(_await_order, work, name, theirs), unwanted=unwanted)
                self._preforked[name] = (pid, ours)

    def serve(self) -> None:
        is_open = True
        while is_open:
            readable, _, _ = select.select([self._requests, self._woken], [], [])
            if self._woken in readable:
                os.read(self._woken, _READ_BYTES)
            if self._requests in readable:
                is_open = self._take_requests()
            with contextlib.suppress(ChildProcessError):
                while (ended := os.waitpid(-1, os.WNOHANG))[0]:
                    code = os.waitstatus_to_exitcode(ended[1])
                    self._send({"name": self._names.pop(ended[0], ""), "code": code})
        self._dismiss_preforked()
        for pid in self._names:
            # A process that has just begun leads no group yet.
            for kill in (os.killpg, os.kill):
                with contextlib.suppress(ProcessLookupError):
                    kill(pid, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, 0)

    def _take_requests(self) -> bool:
        try:
            orders = self._lines.receive()
        except ConnectionError:
            return False
        for order in orders or ():
            if order:
                self._start(order)
            else:
                self._dismiss_preforked()
        return orders is not None

    def _start(self, order: dict[str, Any]) -> None:
        name = str(order["name"])
        pid = self._hand_over(name, order)
        if not pid:
            try:
                pid = fork_child(lambda: _become(self._work, order), unwanted=self._open_descriptors)
            except OSError as error:
                text, log = format_machine_error(error, name, "one process more"), Path(order["log"])
                with contextlib.suppress(OSError):
                    append_bytes(log.parent, log.name, f"{text}\n".encode())
                self._send({"name": name, "code": int(ExitCode.FAULT)})
                return
        self._names[pid] = name
        self._send({"name": name, "pid": pid})

    # Sends an order to the fork that has its imports; returns 0 if there is none, or it has ended.
    def _hand_over(self, name: str, order: dict[str, Any]) -> int:
        if name not in self._preforked:
            return 0
        pid, connection = self._preforked.pop(name)
        with connection, contextlib.suppress(OSError):
            JsonLines(connection).send(order)
            return pid
        return 0

    @property
    def _open_descriptors(self) -> list[int]:
        waiting = (connection.fileno() for _, connection in self._preforked.values())
        return [self._requests.fileno(), self._woken, self._waker, *waiting]

    def _dismiss_preforked(self) -> None:
        for pid, connection in self._preforked.values():
            connection.close()
            with contextlib.suppress(ProcessLookupError, ChildProcessError):
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
        self._preforked.clear()

    def _send(self, answer: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):
            self._lines.send(answer)
