"""Fork server: a process that imports once what others share, then becomes each of them by a fork.

It has one thread. It reads requests, one JSON object a line, from a socket that it inherits, and answers
`{"started": name, "pid": n}` and `{"ended": name, "code": n}`. It holds nothing of a run: what a process is given comes
with its request and exists in the fork alone. At the end of the requests it ends what is left.

`ForkServer` starts one and asks it for processes; `serve_forks` is the server itself. What forks do is not known
here: whoever serves hands it in.
"""

import contextlib
import ctypes
import gc
import json
import math
import os
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NoReturn, Self

from gslcosim.base.errors import ExitCode, SimulationFault, format_machine_error
from gslcosim.base.files import append_bytes, build_temporary_directory_error, open_for_writing
from gslcosim.base.processes import build_python_command, describe_exit
from gslcosim.base.spawn import ProcessHandle, Streams, spawn
from gslcosim.runtime.processes.current_process import keep_memory_private, set_process_title

FORK_SERVER = "fork_server"
CLOSE_TIMEOUT_S = 2.0
# A service needs no threads for linear algebra, and a process that forks must have none.
SINGLE_THREAD_VARIABLES = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1") | {
    # Each of many threads would keep a heap of its own, of 20 MB together in the recorder.
    "MALLOC_ARENA_MAX": "2"
}
TITLE_PADDING = "." * 200
_POLL_PERIOD_S = 0.005


class ForkedProcess:
    """A process of the fork server's, to the supervisor like one of its own."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._pid = 0
        self._code: int | None = None
        self._has_ended = threading.Event()

    @property
    def pid(self) -> int:
        """Its number, 0 until the server has sent it."""
        return self._pid

    def poll(self) -> int | None:
        """Return how it has ended; None while it runs."""
        return self._code

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end and return how it has ended.

        Raises:
            subprocess.TimeoutExpired: it has not ended within the time.
        """
        if not self._has_ended.wait(timeout):
            raise subprocess.TimeoutExpired(self.name, timeout or 0.0)
        assert self._code is not None
        return self._code

    def mark_started(self, pid: int) -> None:
        """Take note of its number."""
        self._pid = pid

    def mark_ended(self, code: int) -> None:
        """Take note of its end."""
        self._code = code
        self._has_ended.set()


def _open_temporary_log() -> IO[bytes]:
    try:
        return tempfile.TemporaryFile()
    except OSError as error:
        raise build_temporary_directory_error(error) from error


def _start_server(theirs: socket.socket, log: IO[bytes]) -> ProcessHandle:
    inherited = {key: value for key, value in os.environ.items() if not key.startswith("GSLCOSIM_JOIN")}
    number = os.dup(theirs.fileno())
    return spawn(
        FORK_SERVER,
        build_python_command("-m", "gslcosim_services", "--fork-server", str(number), TITLE_PADDING),
        environment={**inherited, **SINGLE_THREAD_VARIABLES},
        streams=Streams(stdout=log.fileno()),
        inherited=[number],
    )


