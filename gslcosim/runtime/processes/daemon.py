"""Daemon of `gslcosim serve`: imports and warms up once, then forks the supervisor of each run asked for.

It has one thread, holds nothing of any run, and forks only while it has one. A fork has the whole run to itself: it
forks the run's own fork server first, takes over the caller's streams, folder and environment, and flies. So what is
warm is what was imported, and nothing else differs from a run without a server.

`serve_daemon` is the daemon, `run_on_daemon` its client.
"""

import contextlib
import gc
import hashlib
import os
import secrets
import signal
import socket
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gslcosim
from gslcosim.base.errors import SimulationFault, UsageError, build_machine_error
from gslcosim.base.kernel_cache import get_cache_root, get_code_roots
from gslcosim.base.sockets import check_peer, read_peer_pid, short_socket_address
from gslcosim.runtime.processes.current_process import get_user_id, keep_memory_private, set_process_title
from gslcosim.runtime.processes.fork_server import ForkMonitor, ForkServer, ForkWork, JsonLines, fork_child

# What libraries read once, when they are imported.
_IMPORT_VARIABLES = ("NUMBA_", "PYTHON")
_IRRELEVANT_VARIABLES = ("PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED")


def get_daemon_folder() -> Path:
    """Return the private folder of this user's warm server; it need not exist."""
    return Path(tempfile.gettempdir()) / f".gslcosim-server-{get_user_id()}"


def get_daemon_socket() -> Path:
    """Return the unix socket at which this user's warm server listens; it need not exist."""
    return get_daemon_folder() / "server.sock"


def get_daemon_secret_file() -> Path:
    """Return the file with what a caller has to know; it is made again by each server, and hidden from sandboxes."""
    return get_daemon_folder() / "secret"


def read_code_identity() -> dict[str, str]:
    """Return what a server has imported or what would be imported now, each part by its name in messages.

    The code counts by name, size and time of each file of our packages, whatever kind it is; other packages by the
    times of the folders that they are installed in.
    """
    environ = {key: value for key, value in os.environ.items() if key.startswith(_IMPORT_VARIABLES)}
    return {
        "version": gslcosim.__version__,
        "Python": f"{sys.executable} {sys.version}",
        "code": _hash_facts([_list_file_facts(root) for root in get_code_roots().values()]),
        "installed packages": _hash_facts(
            [(place, _get_change_ns(Path(place))) for place in sys.path if place.endswith("-packages")]
        ),
        "cache": str(get_cache_root()),
        "environment": " ".join(f"{key}={environ[key]}" for key in sorted(environ) if key not in _IRRELEVANT_VARIABLES),
    }


def find_differences(ours: Mapping[str, str], theirs: Mapping[str, object]) -> list[str]:
    """Return the parts in which a server is another one than those it is to fly for."""
    return [part for part, value in ours.items() if theirs.get(part) != value]


def count_threads() -> int:
    """Return how many threads this process has; Linux only."""
    return sum(1 for _ in Path("/proc/self/task").iterdir())


def _list_file_facts(folder: Path) -> list[tuple[str, int, int]]:
    facts: list[tuple[str, int, int]] = []
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                facts += _list_file_facts(Path(entry.path)) if entry.name != "__pycache__" else []
            else:
                facts.append((entry.path, entry.stat().st_size, entry.stat().st_mtime_ns))
    return sorted(facts)


def _get_change_ns(place: Path) -> int:
    try:
        return place.stat().st_mtime_ns
    except OSError:
        return 0


def _hash_facts(facts: object) -> str:
    return hashlib.blake2b(repr(facts).encode(), digest_size=8).hexdigest()


GREETING = b"gslcosim\n"
N_STREAMS = 3
MAX_REQUEST_BYTES = 1 << 22
# A caller has all that it sends ready before it connects.
REQUEST_TIMEOUT_S = 10.0
END_TIMEOUT_S = 20.0
_POLL_PERIOD_S = 0.05
_BACKLOG = 64

CommandRunner = Callable[[Sequence[str], ForkServer], int]


