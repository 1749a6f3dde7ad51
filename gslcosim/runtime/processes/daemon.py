"""Daemon of `gslcosim serve`: imports and warms up once, then forks the supervisor of each run asked for.

It has one thread, holds nothing of any run, and forks only while it has one. A fork has the whole run to itself: it
forks the run's own fork server first, takes over the caller's streams, folder and environment, and flies. So what is
warm is what was imported, and nothing else differs from a run without a server.
"""

import contextlib
import gc
import importlib
import json
import os
import secrets
import selectors
import signal
import socket
import stat
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from gslcosim.base.errors import ExitCode, UsageError, build_machine_error
from gslcosim.base.sockets import check_peer, read_peer_pid, short_socket_address
from gslcosim.runtime.processes.current_process import get_user_id, keep_memory_private, set_process_title
from gslcosim.runtime.processes.daemon_client import (
    count_threads,
    find_differences,
    get_daemon_folder,
    get_daemon_secret_file,
    get_daemon_socket,
    read_code_identity,
)
from gslcosim.runtime.processes.fork_client import ForkServer
from gslcosim.runtime.processes.fork_server import exit_fork, import_shared_modules

GREETING = b"gslcosim\n"
N_STREAMS = 3
MAX_REQUEST_BYTES = 1 << 22
# A caller has all that it sends ready before it connects.
REQUEST_TIMEOUT_S = 10.0
END_TIMEOUT_S = 20.0
_POLL_PERIOD_S = 0.05
_BACKLOG = 64
# What a run imports besides what its services share.
_SUPERVISOR_MODULES = (
    "gslcosim.runtime.run",
    "gslcosim.runtime.distributed.process_launch",
    "gslcosim.environment.positions",
    "gslcosim.environment.generation.cache",
    "gslcosim_services.sensing.briefing",
    "rich.live",
)
_WARMUP_SCENARIO = "warehouse_empty"

CommandRunner = Callable[[Sequence[str], ForkServer], int]


def serve_daemon(fly: CommandRunner, *, announce: Callable[[Path], None]) -> None:
    """Import and warm up, then run what clients of this user ask for, until SIGINT or SIGTERM; runs end with it.

    Who asks is in no sandbox: it shows a secret that lies beside the socket, and is confined no more than the server.

    Args:
        fly: Flies a command line with a fork server, and returns its exit code; called in a fork.
        announce: Receives the socket as soon as it is listened at.

    Raises:
        UsageError: there is a server already, or its folder belongs to others.
        MachineError: the socket cannot be made.
    """
    keep_memory_private()
    with _open_listener() as (listener, secret):
        # Before anything is imported: what is changed meanwhile differs then.
        imported = read_code_identity()
        gc.disable()
        _warm_up()
        gc.collect()
        gc.freeze()
        server = _Daemon(listener, imported, secret, fly)
        try:
            announce(get_daemon_socket())
            server.serve()
        finally:
            get_daemon_socket().unlink(missing_ok=True)
            get_daemon_secret_file().unlink(missing_ok=True)
            server.end_flights()


def check_one_thread() -> None:
    """Refuse to fork a process with several threads: a fork has only one, and whatever another held stays held.

    Raises:
        UsageError: there are several.
    """
    if count_threads() > 1:
        names = ", ".join(thread.name for thread in threading.enumerate())
        raise UsageError(f"warm server: expected one thread, to fork from, was {count_threads()} (Python's: {names}).")


def _warm_up() -> None:
    import_shared_modules()
    for module in _SUPERVISOR_MODULES:
        importlib.import_module(module)

    from gslcosim.runtime.early_warmup import warm_up_services
    from gslcosim.scenario import load_scenario

    loaded = load_scenario(_WARMUP_SCENARIO)
    warm_up_services(loaded.scenario, loaded.directory)


@contextlib.contextmanager
def _open_listener() -> Any:
    folder, path = get_daemon_folder(), get_daemon_socket()
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
            _check_owner(folder)
            _remove_stale_socket(path)
            secret = _write_secret(get_daemon_secret_file())
            with short_socket_address(path) as address:
                listener.bind(address)
            listener.listen(_BACKLOG)
        except OSError as error:
            raise build_machine_error(error, "warm server", "a unix socket that can be made", path=path) from error
        yield listener, secret
    finally:
        listener.close()


def _check_owner(folder: Path) -> None:
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != get_user_id() or found.st_mode & 0o077:
        raise UsageError(
            f"{folder}: expected a folder that only this user can enter, found another. Remove it, or set TMPDIR."
        )


