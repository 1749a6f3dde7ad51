"""Client of the fork server: starts it, asks it for processes, and knows how they ended."""

import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NoReturn, Self

from gslcosim.base.errors import SimulationFault
from gslcosim.base.files import build_temporary_directory_error
from gslcosim.base.processes import build_parent_death_prefix, build_python_command, describe_exit
from gslcosim.runtime.processes.current_process import set_process_title

if TYPE_CHECKING:
    from gslcosim.bus.interface import JoinData
    from gslcosim.runtime.processes.children import ProcessHandle
    from gslcosim.scenario import Scenario

FORK_SERVER = "fork_server"
WARMUP_PROCESS = "warm-up"
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


def _start_server(theirs: socket.socket, log: IO[bytes]) -> "subprocess.Popen[bytes]":
    inherited = {key: value for key, value in os.environ.items() if not key.startswith("GSLCOSIM_JOIN")}
    command = build_python_command("-m", "gslcosim_services", "--fork-server", str(theirs.fileno()), TITLE_PADDING)
    return subprocess.Popen(
        [*build_parent_death_prefix(), *command],
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        env={**inherited, **SINGLE_THREAD_VARIABLES},
        pass_fds=[theirs.fileno()],
        start_new_session=True,
    )


class _SelfFork:
    """A fork server that was forked, as `subprocess.Popen` shows one that was started."""

    def __init__(self, theirs: socket.socket, log: IO[bytes], unwanted: Sequence[int]) -> None:
        self._code: int | None = None
        parent = os.getpid()
        self.pid = os.fork()
        if self.pid == 0:
            self._become_server(parent, theirs, log, unwanted)

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

    # Never returns, whatever happens: what follows is the supervisor's.
    def _become_server(self, parent: int, theirs: socket.socket, log: IO[bytes], unwanted: Sequence[int]) -> NoReturn:
        code = 1
        try:
            from gslcosim.runtime.processes import fork_server
            from gslcosim.runtime.processes.fork_server import end_with_parent

            end_with_parent(parent)
            os.setsid()
            nothing = os.open(os.devnull, os.O_RDONLY)
            for fd, target in ((nothing, 0), (log.fileno(), 1), (log.fileno(), 2)):
                os.dup2(fd, target)
            for fd in (nothing, *unwanted):
                os.close(fd)
            set_process_title(f"{sys.executable} -P -m gslcosim_services --fork-server {theirs.fileno()}")
            fork_server.serve_requests(theirs, fork_server.prefork_children(theirs.fileno()))
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

    def __init__(self, start: "Callable[[socket.socket, IO[bytes]], ProcessHandle] | None" = None) -> None:
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
    def fork_this_process(cls, unwanted: Sequence[int] = ()) -> Self:
        """Return a fork server that is a fork of this process, which has imported what services share.

        This process must have one thread.

        Args:
            unwanted: Descriptors that are none of the fork's business.
        """
        return cls(lambda theirs, log: _SelfFork(theirs, log, unwanted))

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

    def fork(self, name: str, services: Sequence[str], *, join: "JoinData", log: Path) -> ForkedProcess:
        """Ask for a process that serves.

        Args:
            name: Of the process.
            services: What it serves.
            join: How it joins the run.
            log: Where its output goes.

        Raises:
            SimulationFault: the fork server has ended.
        """
        request = {"services": list(services), "join": join.model_dump(exclude_none=True)}
        return self._ask(name, request, log)

    def warm_up(self, scenario: "Scenario", directory: Path) -> ForkedProcess | None:
        """Let a fork compile the kernels of a scenario's services while its environment is made, as far as it comes.

        Args:
            scenario: What will be run; its environment is any but one with a `path`.
            directory: Where its relative paths start.

        Returns:
            The fork; None where the server has ended, which the caller is informed of.
        """
        from gslcosim.runtime.early_warmup import build_warmup_request

        with contextlib.suppress(SimulationFault):
            return self._ask(WARMUP_PROCESS, {"warm_up": build_warmup_request(scenario, directory)}, Path(os.devnull))
        return None

    def release_unused(self) -> None:
        """Let the server end what it keeps ready for services that this run does not have."""
        with contextlib.suppress(OSError), self._lock:
            self._socket.sendall(b"{}\n")

    def _ask(self, name: str, request: dict[str, Any], log: Path) -> ForkedProcess:
        process = ForkedProcess(name)
        request = {"name": name, "log": str(log.resolve()), **request}
        with self._lock:
            if self._is_gone:
                raise SimulationFault(self._end_text())
            self._forked[name] = process
            try:
                self._socket.sendall(json.dumps(request).encode() + b"\n")
            except OSError as error:
                del self._forked[name]
                raise SimulationFault(self._end_text()) from error
        return process

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
