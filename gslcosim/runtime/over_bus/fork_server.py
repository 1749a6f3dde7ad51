"""The fork server: imports what services share once, then becomes each of them by a fork.

It runs in a process of its own with one thread. It reads requests, one JSON object a line, from a socket that it
inherits, and answers `{"started": name, "pid": n}` and `{"ended": name, "code": n}`. It holds nothing of a run: what a
service is given comes with its request and exists in the fork alone. At the end of the requests it ends what is left.
"""

import contextlib
import gc
import importlib
import json
import os
import selectors
import signal
import socket
from collections.abc import Generator
from pathlib import Path
from typing import Any

from gslcosim.errors import ExitCode
from gslcosim.machine import machine_text
from gslcosim.runtime.over_bus.apprentice import Apprentice
from gslcosim.runtime.over_bus.forked import become
from gslcosim.runtime.privacy import keep_memory_private
from gslcosim.safe_files import append_to

_MOST_BYTES = 1 << 16


def main(fd: int) -> None:
    """Serve requests from a socket until its other end is closed.

    Args:
        fd: The socket's file descriptor.
    """
    keep_memory_private()
    # What is imported stays; looking through it for garbage would take a fifth of the start.
    gc.disable()
    apprentices = begin_apprentices(fd)
    import_what_services_share()
    gc.freeze()
    serve_requests(socket.socket(fileno=fd), apprentices)


def serve_requests(requests: socket.socket, apprentices: dict[str, Apprentice]) -> None:
    """Serve requests from a socket until its other end is closed; what services share has been imported.

    Args:
        requests: The socket.
        apprentices: By the service that each will become.
    """
    # Ctrl-C is the supervisor's to handle.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Server(requests, apprentices).serve()


def begin_apprentices(fd: int) -> dict[str, Apprentice]:
    """Fork who will become the services that import for long; where there is no room for one it is forked later.

    Args:
        fd: The descriptor of the requests, which is none of theirs.
    """
    from gslcosim.runtime.participants import default_services

    apprentices: dict[str, Apprentice] = {}
    with contextlib.suppress(OSError):
        for kind in default_services():
            if kind.import_early is not None:
                others = [apprentice.fd for apprentice in apprentices.values()]
                apprentices[kind.name] = Apprentice(kind.import_early, [fd, *others])
    return apprentices


def import_what_services_share() -> None:
    """Import what several services need, and load the compiler of their kernels; starts no thread."""
    from gslcosim.runtime.participants import default_services

    # Otherwise MuJoCo imports what opens windows, which starts a process to look for it; pictures need none of it.
    with _variable("MUJOCO_GL", "disable"):
        for module in ("gslcosim.bus.zenoh_bus", "gslcosim.runtime.assembly", "gslcosim.runtime.over_bus.host"):
            importlib.import_module(module)
        for kind in default_services():
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
    def __init__(self, requests: socket.socket, apprentices: dict[str, Apprentice]) -> None:
        self._requests = requests
        self._apprentices = apprentices
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
        self._dismiss_apprentices()
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
            request = json.loads(line)
            if "services" in request or "rehearse" in request:
                self._start(request)
            else:
                self._dismiss_apprentices()
        return bool(received)

    def _start(self, request: dict[str, Any]) -> None:
        name = str(request["name"])
        apprentice = self._apprentices.pop(name, None) if request.get("services") == [name] else None
        if apprentice is not None and apprentice.take(request):
            self._has_started(name, apprentice.pid)
        else:
            self._fork(name, request)

    def _fork(self, name: str, request: dict[str, Any]) -> None:
        try:
            pid = os.fork()
        except OSError as error:
            text = machine_text(error, name, "one process more")
            with contextlib.suppress(OSError):
                append_to(Path(request["log"]).parent, Path(request["log"]).name, f"{text}\n".encode())
            self._tell({"ended": name, "code": int(ExitCode.FAULT)})
            return
        if pid == 0:
            become(request, self._pid, self._open_descriptors)
        self._has_started(name, pid)

    def _has_started(self, name: str, pid: int) -> None:
        self._names[pid] = name
        self._tell({"started": name, "pid": pid})

    @property
    def _open_descriptors(self) -> list[int]:
        apprentices = [apprentice.fd for apprentice in self._apprentices.values()]
        return [self._requests.fileno(), self._woken, self._waker, *apprentices]

    def _dismiss_apprentices(self) -> None:
        for apprentice in self._apprentices.values():
            apprentice.dismiss()
            with contextlib.suppress(ChildProcessError):
                os.waitpid(apprentice.pid, 0)
        self._apprentices.clear()

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
