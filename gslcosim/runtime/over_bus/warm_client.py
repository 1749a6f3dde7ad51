"""Flying from a warm server: asks it for a flight with this process's streams, and waits for the flight's end."""

import contextlib
import json
import os
import signal
import socket
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from gslcosim.errors import SimulationFault, UsageError
from gslcosim.runtime.over_bus.warm_place import identity, warm_secret, warm_socket
from gslcosim.socket_paths import socket_address
from gslcosim.socket_peers import check_peer, peer_pid

ANSWER_WITHIN_S = 15.0
_START = "Start one in another shell: gslcosim serve"


def fly_warm(words: Sequence[str]) -> int:
    """Fly a command line in a fork of this user's warm server, and return its exit code; Ctrl-C is passed on.

    Args:
        words: The command line without the program's name.

    Raises:
        UsageError: there is no server, or it has ended, does not answer, has imported other code, or it and this
            process are not confined alike.
        SimulationFault: the flight's process has ended without a word.
    """
    # The streams are those of this process, so that nothing of it may wait in them.
    sys.stdout.flush()
    sys.stderr.flush()
    with _connected() as connection:
        check_peer(connection, place="up --warm")
        pid = peer_pid(connection)
        socket.send_fds(connection, [b"gslcosim\n"], [0, 1, 2])
        connection.sendall(json.dumps(_request(words)).encode() + b"\n")
        answers = _answers(connection)
        try:
            first = next(answers, {"refused": f"up --warm: expected an answer of the server, process {pid}, got none."})
        except TimeoutError as error:
            raise UsageError(
                f"up --warm: expected an answer of the server, process {pid}, within {ANSWER_WITHIN_S:g} s, got none. "
                f"End it: kill -9 {pid}"
            ) from error
        if "refused" in first:
            raise UsageError(str(first["refused"]))
        connection.settimeout(None)
        last = _last_word(connection, answers)
    if last is None:
        raise SimulationFault(f"up --warm: expected the flight to end in order, its process {first['pid']} was killed.")
    return int(last["code"])


def _request(words: Sequence[str]) -> dict[str, Any]:
    umask = os.umask(0)
    os.umask(umask)
    return {
        "secret": _secret(),
        "words": list(words),
        "identity": identity(),
        "environ": dict(os.environ),
        "folder": str(Path.cwd()),
        "umask": umask,
    }


def _secret() -> str:
    try:
        return warm_secret().read_text()
    except OSError as error:
        raise UsageError(
            f"up --warm: expected the server's secret in {warm_secret()}, could not read it ({error}). "
            "Start the server again: gslcosim serve"
        ) from error


def _connected() -> socket.socket:
    if sys.platform != "linux":
        raise UsageError("up --warm: expected Linux, where processes fork safely. Leave --warm away.")
    path = warm_socket()
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.settimeout(ANSWER_WITHIN_S)
    try:
        with socket_address(path) as address:
            connection.connect(address)
    except OSError as error:
        connection.close()
        if isinstance(error, FileNotFoundError):
            raise UsageError(f"up --warm: expected a server, found none. {_START}") from error
        if isinstance(error, ConnectionRefusedError):
            raise UsageError(f"up --warm: expected a server that runs, found one that was killed. {_START}") from error
        raise UsageError(
            f"up --warm: expected a server at {path}, found none that can be reached ({error})."
        ) from error
    return connection


def _answers(connection: socket.socket) -> Iterator[dict[str, Any]]:
    unread = b""
    while received := connection.recv(1 << 16):
        *lines, unread = (unread + received).split(b"\n")
        yield from (json.loads(line) for line in lines)


# A signal reaches this process only: the flight is in a session of its own.
def _last_word(connection: socket.socket, answers: Iterator[dict[str, Any]]) -> dict[str, Any] | None:
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
