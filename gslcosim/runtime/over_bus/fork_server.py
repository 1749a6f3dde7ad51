"""The fork server: imports what services share once, then becomes each of them by a fork.

It runs in a process of its own with one thread. It reads requests, one JSON object a line, from a socket that it
inherits, and answers `{"started": name, "pid": n}` and `{"ended": name, "code": n}`. It holds nothing of a run: what a
service is given comes with its request and exists in the fork alone. At the end of the requests it ends what is left.
"""

import contextlib
import ctypes
import gc
import importlib
import json
import os
import selectors
import signal
import socket
import sys
import traceback
from collections.abc import Generator
from pathlib import Path
from typing import Any

from gslcosim.bus.port import Join
from gslcosim.errors import ExitCode
from gslcosim.machine import machine_text
from gslcosim.runtime.privacy import keep_memory_private
from gslcosim.runtime.process_title import set_process_title
from gslcosim.safe_files import append_to, open_for_writing

_PR_SET_PDEATHSIG = 1
_MOST_BYTES = 1 << 16


def main(fd: int) -> None:
    """Serve requests from a socket until its other end is closed.

    Args:
        fd: The socket's file descriptor.
    """
    keep_memory_private()
    # What is imported stays; looking through it for garbage would take a fifth of the start.
    gc.disable()
    import_what_services_share()
    gc.freeze()
    serve_requests(socket.socket(fileno=fd))


def serve_requests(requests: socket.socket) -> None:
    """Serve requests from a socket until its other end is closed; what services share has been imported."""
    # Ctrl-C is the supervisor's to handle.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Server(requests).serve()


def import_what_services_share() -> None:
    """Import what several services need, and load the compiler of their kernels; starts no thread."""
    from gslcosim.runtime.participants import SERVICES

    # Otherwise MuJoCo imports what opens windows, which starts a process to look for it; pictures need none of it.
    with _variable("MUJOCO_GL", "disable"):
        for module in ("gslcosim.bus.zenoh_bus", "gslcosim.runtime.assembly", "gslcosim.runtime.over_bus.host"):
            importlib.import_module(module)
        for kind in SERVICES:
            for module in kind.preloads:
                importlib.import_module(module)
    # The first kernel that a process calls loads numba's compiler, a fifth of a second: once here, not in each fork.
    importlib.import_module("gslcosim.environment.sight_kernels").to_next_border(0.5, 0, 1.0)
    # Each service tells it; it is made from the descriptions of all messages.
    importlib.import_module("gslcosim.contract.schema").contract_hash()


@contextlib.contextmanager
def _variable(name: str, value: str) -> Generator[None]:
    before = os.environ.get(name)
    os.environ[name] = before or value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]


class _Server:
    def __init__(self, requests: socket.socket) -> None:
        self._requests = requests
        self._unread = b""
        self._names: dict[int, str] = {}
        self._woken, self._waker = os.pipe()
        self._pid = os.getpid()

    def serve(self) -> None:
        os.set_blocking(self._waker, False)
        signal.set_wakeup_fd(self._waker, warn_on_full_buffer=False)
        # With a handler of its own the signal writes to the descriptor; by default it would be discarded.
        signal.signal(signal.SIGCHLD, _note_nothing)
        with selectors.DefaultSelector() as selector:
            selector.register(self._requests, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            is_open = True
            while is_open:
                for key, _ in selector.select():
                    if key.fileobj is self._requests:
                        is_open = self._take_requests()
                    else:
                        os.read(self._woken, _MOST_BYTES)
                self._tell_who_ended()
        for pid in self._names:
            # One that has just begun leads no group yet.
            for kill in (os.killpg, os.kill):
                with contextlib.suppress(ProcessLookupError):
                    kill(pid, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, 0)

    def _take_requests(self) -> bool:
        try:
            received = self._requests.recv(_MOST_BYTES)
        except ConnectionError:
            return False
        *lines, self._unread = (self._unread + received).split(b"\n")
        for line in lines:
            self._fork(json.loads(line))
        return bool(received)

    def _fork(self, request: dict[str, Any]) -> None:
        name = str(request["name"])
        try:
            pid = os.fork()
        except OSError as error:
            text = machine_text(error, name, "one process more")
            with contextlib.suppress(OSError):
                append_to(Path(request["log"]).parent, Path(request["log"]).name, f"{text}\n".encode())
            self._tell({"ended": name, "code": int(ExitCode.FAULT)})
            return
        if pid == 0:
            self._become(request)
        self._names[pid] = name
        self._tell({"started": name, "pid": pid})

    # Never returns, whatever happens: there must be one server.
    def _become(self, request: dict[str, Any]) -> None:
        code = 1
        try:
            end_with_parent(self._pid)
            os.setsid()
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for fd in (self._woken, self._waker):
                os.close(fd)
            self._requests.close()
            _write_to(request["log"])
            gc.enable()
            if "rehearse" in request:
                from gslcosim.runtime.over_bus.still_air import rehearse_requested

                rehearse_requested(request["rehearse"])
                os._exit(0)
            names = [str(name) for name in request["services"]]
            set_process_title(f"{sys.executable} -P -m gslcosim_services {' '.join(names)}")
            from gslcosim.runtime.over_bus.service import serve

            serve(names, Join.model_validate(request["join"]))
            code = 0
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 1
        except BaseException:  # told in the log, as by an interpreter that ends
            traceback.print_exc()
        finally:
            with contextlib.suppress(OSError, ValueError):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(code)

    def _tell_who_ended(self) -> None:
        with contextlib.suppress(ChildProcessError):
            while self._names:
                pid, status = os.waitpid(-1, os.WNOHANG)
                if pid == 0:
                    return
                self._tell({"ended": self._names.pop(pid, ""), "code": os.waitstatus_to_exitcode(status)})

    def _tell(self, answer: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):
            self._requests.sendall(json.dumps(answer).encode() + b"\n")


def _note_nothing(number: int, frame: object) -> None:
    del number, frame


def end_with_parent(parent: int) -> None:
    """Let Linux end this process when the one that has forked it ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


# A service without a log can fly; what ends it is told over the bus.
def _write_to(log: str) -> None:
    nothing = os.open(os.devnull, os.O_RDWR)
    try:
        output = open_for_writing(Path(log).parent, Path(log).name, is_appended=True)
    except OSError:
        output = os.dup(nothing)
    for fd, target in ((nothing, 0), (output, 1), (output, 2)):
        os.dup2(fd, target)
    os.close(nothing)
    os.close(output)
