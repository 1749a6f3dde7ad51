"""Opening sessions of Zenoh: what the machine refuses them is told as such."""
# Zenoh's stubs leave many types open.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false

import errno
import os
import re
import socket
from collections.abc import Callable

import zenoh

from gslcosim.errors import MachineError
from gslcosim.machine import LACKING, machine_error, no_process_error

_EXPECTED = "a session that opens"
# How pyo3 raises what Rust does not handle; no class to be imported.
_PANIC = "PanicException"
_UNIX_SOCKET = "unixsock-stream/"
# A router that answers may have been stopped during an attempt; one that refuses a password answers each time.
_MAX_ATTEMPTS = 3


def open_session(config: zenoh.Config) -> zenoh.Session:
    """Open a session.

    Raises:
        MachineError: the machine lacks what a session needs, such as files that may be open.
        zenoh.ZError: it cannot be opened for another reason.
    """
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        found = re.search(r"\(os error (\d+)\)", str(error))
        number = int(found[1]) if found is not None else 0
        if number == errno.EAGAIN:
            raise no_process_error() from error
        if number in LACKING:
            raise machine_error(OSError(number, os.strerror(number)), "zenoh", _EXPECTED) from error
        raise
    except BaseException as error:
        if type(error).__name__ != _PANIC:
            raise
        if f"(os error {errno.EAGAIN})" in str(error):
            raise no_process_error() from error
        raise MachineError(
            f"zenoh: expected {_EXPECTED}, was {error}. Raise the limits on open files (ulimit -n) and on processes "
            "(ulimit -u), or close programs."
        ) from error


def open_with_patience(open_once: Callable[[], zenoh.Session], endpoint: str) -> zenoh.Session:
    """Open a session to the router of this machine; wait for a router that is stopped, however long that is.

    Zenoh gives an attempt up after seconds, and its error is the same for a stopped router and a refused password.

    Args:
        open_once: Tries to open the session.
        endpoint: Where the router listens, as Zenoh names it.

    Raises:
        zenoh.ZError: no router listens there, or it refuses the session.
    """
    for _ in range(_MAX_ATTEMPTS - 1):
        try:
            return open_once()
        except zenoh.ZError:
            if not wait_for_answer(endpoint):
                raise
    return open_once()


def wait_for_answer(endpoint: str) -> bool:
    """Wait until a process that listens at a unix socket reads what it is sent; return false where none listens.

    The kernel accepts connections for a process that is stopped. It sees the end of this one when it continues, and
    closes it.
    """
    if not endpoint.startswith(_UNIX_SOCKET):
        return False
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            probe.connect(endpoint.removeprefix(_UNIX_SOCKET))
            probe.shutdown(socket.SHUT_WR)
            while probe.recv(4096):
                pass
    except ConnectionResetError:
        return True
    except OSError:
        return False
    return True


def set_unread_limit(config: zenoh.Config, limit_ms: int) -> None:
    """Close the link of a member that has read nothing for so long [ms]."""
    config.insert_json5("transport/link/tx/queue/congestion_control/block/wait_before_close", str(limit_ms * 1000))