def serve_daemon(
    fly: CommandRunner, *, warm_up: Callable[[], None], work: ForkWork, announce: Callable[[Path], None]
) -> None:
    """Import and warm up, then run what clients of this user ask for, until SIGINT or SIGTERM; runs end with it.

    Who asks is in no sandbox: it shows a secret that lies beside the socket, and is confined no more than the server.

    Args:
        fly: Flies a command line with a fork server, and returns its exit code; called in a fork.
        warm_up: Imports and warms up what runs share; it starts no thread.
        work: What the forks of a run's fork server do.
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
        warm_up()
        gc.collect()
        gc.freeze()
        server = _Daemon(listener, imported, secret, fly, work)
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
    raise UsageError(f"A server of this user is already running (pid {pid}). Stop it with `kill {pid}`.")


class _Daemon:
    def __init__(
        self, listener: socket.socket, imported: dict[str, str], secret: str, fly: CommandRunner, work: ForkWork
    ) -> None:
        self._listener = listener
        self._imported = imported
        self._secret = secret
        self._fly = fly
        self._work = work
        self._flights: set[int] = set()
        self._monitor = ForkMonitor(listener)
        self._is_ended = False

    def serve(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._end)
        while not self._is_ended:
            if self._monitor.wait():
                self._accept()
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
        self._flights -= {pid for pid, _ in self._monitor.reap()}

    def _accept(self) -> None:
        connection, _ = self._listener.accept()
        with connection:
            try:
                check_peer(connection, place="caller")
                check_one_thread()
                self._flights.add(
                    fork_child(
                        lambda: self._become(connection), unwanted=self._monitor.descriptors, ends_with_parent=False
                    )
                )
            except (UsageError, OSError) as error:
                _send_answer(connection, {"refused": f"warm server: {error}"})

    def _become(self, connection: socket.socket) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            request = _adopt_caller(connection, self._secret)
            if differing := find_differences(self._imported, request["identity"]):
                raise UsageError(
                    f"up --warm: expected a server that has imported what is there now, found one with another "
                    f"{', '.join(differing)}. Start it again: kill {os.getppid()}; gslcosim serve"
                )
            code = _run_command(connection, request["words"], self._fly, self._work)
            # Whoever has called is gone as soon as it knows.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            _send_answer(connection, {"code": code})
        except UsageError as error:
            _send_answer(connection, {"refused": str(error)})


def _run_command(connection: socket.socket, words: Sequence[str], fly: CommandRunner, work: ForkWork) -> int:
    gc.enable()
    # A fork of this fork, while it has one thread.
    fork_server = ForkServer.fork_this_process(work, unwanted=(connection.fileno(),))
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
    request = next(iter(JsonLines(connection, max_bytes=MAX_REQUEST_BYTES)), None)
    if request is None:
        raise ConnectionError("warm server: expected a whole request, the caller is gone.")
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


def _send_answer(connection: socket.socket, answer: dict[str, Any]) -> None:
    with contextlib.suppress(OSError):
        JsonLines(connection).send(answer)


ANSWER_TIMEOUT_S = 15.0
_START_REMEDY = "Start one in another shell: gslcosim serve"


def run_on_daemon(words: Sequence[str]) -> int:
    """Run a command line in a fork of this user's daemon, and return its exit code; Ctrl-C is passed on.

    Args:
        words: The command line without the program's name.

    Raises:
        UsageError: there is no server, or it has ended, does not answer, has imported other code, or it and this
            process are not confined alike.
        SimulationFault: the run's process has ended without a word.
    """
    # The streams are those of this process, so that nothing of it may wait in them.
    sys.stdout.flush()
    sys.stderr.flush()
    with _connect() as connection:
        check_peer(connection, place="up --warm")
        pid = read_peer_pid(connection)
        socket.send_fds(connection, [GREETING], [0, 1, 2])
        lines = JsonLines(connection)
        lines.send(_build_request(words))
        answers = iter(lines)
        try:
            first = next(answers, {"refused": f"up --warm: expected an answer of the server, process {pid}, got none."})
        except TimeoutError as error:
            raise UsageError(
                f"up --warm: expected an answer of the server, process {pid}, within {ANSWER_TIMEOUT_S:g} s, got none. "
                f"End it: kill -9 {pid}"
            ) from error
        if "refused" in first:
            raise UsageError(str(first["refused"]))
        connection.settimeout(None)
        last = _read_result(connection, answers)
    if last is None:
        raise SimulationFault(f"up --warm: expected the flight to end in order, its process {first['pid']} was killed.")
    return int(last["code"])


def _build_request(words: Sequence[str]) -> dict[str, Any]:
    umask = os.umask(0)
    os.umask(umask)
    return {
        "secret": _read_secret(),
        "words": list(words),
        "identity": read_code_identity(),
        "environ": dict(os.environ),
        "folder": str(Path.cwd()),
        "umask": umask,
    }


def _read_secret() -> str:
    try:
        return get_daemon_secret_file().read_text()
    except OSError as error:
        raise UsageError(
            f"up --warm: expected the server's secret in {get_daemon_secret_file()}, could not read it ({error}). "
            "Start the server again: gslcosim serve"
        ) from error


def _connect() -> socket.socket:
    if sys.platform != "linux":
        raise UsageError("up --warm: expected Linux, where processes fork safely. Leave --warm away.")
    path = get_daemon_socket()
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(ANSWER_TIMEOUT_S)
    try:
        with short_socket_address(path) as address:
            connection.connect(address)
    except OSError as error:
        connection.close()
        texts: dict[type[OSError], str] = {
            FileNotFoundError: f"a server, found none. {_START_REMEDY}",
            ConnectionRefusedError: f"a server that runs, found one that was killed. {_START_REMEDY}",
        }
        other = f"a server at {path}, found none that can be reached ({error})."
        raise UsageError(f"up --warm: expected {texts.get(type(error), other)}") from error
    return connection


# A signal reaches this process only: the run is in a session of its own.
def _read_result(connection: socket.socket, answers: Iterator[Any]) -> dict[str, Any] | None:
    def interrupt(number: int, frame: object) -> None:
        del number, frame
        with contextlib.suppress(OSError):
            connection.sendall(b"i")

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        return next(answers, None)
    except ConnectionError:
        return None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
