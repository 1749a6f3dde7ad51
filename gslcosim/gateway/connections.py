"""Connections of the gateway: streams over pipes and sockets, threaded or blocking frames, a listener."""

import contextlib
import os
import secrets
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any, Literal, Protocol, Self

from typing_extensions import override

from gslcosim.base.errors import ContractError, GslCosimError, SimulationFault
from gslcosim.contract.length_prefix import LENGTH_BYTES
from gslcosim.contract.messages import Message
from gslcosim.gateway.frame_codec import (
    FrameFormat,
    FrameOrRefusal,
    RefusedFrame,
    build_splitter,
    decode_fields,
    decode_payload,
    encode_message,
)

READ_BYTES = 64 * 1024
MAX_UNHANDLED = 16
MAX_BACKLOG_BYTES = 64 * 1024 * 1024
EventKind = Literal["command", "refused", "closed", "ended"]
EventHandler = Callable[[EventKind, bytes], None]
HELLO_TIMEOUT_S = 10.0
MAX_HELLO_BYTES = 4096
MAX_PENDING_CONNECTIONS = 8
_POLL_PERIOD_S = 0.2


class Stream(Protocol):
    """Bytes in both directions. One thread reads; writing and closing are the holder's to serialize."""

    def read(self) -> bytes:
        """Return the next bytes, waiting for them; empty at the end."""
        ...

    def write_now(self, data: bytes) -> int:
        """Write what fits without waiting and return how many bytes that was."""
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


class _PolledStream(Stream):
    def _poll(self, input_fd: int, output_fd: int) -> None:
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(input_fd, select.POLLIN)
        self._writable.register(output_fd, select.POLLOUT)

    @override
    def wait_writable(self, timeout_s: float | None = None) -> bool:
        return bool(self._writable.poll(None if timeout_s is None else 1e3 * timeout_s))

    @override
    def wait_readable(self, timeout_s: float) -> bool:
        return bool(self._readable.poll(1e3 * timeout_s))


class PipeStream(_PolledStream):
    """The standard input and output of a process, unbuffered, from outside."""

    def __init__(self, to_agent: FileIO, from_agent: FileIO) -> None:
        self._to_agent = to_agent
        self._from_agent = from_agent
        # Only this end of the pipe: the agent's own is another, and stays as the agent expects it.
        os.set_blocking(to_agent.fileno(), False)
        self._poll(from_agent.fileno(), to_agent.fileno())

    @override
    def read(self) -> bytes:
        return self._from_agent.read(READ_BYTES) or b""

    @override
    def write_now(self, data: bytes) -> int:
        return self._to_agent.write(data) or 0

    @override
    def close_input(self) -> None:
        self._from_agent.close()

    @override
    def close_output(self) -> None:
        with contextlib.suppress(OSError):
            self._to_agent.close()