class _SelfFork:
    """A fork server that was forked, as `subprocess.Popen` shows one that was started."""

    def __init__(self, work: "ForkWork", theirs: socket.socket, log: IO[bytes], unwanted: Sequence[int]) -> None:
        self._code: int | None = None
        parent = os.getpid()
        self.pid = os.fork()
        if self.pid == 0:
            _become_server(work, parent, theirs, log, unwanted)

    def poll(self) -> int | None:
        """Return how it has ended; None while it runs."""
        if self._code is None and (status := os.waitpid(self.pid, os.WNOHANG))[0]:
            self._code = os.waitstatus_to_exitcode(status[1])
        return self._code

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end and return how it has ended.

        Raises:
            subprocess.TimeoutExpired: it has not ended within the time.
        """
        deadline_s = math.inf if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > deadline_s:
                raise subprocess.TimeoutExpired(FORK_SERVER, timeout or 0.0)
            time.sleep(_POLL_PERIOD_S)
        return code


# Never returns, whatever happens: what follows is its parent's.
def _become_server(
    work: "ForkWork", parent: int, theirs: socket.socket, log: IO[bytes], unwanted: Sequence[int]
) -> NoReturn:
    code = 1
    try:
        end_with_parent(parent)
        os.setsid()
        nothing = os.open(os.devnull, os.O_RDONLY)
        for fd, target in ((nothing, 0), (log.fileno(), 1), (log.fileno(), 2)):
            os.dup2(fd, target)
        for fd in (nothing, *unwanted):
            os.close(fd)
        set_process_title(f"{sys.executable} -P -m gslcosim_services --fork-server {theirs.fileno()}")
        _serve_requests(theirs, work, _prefork(work, theirs.fileno()))
        code = 0
    except BaseException:  # told in the log, as by an interpreter that ends
        traceback.print_exc()
    finally:
        os._exit(code)


class ForkServer:
    """Running fork server; leaving the context ends it and all that it has forked.

    It starts to import when it is made, so it is made before anything else is prepared.

    Args:
        start: Starts its process, given its end of the socket and its log; by default a process of its own.

    Raises:
        MachineError: it cannot be started.
    """

    def __init__(self, start: Callable[[socket.socket, IO[bytes]], ProcessHandle] | None = None) -> None:
        self._log = _open_temporary_log()
        self._socket, theirs = socket.socketpair()
        self._lock = threading.Lock()
        self._forked: dict[str, ForkedProcess] = {}
        self._is_gone = self._is_closing = False
        with theirs:
            self._process = (start or _start_server)(theirs, self._log)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @classmethod
    def fork_this_process(cls, work: "ForkWork", unwanted: Sequence[int] = ()) -> Self:
        """Return a fork server that is a fork of this process, which has imported what its forks share.

        This process must have one thread.

        Args:
            work: What its forks do.
            unwanted: Descriptors that are none of the fork's business.
        """
        return cls(lambda theirs, log: _SelfFork(work, theirs, log, unwanted))

    @staticmethod
    def is_possible() -> bool:
        """Return whether this machine forks safely."""
        return sys.platform == "linux"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def has_failed(self) -> bool:
        """True when it has ended without a request to."""
        return self._is_gone and not self._is_closing

    def fork(self, name: str, request: Mapping[str, Any], *, log: Path) -> ForkedProcess:
        """Ask for a process.

        Args:
            name: Of the process.
            request: What it shall do, as JSON knows it.
            log: Where its output goes.

        Raises:
            SimulationFault: the fork server has ended.
        """
        process = ForkedProcess(name)
        line = json.dumps({"name": name, "log": str(log.resolve()), "request": request}).encode() + b"\n"
        with self._lock:
            if self._is_gone:
                raise SimulationFault(self._end_text())
            self._forked[name] = process
            try:
                self._socket.sendall(line)
            except OSError as error:
                del self._forked[name]
                raise SimulationFault(self._end_text()) from error
        return process

    def release_unused(self) -> None:
        """Let the server end what it keeps ready for processes that nobody has asked for."""
        with contextlib.suppress(OSError), self._lock:
            self._socket.sendall(b"{}\n")

    def log_tail(self) -> str:
        """Return the last lines that it has written, each on a line of its own; empty when there are none."""
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").splitlines()[-5:]
        return "\n" + "\n".join(lines) if lines else ""

    def wake(self) -> None:
        """Let the server go on where it has been stopped: it reports how its forks end."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._process.pid, signal.SIGCONT)

    def wait_until_gone(self, limit_s: float) -> None:
        """Return when it has ended and all its forks with it, or after the limit."""
        self._reader.join(limit_s)

    def close(self) -> None:
        """End the server, and with it what it has forked."""
        self._is_closing = True
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        try:
            self._process.wait(CLOSE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        self._reader.join()
        self._socket.close()
        self._log.close()

    def _read(self) -> None:
        unread = b""
        with contextlib.suppress(OSError):
            while received := self._socket.recv(1 << 16):
                *lines, unread = (unread + received).split(b"\n")
                for line in lines:
                    self._receive(json.loads(line))
        with self._lock:
            self._is_gone = True
        # Linux has killed them with it.
        for process in self._forked.values():
            if process.poll() is None:
                process.mark_ended(-signal.SIGKILL)

    def _receive(self, answer: dict[str, str | int]) -> None:
        name = str(answer.get("started") or answer.get("ended"))
        process = self._forked.get(name)
        if process is None:
            return
        if "started" in answer:
            process.mark_started(int(answer["pid"]))
        else:
            process.mark_ended(int(answer["code"]))

    def _end_text(self) -> str:
        try:
            how = describe_exit(self._process.wait(CLOSE_TIMEOUT_S))
        except subprocess.TimeoutExpired:
            how = "closed its socket"
        return f"fork server: expected it to run, it {how}."


_PR_SET_PDEATHSIG = 1
_MAX_REQUEST_BYTES = 1 << 16


@dataclass(frozen=True, kw_only=True)
class ForkWork:
    """Work of the forks of a server, which knows nothing of it.

    `become` does in a fork what a request asks for. `preload` imports what all share; it starts no thread. `early` are
    imports of processes that import for long, by the name of the process: each is forked before `preload`, and waits
    until it is asked for. It may start threads, which the server must not have.
    """

    become: Callable[[Mapping[str, Any]], None]
    preload: Callable[[], None]
    early: Mapping[str, Callable[[], None]]


def serve_forks(fd: int, work: ForkWork) -> None:
    """Serve requests from a socket until its other end is closed.

    Args:
        fd: The socket's file descriptor.
        work: What forks do.
    """
    keep_memory_private()
    # What is imported stays; looking through it for garbage would take a fifth of the start.
    gc.disable()
    children = _prefork(work, fd)
    work.preload()
    gc.freeze()
    _serve_requests(socket.socket(fileno=fd), work, children)


# Where there is no room for a process more, it is forked when it is asked for.
def _prefork(work: ForkWork, fd: int) -> "dict[str, _PreforkedChild]":
    children: dict[str, _PreforkedChild] = {}
    with contextlib.suppress(OSError):
        for name in work.early:
            children[name] = _PreforkedChild(name, work, [fd, *(child.fd for child in children.values())])
    return children


def _serve_requests(requests: socket.socket, work: ForkWork, children: "dict[str, _PreforkedChild]") -> None:
    # Ctrl-C is the supervisor's to handle.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Server(requests, work, children).serve()


def end_with_parent(parent: int) -> None:
    """Let Linux end this process when the one that has forked it ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


# Never returns, whatever happens: there must be one server. `unwanted` are descriptors that are none of its business.
def _child_main(work: ForkWork, order: dict[str, Any], parent: int, unwanted: Sequence[int]) -> NoReturn:
    code = 1
    try:
        end_with_parent(parent)
        with contextlib.suppress(PermissionError):  # it leads a session already
            os.setsid()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for fd in unwanted:
            os.close(fd)
        _redirect_output(order["log"])
        gc.enable()
        work.become(order["request"])
        code = 0
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    except BaseException:  # told in the log, as by an interpreter that ends
        traceback.print_exc()
    finally:
        exit_fork(code)


def exit_fork(code: int) -> NoReturn:
    """End a process that was forked, with what it has written, and without what its parent would do at its end."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


# A service without a log can fly; what ends it is reported over the bus.
def _redirect_output(log: str) -> None:
    nothing = os.open(os.devnull, os.O_RDWR)
    try:
        output = open_for_writing(Path(log).parent, Path(log).name, is_appended=True)
    except OSError:
        output = os.dup(nothing)
    for fd, target in ((nothing, 0), (output, 1), (output, 2)):
        os.dup2(fd, target)
    os.close(nothing)
    os.close(output)


class _PreforkedChild:
    # Fork that becomes what it is asked to be; until then it imports and waits. Raises OSError where there is no room.
    def __init__(self, name: str, work: ForkWork, unwanted: Sequence[int]) -> None:
        self._socket, theirs = socket.socketpair()
        server = os.getpid()
        with theirs:
            self.pid = os.fork()
            if self.pid == 0:
                self._socket.close()
                _preforked_main(name, work, server, theirs, unwanted)

    @property
    def fd(self) -> int:
        """The server's descriptor of it."""
        return self._socket.fileno()

    def take(self, order: dict[str, Any]) -> bool:
        """Hand it what it shall become; return whether it lives."""
        with self._socket:
            try:
                self._socket.sendall(json.dumps(order).encode() + b"\n")
            except OSError:
                return False
        return True

    def shut_down(self) -> None:
        """End it: nobody needs it."""
        self._socket.close()
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)


