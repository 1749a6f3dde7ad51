"""Client of the daemon: where it listens, whether it has the same code, and runs that are asked of it."""

import contextlib
import hashlib
import json
import os
import signal
import socket
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gslcosim
from gslcosim.base.errors import SimulationFault, UsageError
from gslcosim.base.kernel_cache import get_cache_root, get_code_roots
from gslcosim.base.sockets import check_peer, read_peer_pid, short_socket_address
from gslcosim.runtime.processes.current_process import get_user_id

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
        socket.send_fds(connection, [b"gslcosim\n"], [0, 1, 2])
        connection.sendall(json.dumps(_build_request(words)).encode() + b"\n")
        answers = _iter_answers(connection)
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
        if isinstance(error, FileNotFoundError):
            raise UsageError(f"up --warm: expected a server, found none. {_START_REMEDY}") from error
        if isinstance(error, ConnectionRefusedError):
            raise UsageError(
                f"up --warm: expected a server that runs, found one that was killed. {_START_REMEDY}"
            ) from error
        raise UsageError(
            f"up --warm: expected a server at {path}, found none that can be reached ({error})."
        ) from error
    return connection


def _iter_answers(connection: socket.socket) -> Iterator[dict[str, Any]]:
    unread = b""
    while received := connection.recv(1 << 16):
        *lines, unread = (unread + received).split(b"\n")
        yield from (json.loads(line) for line in lines)


# A signal reaches this process only: the run is in a session of its own.
def _read_result(connection: socket.socket, answers: Iterator[dict[str, Any]]) -> dict[str, Any] | None:
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
