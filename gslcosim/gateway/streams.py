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

    def wait_writable(self, timeout_s: float | None = None) -> bool:
        """Wait until something fits again, or the other side is gone; return whether that came within the time."""
        ...

    def wait_readable(self, timeout_s: float) -> bool:
        """Wait until there is something to read, or the end; return whether that came within the time."""
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
        self._readable = select.poll()
        self._readable.register(from_agent.fileno(), select.POLLIN)

    def read(self) -> bytes:
        """Return the next bytes; see `Stream`."""
        return self._from_agent.read(READ_BYTES) or b""

    def write_now(self, data: bytes) -> int:
        """Write what fits; see `Stream`."""
        return self._to_agent.write(data) or 0

    def wait_writable(self, timeout_s: float | None = None) -> bool:
        """Wait until something fits again; see `Stream`."""
        return bool(self._writable.poll(None if timeout_s is None else 1e3 * timeout_s))

    def wait_readable(self, timeout_s: float) -> bool:
        """Wait until there is something to read; see `Stream`."""
        return bool(self._readable.poll(1e3 * timeout_s))

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
        self._readable = select.poll()
        self._readable.register(connection.fileno(), select.POLLIN)

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

    def wait_writable(self, timeout_s: float | None = None) -> bool:
        """Wait until something fits again; see `Stream`."""
        return bool(self._writable.poll(None if timeout_s is None else 1e3 * timeout_s))

    def wait_readable(self, timeout_s: float) -> bool:
        """Wait until there is something to read; see `Stream`."""
        return bool(self._readable.poll(1e3 * timeout_s))

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