# Never returns, whatever happens: there must be one server.
def _preforked_main(
    name: str, work: ForkWork, server: int, requests: socket.socket, unwanted: Sequence[int]
) -> NoReturn:
    try:
        end_with_parent(server)
        os.setsid()
        # Ctrl-C is the supervisor's to handle.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for fd in unwanted:
            os.close(fd)
        # What cannot be imported is reported by the service that needs it, in its log.
        with contextlib.suppress(Exception):
            work.early[name]()
        request = b""
        while not request.endswith(b"\n"):
            received = requests.recv(_MAX_REQUEST_BYTES)
            if not received:
                os._exit(0)
            request += received
        _child_main(work, json.loads(request), server, [requests.fileno()])
    finally:
        os._exit(1)


class _Server:
    def __init__(self, requests: socket.socket, work: ForkWork, children: dict[str, _PreforkedChild]) -> None:
        self._work = work
        self._requests = requests
        self._preforked = children
        self._unread = b""
        self._names: dict[int, str] = {}
        self._woken, self._waker = os.pipe()
        self._pid = os.getpid()

    def serve(self) -> None:
        os.set_blocking(self._waker, False)
        signal.set_wakeup_fd(self._waker, warn_on_full_buffer=False)
        # With a handler of its own the signal writes to the descriptor; by default it would be discarded.
        signal.signal(signal.SIGCHLD, _ignore_signal)
        with selectors.DefaultSelector() as selector:
            selector.register(self._requests, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            is_open = True
            while is_open:
                for key, _ in selector.select():
                    if key.fileobj is self._requests:
                        is_open = self._take_requests()
                    else:
                        os.read(self._woken, _MAX_REQUEST_BYTES)
                self._report_ended_children()
        self._dismiss_preforked()
        for pid in self._names:
            # One that has just begun leads no group yet.
            for kill in (os.killpg, os.kill):
                with contextlib.suppress(ProcessLookupError):
                    kill(pid, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, 0)

    def _take_requests(self) -> bool:
        try:
            received = self._requests.recv(_MAX_REQUEST_BYTES)
        except ConnectionError:
            return False
        *lines, self._unread = (self._unread + received).split(b"\n")
        for line in lines:
            order = json.loads(line)
            if order:
                self._start(order)
            else:
                self._dismiss_preforked()
        return bool(received)

    def _start(self, order: dict[str, Any]) -> None:
        name = str(order["name"])
        child = self._preforked.pop(name, None)
        if child is not None and child.take(order):
            self._has_started(name, child.pid)
        else:
            self._fork(name, order)

    def _fork(self, name: str, order: dict[str, Any]) -> None:
        try:
            pid = os.fork()
        except OSError as error:
            text, log = format_machine_error(error, name, "one process more"), Path(order["log"])
            with contextlib.suppress(OSError):
                append_bytes(log.parent, log.name, f"{text}\n".encode())
            self._send({"ended": name, "code": int(ExitCode.FAULT)})
            return
        if pid == 0:
            _child_main(self._work, order, self._pid, self._open_descriptors)
        self._has_started(name, pid)

    def _has_started(self, name: str, pid: int) -> None:
        self._names[pid] = name
        self._send({"started": name, "pid": pid})

    @property
    def _open_descriptors(self) -> list[int]:
        children = [child.fd for child in self._preforked.values()]
        return [self._requests.fileno(), self._woken, self._waker, *children]

    def _dismiss_preforked(self) -> None:
        for child in self._preforked.values():
            child.shut_down()
            with contextlib.suppress(ChildProcessError):
                os.waitpid(child.pid, 0)
        self._preforked.clear()

    def _report_ended_children(self) -> None:
        with contextlib.suppress(ChildProcessError):
            while self._names:
                pid, status = os.waitpid(-1, os.WNOHANG)
                if pid == 0:
                    return
                self._send({"ended": self._names.pop(pid, ""), "code": os.waitstatus_to_exitcode(status)})

    def _send(self, answer: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):
            self._requests.sendall(json.dumps(answer).encode() + b"\n")


def _ignore_signal(number: int, frame: object) -> None:
    del number, frame
