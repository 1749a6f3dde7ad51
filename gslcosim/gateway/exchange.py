"""Question and answer over a byte stream, on one thread: a frame goes out, and the next one is waited for."""

import time
from collections import deque

from gslcosim.contract.messages import Message
from gslcosim.errors import ContractError, GslCosimError
from gslcosim.gateway.framing import FrameFormat, Item, Refused, frame_of_message, payload_of_frame, splitter_of
from gslcosim.gateway.streams import Stream


class StreamEndedError(GslCosimError):
    """The other side has ended its stream, or does not read any more."""


class AnswerLateError(GslCosimError):
    """Nothing came, or not everything could be written, within the time."""


class FrameExchange:
    """Both sides speak in turn; unlike `Link` it waits, and whoever uses it has nothing else to do meanwhile."""

    def __init__(self, stream: Stream, frame_format: FrameFormat) -> None:
        self._stream = stream
        self._format: FrameFormat = frame_format
        self._splitter = splitter_of(frame_format)
        self._items: deque[Item] = deque()
        self._has_ended = False

    @property
    def has_more(self) -> bool:
        """Whether something has come that nobody has taken yet."""
        return self.comes_within(0.0)

    def comes_within(self, within_s: float) -> bool:
        """Return whether something is there that nobody has taken yet, or comes within a time [s]."""
        if not self._items and not self._has_ended and self._stream.wait_readable(within_s):
            self._read()
        return bool(self._items)

    def send(self, name: str, payload: bytes, *, within_s: float) -> None:
        """Send a message.

        Args:
            name: The message's type.
            payload: The message's canonical bytes.
            within_s: How long it may take [s].

        Raises:
            StreamEndedError: the other side reads no more.
            AnswerLateError: it has not read within the time.
        """
        deadline_s = time.monotonic() + within_s
        data = frame_of_message(self._format, name, payload)
        while data:
            try:
                data = data[self._stream.write_now(data) :]
            except OSError as error:
                raise StreamEndedError("it does not read any more") from error
            if data and not self._stream.wait_writable(max(0.0, deadline_s - time.monotonic())):
                raise AnswerLateError(f"it has not read what it was sent within {within_s:g} s")

    def receive(self, message_type: type[Message], *, within_s: float) -> bytes:
        """Return the next frame as the msgpack map of a message, to be judged.

        Args:
            message_type: What it is meant to be.
            within_s: How long to wait for it [s].

        Raises:
            StreamEndedError: the stream has ended.
            AnswerLateError: nothing came within the time.
            ContractError: what came is no frame.
        """
        deadline_s = time.monotonic() + within_s
        while not self._items:
            if self._has_ended:
                raise StreamEndedError(self._splitter.rest() or "it closed its output")
            if not self._stream.wait_readable(max(0.0, deadline_s - time.monotonic())):
                raise AnswerLateError(f"nothing came within {within_s:g} s")
            self._read()
        item = self._items.popleft()
        if isinstance(item, Refused):
            raise ContractError(item.text)
        return payload_of_frame(self._format, item.payload, message_type)

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