def _write_secret(path: Path) -> str:
    secret = secrets.token_urlsafe(32)
    path.unlink(missing_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    with os.fdopen(descriptor, "w") as file:
        file.write(secret)
    return secret


def _remove_stale_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            with short_socket_address(path) as address:
                probe.connect(address)
        except (FileNotFoundError, ConnectionRefusedError):
            path.unlink(missing_ok=True)
            return
        pid = read_peer_pid(probe)
    raise UsageError(f"serve: expected no other server of this user, found one, process {pid}. End it: kill {pid}")


class _Daemon:
    def __init__(self, listener: socket.socket, imported: dict[str, str], secret: str, fly: CommandRunner) -> None:
        self._listener = listener
        self._imported = imported
        self._secret = secret
        self._fly = fly
        self._flights: set[int] = set()
        self._woken, self._waker = os.pipe()
        self._is_ended = False

    def serve(self) -> None:
        os.set_blocking(self._waker, False)
        signal.set_wakeup_fd(self._waker, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._end)
        with selectors.DefaultSelector() as selector:
            selector.register(self._listener, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            while not self._is_ended:
                for key, _ in selector.select():
                    if key.fileobj is self._listener:
                        self._accept(selector)
                    else:
                        os.read(self._woken, MAX_REQUEST_BYTES)
                self._reap()

    def end_flights(self) -> None:
        """Interrupt all runs, wait for their ends in order, and kill what is left."""
        for number, limit_s in ((signal.SIGINT, END_TIMEOUT_S), (signal.SIGKILL, 1.0)):
            for pid in self._flights:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, number)
            deadline_s = time.monotonic() + limit_s
            while self._flights and time.monotonic() < deadline_s:
                self._reap()
                time.sleep(_POLL_PERIOD_S)

    def _end(self, number: int, frame: object) -> None:
        del number, frame
        self._is_ended = True

    def _reap(self) -> None:
        with contextlib.suppress(ChildProcessError):
            while self._flights and (pid := os.waitpid(-1, os.WNOHANG)[0]):
                self._flights.discard(pid)

    def _accept(self, selector: selectors.BaseSelector) -> None:
        connection, _ = self._listener.accept()
        with connection:
            try:
                check_peer(connection, place="caller")
                check_one_thread()
                pid = os.fork()
            except (UsageError, OSError) as error:
                _send_answer(connection, {"refused": f"warm server: {error}"})
                return
            if pid == 0:
                try:
                    selector.close()
                    self._become(connection)
                finally:
                    os._exit(int(ExitCode.FAULT))
            self._flights.add(pid)

    # Never returns, whatever happens: there must be one server.
    def _become(self, connection: socket.socket) -> None:
        code = int(ExitCode.FAULT)
        try:
            os.setsid()
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            for fd in (self._woken, self._waker, self._listener.fileno()):
                os.close(fd)
            request = _adopt_caller(connection, self._secret)
            if differing := find_differences(self._imported, request["identity"]):
                pid = os.getppid()
                _send_answer(connection, {"refused": _describe_stale(differing, pid)})
            else:
                code = _run_command(connection, request["words"], self._fly)
                # Whoever has called is gone as soon as it knows.
                signal.signal(signal.SIGINT, signal.SIG_IGN)
                _send_answer(connection, {"code": code})
        except UsageError as error:
            _send_answer(connection, {"refused": str(error)})
        except BaseException:  # told where the caller looks, as by an interpreter that ends
            traceback.print_exc()
        finally:
            exit_fork(code)


def _describe_stale(differing: Sequence[str], pid: int) -> str:
    return (
        f"up --warm: expected a server that has imported what is there now, found one with another "
        f"{', '.join(differing)}. Start it again: kill {pid}; gslcosim serve"
    )


def _run_command(connection: socket.socket, words: Sequence[str], fly: CommandRunner) -> int:
    gc.enable()
    # A fork of this fork, while it has one thread.
    fork_server = ForkServer.fork_this_process(unwanted=(connection.fileno(),))
    set_process_title(f"{sys.executable} -P -m gslcosim {' '.join(words)}")
    _send_answer(connection, {"pid": os.getpid()})
    threading.Thread(target=_forward_interrupts, args=(connection,), name="caller", daemon=True).start()
    with fork_server:
        return fly(words, fork_server)


# Whoever has called interrupts with a byte, and by being gone.
def _forward_interrupts(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while connection.recv(1):
            os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)


def _adopt_caller(connection: socket.socket, secret: str) -> dict[str, Any]:
    connection.settimeout(REQUEST_TIMEOUT_S)
    _, streams, _, _ = socket.recv_fds(connection, len(GREETING), N_STREAMS)
    request = json.loads(_read_line(connection))
    if not secrets.compare_digest(str(request["secret"]).encode(), secret.encode()):
        raise UsageError(f"warm server: expected the secret in {get_daemon_secret_file()}, the caller has another.")
    for fd, stream in enumerate(streams):
        os.dup2(stream, fd)
        os.close(stream)
    sys.stdout = os.fdopen(1, "w", closefd=False)
    sys.stderr = os.fdopen(2, "w", closefd=False, errors="backslashreplace")
    connection.settimeout(None)
    os.environ.clear()
    os.environ.update(request["environ"])
    os.chdir(request["folder"])
    os.umask(request["umask"])
    # It is looked for once in a process.
    tempfile.tempdir = None
    return request


def _read_line(connection: socket.socket) -> bytes:
    received = b""
    while not received.endswith(b"\n"):
        part = connection.recv(1 << 16)
        if not part or len(received) > MAX_REQUEST_BYTES:
            raise ConnectionError("warm server: expected a whole request, the caller is gone.")
        received += part
    return received


def _send_answer(connection: socket.socket, answer: dict[str, Any]) -> None:
    with contextlib.suppress(OSError):
        connection.sendall(json.dumps(answer).encode() + b"\n")
