"""One agent's frames over a byte stream: sent without ever waiting, received by a thread with bounded memory."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Literal

from gslcosim.errors import ContractError
from gslcosim.gateway.framing import FrameFormat, Item, Refused, frame_of_message, payload_of_frame, splitter_of
from gslcosim.gateway.streams import Stream

MAX_UNHANDLED = 16
MAX_BACKLOG_BYTES = 64 * 1024 * 1024

EventKind = Literal["command", "refused", "closed", "ended"]
OnEvent = Callable[[EventKind, bytes], None]


class Link:
    """What the run says to an agent and what the agent says to the run.

    `on_event` is called on a thread of the link; it only enqueues. Whoever handles a `command` or `refused` event then
    calls `handled`: no more than `MAX_UNHANDLED` of them wait, after that the agent does. The events are
    `command`, bytes for the door; `refused`, why a frame cannot be one; `closed`, why this side has given the agent
    up; `ended`, what is wrong with how the agent's stream ended. One of the last two comes last.

    What the agent does not read yet is kept, up to `MAX_BACKLOG_BYTES`; then the agent is given up.
    """

    def __init__(self, frame_format: FrameFormat, on_event: OnEvent) -> None:
        self._format: FrameFormat = frame_format
        self._on_event = on_event
        self._stream: Stream | None = None
        self._backlog: deque[bytes] = deque()
        self._backlog_bytes = 0
        self._lock = threading.Condition()
        self._slots = threading.Semaphore(MAX_UNHANDLED)
        self._is_over = False  # nothing more is told to the agent
        self._is_muted = False  # nothing more is heard from it
        self._is_given_up = False

    def open(self, stream: Stream) -> None:
        """Begin to speak over a stream; what has been told before goes first."""
        with self._lock:
            self._stream = stream
        threading.Thread(target=self._read_all, args=(stream,), daemon=True).start()
        threading.Thread(target=self._write_backlog, args=(stream,), daemon=True).start()

    def tell(self, name: str, payload: bytes) -> None:
        """Send a message to the agent, or keep it until it can be sent; never waits.

        Args:
            name: The message's type, such as `Observation`.
            payload: The message's canonical bytes.
        """
        frame = frame_of_message(self._format, name, payload)
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

    def handled(self) -> None:
        """Take note that an event has been handled, so that the next one may come."""
        self._slots.release()

    def end(self) -> None:
        """Let the stream end after what has been told; whatever the agent still says is thrown away."""
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

    # Returns what did not fit. An agent that does not read any more may still speak: how that ends is told later.
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
        splitter = splitter_of(self._format)
        while not self._is_given_up and (data := stream.read()):
            for item in splitter.feed(data):
                self._hear(item)
        stream.close_input()
        if not self._is_muted:
            self._on_event("ended", splitter.rest().encode())

    def _hear(self, item: Item) -> None:
        kind: EventKind = "refused"
        if not isinstance(item, Refused):
            try:
                kind, data = "command", payload_of_frame(self._format, item.payload)
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
