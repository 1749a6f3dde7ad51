"""Unix sockets: addresses in folders with long names, and checks of the process at the other end.

Any process of a user can connect to that user's sockets, even an agent in the Landlock sandbox, because Landlock does
not cover unix sockets with a path. Every sandbox of ours puts a filter of system calls on its processes; all children
of a process inherit its filters, and none can drop one. So a peer with more filters than this process is refused, and
containers with filters on everything are no obstacle.
"""

import contextlib
import os
import select
import socket
import struct
import sys
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import UsageError

# struct ucred: pid, uid, gid.
_CREDENTIALS = struct.Struct("3i")
# Since Linux 6.5; Python has no name for it yet.
_SO_PEERPIDFD = 77


@contextlib.contextmanager
def short_socket_address(path: Path) -> Iterator[str]:
    """Give the address to bind or connect a unix socket at a path of any length.

    An address holds 107 bytes on Linux, where it leads here through the open folder. Elsewhere it is the path.
    """
    if sys.platform != "linux":
        yield str(path)
        return
    folder = os.open(path.parent, os.O_PATH | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)


@dataclass(frozen=True)
class _Confinement:
    """Restrictions that a process can never drop, from `/proc/PID/status`."""

    n_filters: int
    has_no_new_privs: bool
    n_pid_namespaces: int

    @classmethod
    def read(cls, pid: int | str) -> "_Confinement":
        lines = Path(f"/proc/{pid}/status").read_text(errors="replace").splitlines()
        fields = {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}
        if fields.get("State", "Z").startswith(("Z", "X")):
            raise ProcessLookupError(f"process {pid} has ended")
        # Before Linux 5.9 the status has a flag instead of the count.
        filters = fields.get("Seccomp_filters") or fields.get("Seccomp") or "0"
        return cls(
            n_filters=int(filters),
            has_no_new_privs=fields.get("NoNewPrivs", "0") != "0",
            n_pid_namespaces=len(fields.get("NSpid", "1").split()),
        )

    def excess_over(self, ours: "_Confinement") -> str:
        """Return in words its restrictions beyond those of this process; empty if there are none."""
        if self.n_filters > ours.n_filters:
            return f"{self.n_filters} filters of system calls (Seccomp_filters), where this one has {ours.n_filters}"
        if self.has_no_new_privs > ours.has_no_new_privs:
            return "NoNewPrivs set, which this one has not"
        if self.n_pid_namespaces > ours.n_pid_namespaces:
            return "a process namespace within that of this one"
        return ""


def read_peer_pid(connection: socket.socket) -> int:
    """Return the process at the other end of a unix socket, as reported by the system; Linux only."""
    return _read_credentials(connection)[0]


def check_peer(connection: socket.socket, *, place: str) -> None:
    """Refuse the peer of a unix socket if it is another user's process, or more confined than this one.

    A descriptor holds the peer meanwhile, so that its number cannot pass to another process; before Linux 6.5, without
    descriptors of peers, it may have passed between the peer's call and this one. Systems other than Linux, without
    sandboxes, refuse no peer.
    """
    if sys.platform != "linux":
        return
    pid, uid, _ = _read_credentials(connection)
    if uid != os.geteuid():
        raise UsageError(f"{place}: expected a process of user {os.geteuid()} at the other end, found one of {uid}.")
    try:
        with _hold_process(connection, pid) as process:
            theirs = _Confinement.read(pid)
            has_ended = bool(select.select([process], [], [], 0)[0])
    except (OSError, ValueError) as error:
        raise UsageError(f"{place}: expected a process that can be looked at, could not ({error}).") from error
    if has_ended:
        raise UsageError(f"{place}: expected a process that waits for its answer, process {pid} has ended.")
    if excess := theirs.excess_over(_Confinement.read("self")):
        raise UsageError(
            f"{place}: expected a process that is confined no more than this one, process {pid} has {excess}. "
            "Agents in a sandbox are refused; start both from the same shell or in the same container."
        )


def _read_credentials(connection: socket.socket) -> tuple[int, int, int]:
    return _CREDENTIALS.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))


# A descriptor that becomes readable when the process ends.
@contextlib.contextmanager
def _hold_process(connection: socket.socket, pid: int) -> Generator[int]:
    try:
        process = connection.getsockopt(socket.SOL_SOCKET, _SO_PEERPIDFD)
    except OSError:
        process = os.pidfd_open(pid)
    try:
        yield process
    finally:
        os.close(process)
