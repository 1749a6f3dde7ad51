"""The two kinds of byte streams between the gateway and an agent: a pair of pipes, and a socket."""

import contextlib
import os
import select
import socket
from io import FileIO
from typing import Protocol

READ_BYTES = 64 * 1024


class Stream(Protocol):
    """Bytes in both directions. One thread reads; writing and closing are the holder's to serialize."""

    def read(self) -> bytes:
        """Return the next bytes, waiting for them; empty at the end."""
        ...

    def write_now(self, data: bytes) -> int:
        """Write what fits without waiting and return how many bytes that was.

        Raises:
            OSError: the other side does not read any more.
        """
        ...

    def wait_writable(self) -> None:
        """Wait until something fits again, or the other side is gone."""
        ...

    def close_input(self) -> None:
        """Stop reading; to be called by the thread that reads."""
        ...

    def close_output(self) -> None:
        """End what the other side reads."""
        ...


class PipeStream:
    """The standard input and output of a process, unbuffered, from outside."""

    def __init__(self, to_agent: FileIO, from_agent: FileIO) -> None:
        self._to_agent = to_agent
        self._from_agent = from_agent
        # Only this end of the pipe: the agent's own is another, and stays as the agent expects it.
        os.set_blocking(to_agent.fileno(), False)
        self._writable = select.poll()
        self._writable.register(to_agent.fileno(), select.POLLOUT)

    def read(self) -> bytes:
        """Return the next bytes; see `Stream`."""
        return self._from_agent.read(READ_BYTES) or b""

    def write_now(self, data: bytes) -> int:
        """Write what fits; see `Stream`."""
        return self._to_agent.write(data) or 0

    def wait_writable(self) -> None:
        """Wait until something fits again; see `Stream`."""
        self._writable.poll()

    def close_input(self) -> None:
        """Stop reading; see `Stream`."""
        self._from_agent.close()

    def close_output(self) -> None:
        """End the agent's standard input; see `Stream`."""
        with contextlib.suppress(OSError):
            self._to_agent.close()


class SocketStream:
    """A connection that an agent has made."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._open_sides = {socket.SHUT_RD, socket.SHUT_WR}
        self._writable = select.poll()
        self._writable.register(connection.fileno(), select.POLLOUT)

    def read(self) -> bytes:
        """Return the next bytes; see `Stream`."""
        try:
            return self._connection.recv(READ_BYTES)
        except OSError:
            return b""

    def write_now(self, data: bytes) -> int:
        """Write what fits; see `Stream`."""
        try:
            return self._connection.send(data, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return 0

    def wait_writable(self) -> None:
        """Wait until something fits again; see `Stream`."""
        self._writable.poll()

    def close_input(self) -> None:
        """Stop reading; see `Stream`."""
        self._close(socket.SHUT_RD)

    def close_output(self) -> None:
        """End what the agent reads; see `Stream`."""
        self._close(socket.SHUT_WR)

    def _close(self, side: int) -> None:
        self._open_sides.discard(side)
        with contextlib.suppress(OSError):
            self._connection.shutdown(side)
        if not self._open_sides:
            self._connection.close()
