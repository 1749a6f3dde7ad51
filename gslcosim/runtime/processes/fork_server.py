"""Fork server: imports once what services share, then becomes each of them by a fork.

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
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from gslcosim.base.errors import ExitCode, format_machine_error
from gslcosim.base.files import append_bytes, open_for_writing
from gslcosim.bus.interface import JoinData
from gslcosim.runtime.processes.current_process import keep_memory_private, set_process_title

_PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int) -> None:
    """Let Linux end this process when the one that has forked it ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def child_main(request: dict[str, Any], parent: int, unwanted: Sequence[int]) -> NoReturn:
    """Do in this fork what is requested, and end it, whatever happens: there must be one server.

    Args:
        request: `log`, and either `warm_up`, or `services` and `join`.
        parent: The process that has forked this one.
        unwanted: Descriptors that are none of its business.
    """
    code = 1
    try:
        end_with_parent(parent)
        with contextlib.suppress(PermissionError):  # it leads a session already
            os.setsid()
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for fd in unwanted:
            os.close(fd)
        _redirect_output(request["log"])
        gc.enable()
        if "warm_up" in request:
            from gslcosim.runtime.early_warmup import run_warmup_request

            run_warmup_request(request["warm_up"])
            os._exit(0)
        names = [str(name) for name in request["services"]]
        set_process_title(f"{sys.executable} -P -m gslcosim_services {' '.join(names)}")
        from gslcosim.runtime.distributed.service_main import serve

        serve(names, JoinData.model_validate(request["join"]))
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


_MAX_REQUEST_BYTES = 1 << 16


class PreforkedChild:
    """Fork of the fork server that becomes a service when it is asked to; until then it imports and waits.

    What it imports may start threads, which the server must not have.

    Args:
        import_early: Imports.
        unwanted: Descriptors of the server that are none of its business.

    Raises:
        OSError: there is no room for a process more.
    """

    def __init__(self, import_early: Callable[[], None], unwanted: Sequence[int]) -> None:
        self._socket, theirs = socket.socketpair()
        server = os.getpid()
        with theirs:
            self.pid = os.fork()
            if self.pid == 0:
                self._socket.close()
                _preforked_main(import_early, server, theirs, unwanted)

    @property
    def fd(self) -> int:
        """The server's descriptor of it."""
        return self._socket.fileno()

    def take(self, request: dict[str, Any]) -> bool:
        """Hand it what it shall become; return whether it lives."""
        with self._socket:
            try:
                self._socket.sendall(json.dumps(request).encode() + b"\n")
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
    import_early: Callable[[], None], server: int, requests: socket.socket, unwanted: Sequence[int]
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
            import_early()
        request = b""
        while not request.endswith(b"\n"):
            received = requests.recv(_MAX_REQUEST_BYTES)
            if not received:
                os._exit(0)
            request += received
        child_main(json.loads(request), server, [requests.fileno()])
    finally:
        os._exit(1)


def main(fd: int) -> None:
    """Serve requests from a socket until its other end is closed.

    Args:
        fd: The socket's file descriptor.
    """
    keep_memory_private()
    # What is imported stays; looking through it for garbage would take a fifth of the start.
    gc.disable()
    children = prefork_children(fd)
    import_shared_modules()
    gc.freeze()
    serve_requests(socket.socket(fileno=fd), children)


def serve_requests(requests: socket.socket, children: dict[str, PreforkedChild]) -> None:
    """Serve requests from a socket until its other end is closed; what services share has been imported.

    Args:
        requests: The socket.
        children: By the service that each will become.
    """
    # Ctrl-C is the supervisor's to handle.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Server(requests, children).serve()


def prefork_children(fd: int) -> dict[str, PreforkedChild]:
    """Fork who will become the services that import for long; where there is no room for one it is forked later.

    Args:
        fd: The descriptor of the requests, which is none of theirs.
    """
    from gslcosim.runtime.services import default_services

    children: dict[str, PreforkedChild] = {}
    with contextlib.suppress(OSError):
        for kind in default_services():
            if kind.import_early is not None:
                others = [child.fd for child in children.values()]
                children[kind.name] = PreforkedChild(kind.import_early, [fd, *others])
    return children


def import_shared_modules() -> None:
    """Import what several services need, and load the compiler of their kernels; starts no thread."""
    from gslcosim.runtime.services import default_services

    # Otherwise MuJoCo imports what opens windows, which starts a process to look for it; pictures need none of it.
    with _environment_variable("MUJOCO_GL", "disable"):
        for module in ("gslcosim.bus.zenoh_bus", "gslcosim.runtime.services", "gslcosim.runtime.distributed.host"):
            importlib.import_module(module)
        for kind in default_services():
            for module in kind.preloads:
                importlib.import_module(module)
    # The first kernel that a process calls loads numba's compiler, a fifth of a second: once here, not in each fork.
    importlib.import_module("gslcosim.environment.grid_kernels").to_next_border(0.5, 0, 1.0)
    # Each service states it; it is made from the descriptions of all messages.
    importlib.import_module("gslcosim.contract.schema").get_contract_hash()


@contextlib.contextmanager
def _environment_variable(name: str, value: str) -> Generator[None]:
    before = os.environ.get(name)
    os.environ[name] = before or value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]


class _Server:
    def __init__(self, requests: socket.socket, children: dict[str, PreforkedChild]) -> None:
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
            received = self._requests.recv(_MAX_REQUEST_BYTES)
        except ConnectionError:
            return False
        *lines, self._unread = (self._unread + received).split(b"\n")
        for line in lines:
            request = json.loads(line)
            if "services" in request or "warm_up" in request:
                self._start(request)
            else:
                self._dismiss_apprentices()
        return bool(received)

    def _start(self, request: dict[str, Any]) -> None:
        name = str(request["name"])
        child = self._preforked.pop(name, None) if request.get("services") == [name] else None
        if child is not None and child.take(request):
            self._has_started(name, child.pid)
        else:
            self._fork(name, request)

    def _fork(self, name: str, request: dict[str, Any]) -> None:
        try:
            pid = os.fork()
        except OSError as error:
            text = format_machine_error(error, name, "one process more")
            with contextlib.suppress(OSError):
                append_bytes(Path(request["log"]).parent, Path(request["log"]).name, f"{text}\n".encode())
            self._send({"ended": name, "code": int(ExitCode.FAULT)})
            return
        if pid == 0:
            child_main(request, self._pid, self._open_descriptors)
        self._has_started(name, pid)

    def _has_started(self, name: str, pid: int) -> None:
        self._names[pid] = name
        self._send({"started": name, "pid": pid})

    @property
    def _open_descriptors(self) -> list[int]:
        children = [child.fd for child in self._preforked.values()]
        return [self._requests.fileno(), self._woken, self._waker, *children]

    def _dismiss_apprentices(self) -> None:
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
