"""A fork that learns early: it imports what one service alone needs while the fork server imports what all share."""

import contextlib
import json
import os
import signal
import socket
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from gslcosim.runtime.over_bus.forked import become, end_with_parent

_MOST_BYTES = 1 << 16


class Apprentice:
    """A fork of the fork server that becomes a service when it is asked to; until then it imports and waits.

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
                _learn(import_early, server, theirs, unwanted)

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

    def dismiss(self) -> None:
        """End it: nobody needs it."""
        self._socket.close()
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)


# Never returns, whatever happens: there must be one server.
def _learn(import_early: Callable[[], None], server: int, requests: socket.socket, unwanted: Sequence[int]) -> NoReturn:
    try:
        end_with_parent(server)
        os.setsid()
        # Ctrl-C is the supervisor's to handle.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for fd in unwanted:
            os.close(fd)
        # What cannot be imported is told by the service that needs it, in its log.
        with contextlib.suppress(Exception):
            import_early()
        request = b""
        while not request.endswith(b"\n"):
            received = requests.recv(_MOST_BYTES)
            if not received:
                os._exit(0)
            request += received
        become(json.loads(request), server, [requests.fileno()])
    finally:
        os._exit(1)