class SocketStream(_PolledStream):
    """A connection that an agent has made."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._open_sides = {socket.SHUT_RD, socket.SHUT_WR}
        self._poll(connection.fileno(), connection.fileno())

    @override
    def read(self) -> bytes:
        try:
            return self._connection.recv(READ_BYTES)
        except OSError:
            return b""

    @override
    def write_now(self, data: bytes) -> int:
        try:
            return self._connection.send(data, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return 0

    @override
    def close_input(self) -> None:
        self._close(socket.SHUT_RD)

    @override
    def close_output(self) -> None:
        self._close(socket.SHUT_WR)

    def _close(self, side: int) -> None:
        self._open_sides.discard(side)
        with contextlib.suppress(OSError):
            self._connection.shutdown(side)
        if not self._open_sides:
            self._connection.close()


class ThreadedConnection:
    """Frames to and from one agent: sent without ever waiting, received by a thread with bounded memory.

    `on_event` is called on a thread of the connection; it only enqueues. The handler of a `command` or `refused` event
    calls `acknowledge` afterwards: at most `MAX_UNHANDLED` of these events wait, then the agent has to wait. The events
    are `command`, bytes for the validator; `refused`, the reason why a frame is no command; `closed`, the reason why
    this side has given up the agent; `ended`, the fault in the end of the agent's stream. One of the last two comes
    last.

    Frames that the agent has not read yet are kept, up to `MAX_BACKLOG_BYTES`; then the agent is given up.
    """

    def __init__(self, frame_format: FrameFormat, on_event: EventHandler) -> None:
        self._format: FrameFormat = frame_format
        self._on_event = on_event
        self._stream: Stream | None = None
        self._backlog: deque[bytes] = deque()
        self._backlog_bytes = 0
        self._lock = threading.Condition()
        self._slots = threading.Semaphore(MAX_UNHANDLED)
        self._is_over = False  # nothing more is sent to the agent
        self._is_muted = False  # nothing more is heard from it
        self._is_given_up = False

    def open(self, stream: Stream) -> None:
        """Begin to speak over a stream; what was sent before goes first."""
        with self._lock:
            self._stream = stream
        threading.Thread(target=self._read_all, args=(stream,), daemon=True).start()
        threading.Thread(target=self._write_backlog, args=(stream,), daemon=True).start()

    def send(self, name: str, payload: bytes) -> None:
        """Send a message to the agent, or keep it until it can be sent; never waits."""
        frame = encode_message(self._format, name, payload)
        with self._lock:
            if self._is_over:
                return
            rest = frame if self._stream is None or self._backlog else self._write(self._stream, frame)
            if rest:
                self._backlog.append(rest)
                self._backlog_bytes += len(rest)
                self._lock.notify()
            is_too_much = self._backlog_bytes > MAX_BACKLOG_BYTES
        if is_too_much:
            self._give_up(f"expected an agent that reads what it is sent, {MAX_BACKLOG_BYTES} bytes are unread.")

    def acknowledge(self) -> None:
        """Take note that an event has been handled, so that the next one may come."""
        self._slots.release()

    def end(self) -> None:
        """End the stream after the frames sent so far; frames that still arrive from the agent are discarded."""
        with self._lock:
            self._is_over = self._is_muted = True
            self._lock.notify()
        self._slots.release(MAX_UNHANDLED)

    def _give_up(self, text: str) -> None:
        with self._lock:
            if self._is_muted:
                return
            self._is_over = self._is_muted = self._is_given_up = True
            self._backlog.clear()
            self._lock.notify()
        self._on_event("closed", text.encode())
        self._slots.release(MAX_UNHANDLED)

    # Returns what did not fit. An agent that does not read any more may still speak: how that ends is reported later.
    def _write(self, stream: Stream, data: bytes) -> bytes:
        try:
            return data[stream.write_now(data) :]
        except OSError:
            self._is_over = True
            self._backlog.clear()
            self._lock.notify()
            return b""

    def _write_backlog(self, stream: Stream) -> None:
        while True:
            with self._lock:
                while not self._backlog and not self._is_over:
                    self._lock.wait()
                if not self._backlog:
                    stream.close_output()
                    return
                data = self._backlog.popleft()
                rest = self._write(stream, data)
                self._backlog_bytes -= len(data) - len(rest)
                if rest:
                    self._backlog.appendleft(rest)
            if rest:
                stream.wait_writable()

    def _read_all(self, stream: Stream) -> None:
        splitter = build_splitter(self._format)
        while not self._is_given_up and (data := stream.read()):
            for item in splitter.feed(data):
                self._receive(item)
        stream.close_input()
        if not self._is_muted:
            self._on_event("ended", splitter.rest().encode())

    def _receive(self, item: FrameOrRefusal) -> None:
        kind: EventKind = "refused"
        if not isinstance(item, RefusedFrame):
            try:
                kind, data = "command", decode_payload(self._format, item.payload)
            except ContractError as error:
                data = str(error).encode()
        elif item.is_fatal:
            self._give_up(item.text)
            return
        else:
            data = item.text.encode()
        if not self._is_muted:
            self._slots.acquire()
        if not self._is_muted:
            self._on_event(kind, data)


class StreamEndedError(GslCosimError):
    """The other side has ended its stream, or does not read any more."""


class AnswerTimeoutError(GslCosimError):
    """Nothing came, or not everything could be written, within the time."""


class BlockingConnection:
    """Frames in turn over a stream, on one thread: unlike `ThreadedConnection` it waits for each answer."""

    def __init__(self, stream: Stream, frame_format: FrameFormat) -> None:
        self._stream = stream
        self._format: FrameFormat = frame_format
        self._splitter = build_splitter(frame_format)
        self._items: deque[FrameOrRefusal] = deque()
        self._has_ended = False

    @property
    def has_more(self) -> bool:
        """True when a frame has arrived that has not been taken yet."""
        return self.comes_within(0.0)

    def comes_within(self, within_s: float) -> bool:
        """Return whether a frame is there that has not been taken yet, or arrives within a time [s]."""
        if not self._items and not self._has_ended and self._stream.wait_readable(within_s):
            self._read()
        return bool(self._items)

    def send(self, name: str, payload: bytes, *, within_s: float) -> None:
        """Send a message."""
        deadline_s = time.monotonic() + within_s
        data = encode_message(self._format, name, payload)
        while data:
            try:
                data = data[self._stream.write_now(data) :]
            except OSError as error:
                raise StreamEndedError("it does not read any more") from error
            if data and not self._stream.wait_writable(max(0.0, deadline_s - time.monotonic())):
                raise AnswerTimeoutError(f"it has not read what it was sent within {within_s:g} s")

    def receive(self, message_type: type[Message], *, within_s: float) -> bytes:
        """Return the next frame as the msgpack map of a message, to be judged."""
        deadline_s = time.monotonic() + within_s
        while not self._items:
            if self._has_ended:
                raise StreamEndedError(self._splitter.rest() or "it closed its output")
            if not self._stream.wait_readable(max(0.0, deadline_s - time.monotonic())):
                raise AnswerTimeoutError(f"nothing came within {within_s:g} s")
            self._read()
        item = self._items.popleft()
        if isinstance(item, RefusedFrame):
            raise ContractError(item.text)
        return decode_payload(self._format, item.payload, message_type)

    def close_output(self) -> None:
        """End what the other side reads."""
        self._stream.close_output()

    def close_input(self) -> None:
        """Read no more."""
        self._stream.close_input()

    def _read(self) -> None:
        data = self._stream.read()
        self._has_ended = self._has_ended or not data
        self._items += self._splitter.feed(data)


class Listener:
    """Listener for one agent: admits the first connection that presents the token, and no other."""

    def __init__(self, listening: socket.socket, address: str) -> None:
        self.address = address
        self.token = secrets.token_urlsafe(18)
        self._listening = listening
        self._listening.settimeout(_POLL_PERIOD_S)
        self._is_closed = threading.Event()
        self._waiting = threading.Semaphore(MAX_PENDING_CONNECTIONS)
        self._lock = threading.Lock()

    @classmethod
    def open_tcp(cls, host: str = "127.0.0.1", *, public_name: str | None = None) -> Self:
        """Listen on a free TCP port.

        Args:
            public_name: Name of this machine on the network, if it is not `host`.
        """
        try:
            listening = socket.create_server((host, 0), backlog=MAX_PENDING_CONNECTIONS)
        except OSError as error:
            raise SimulationFault(f"gateway: expected to listen on {host}, could not: {error}") from error
        return cls(listening, f"tcp:{public_name or host}:{listening.getsockname()[1]}")

    @classmethod
    def open_unix(cls, path: Path) -> Self:
        """Listen on a unix socket, which only this user may open."""
        listening = socket.socket(socket.AF_UNIX)
        try:
            listening.bind(str(path))
            path.chmod(0o600)
            listening.listen(MAX_PENDING_CONNECTIONS)
        except OSError as error:
            listening.close()
            raise SimulationFault(f"gateway: expected to listen on {path}, could not: {error}") from error
        return cls(listening, f"unix:{path}")

    @classmethod
    def open_at(cls, door: str, socket_path: Path) -> Self | None:
        """Listen at a program's door, a unix socket or TCP; None for a program with pipes."""
        if door == "stdio":
            return None
        return cls.open_unix(socket_path) if door == "unix" else cls.open_tcp()

    def admit(
        self,
        frame_format: FrameFormat,
        on_admitted: Callable[[SocketStream, dict[str, Any]], None],
        on_refused: Callable[[str], None],
    ) -> None:
        """Wait for the agent in a thread.

        Args:
            frame_format: The format of its frames, and already of the one with the token.
            on_admitted: Gets the agent's connection and the whole map of its first frame.
        """
        arguments = (frame_format, on_admitted, on_refused)
        threading.Thread(target=self._accept, args=arguments, daemon=True).start()

    def close(self) -> None:
        """Admit no further connection."""
        self._is_closed.set()

    def _accept(self, frame_format: FrameFormat, on_admitted: Any, on_refused: Any) -> None:
        with self._listening:
            while not self._is_closed.is_set():
                if not self._waiting.acquire(timeout=_POLL_PERIOD_S):
                    continue
                try:
                    connection, _ = self._listening.accept()
                except OSError:  # most often: no connection within the time
                    self._waiting.release()
                    continue
                arguments = (connection, frame_format, on_admitted, on_refused)
                threading.Thread(target=self._greet, args=arguments, daemon=True).start()

    def _greet(self, connection: socket.socket, frame_format: FrameFormat, on_admitted: Any, on_refused: Any) -> None:
        try:
            hello = self._hello(connection, frame_format)
        except (ContractError, OSError) as error:
            connection.close()
            on_refused(f"a connection was refused: {error}")
            return
        finally:
            self._waiting.release()
        with self._lock:
            is_late = self._is_closed.is_set()
            self._is_closed.set()
        if is_late:
            connection.close()
        else:
            on_admitted(SocketStream(connection), hello)

    def _hello(self, connection: socket.socket, frame_format: FrameFormat) -> dict[str, Any]:
        connection.settimeout(HELLO_TIMEOUT_S)
        if connection.family != socket.AF_UNIX:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        fields = decode_fields(frame_format, _read_first_frame(connection, frame_format))
        token = fields.get("token")
        if not isinstance(token, str) or not secrets.compare_digest(
            token.encode(errors="replace"), self.token.encode()
        ):
            raise ContractError("expected a first frame with the token of GSLCOSIM_TOKEN, it has another or none.")
        connection.settimeout(None)
        return fields


# Not a byte more than the frame, because what follows belongs to the link.
def _read_first_frame(connection: socket.socket, frame_format: FrameFormat) -> bytes:
    if frame_format == "msgpack":
        length = int.from_bytes(_read_exactly(connection, LENGTH_BYTES), "big")
        _check_length(length)
        return _read_exactly(connection, length)
    line = bytearray()
    while (byte := _read_exactly(connection, 1)) != b"\n":
        line += byte
        _check_length(len(line))
    return bytes(line)


def _check_length(n_bytes: int) -> None:
    if n_bytes > MAX_HELLO_BYTES:
        raise ContractError(f"expected a first frame of at most {MAX_HELLO_BYTES} bytes, was {n_bytes} or more.")


def _read_exactly(connection: socket.socket, n_bytes: int) -> bytes:
    data = bytearray()
    while len(data) < n_bytes:
        piece = connection.recv(n_bytes - len(data))
        if not piece:
            raise ContractError(f"expected a first frame with the token, the stream ended after {len(data)} bytes.")
        data += piece
    return bytes(data)
