"""Messages as frames on a byte stream, and a byte stream as frames: pure functions with limits.

A msgpack frame is the length of a msgpack map as 4 bytes, big-endian, and the map. A JSON frame is one object on one
line, in UTF-8, ended by a line feed. The gateway sends the map of a message with one more key in front, `message`: its
type. An agent sends the map of a `Command`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast

import msgpack  # pyright: ignore[reportMissingTypeStubs]

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.contract.length_prefix import LENGTH_BYTES, prefix_length
from gslcosim.contract.messages import Command, Message

FrameFormat = Literal["msgpack", "json"]

MAX_FRAME_BYTES = 1024 * 1024
MAX_SKIPPED_BYTES = 128 * 1024 * 1024
MESSAGE_KEY = "message"
_LINE_FEED = b"\n"
_MAX_SMALL_MAP = 15
_MAP_HEADER_BYTES = (*range(0x80, 0x90), 0xDE, 0xDF)
# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class Frame:
    """Piece of a stream between two boundaries: a msgpack map or a line, as yet unread."""

    payload: bytes


@dataclass(frozen=True)
class RefusedFrame:
    """A rejected frame and the reason; after a fatal one nothing more can be read from the stream."""

    text: str
    is_fatal: bool = False


FrameOrRefusal = Frame | RefusedFrame


class MsgpackSplitter:
    """Cuts a byte stream into length-prefixed frames, whatever pieces it comes in.

    A frame that is too long is refused when its length is known, and then thrown away as it comes.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._to_skip = 0

    def feed(self, data: bytes) -> list[FrameOrRefusal]:
        """Take the next piece of the stream; return the frames that are complete with it."""
        skipped = min(self._to_skip, len(data))
        self._to_skip -= skipped
        self._buffer += memoryview(data)[skipped:]
        items: list[FrameOrRefusal] = []
        start = 0
        while len(self._buffer) - start >= LENGTH_BYTES:
            end = start + LENGTH_BYTES
            length = int.from_bytes(self._buffer[start:end], "big")
            if length > MAX_SKIPPED_BYTES:
                items.append(RefusedFrame(_describe_bad_length(length, bytes(self._buffer[start:end])), is_fatal=True))
                start = len(self._buffer)
            elif length > MAX_FRAME_BYTES:
                items.append(RefusedFrame(f"expected at most {MAX_FRAME_BYTES} bytes, was {length}."))
                start = min(end + length, len(self._buffer))
                self._to_skip = length - (start - end)
            elif len(self._buffer) < end + length:
                break
            else:
                items.append(Frame(bytes(self._buffer[end : end + length])))
                start = end + length
        del self._buffer[:start]
        return items

    def rest(self) -> str:
        """Return the fault of a stream that ends here; empty when it ends between two frames."""
        if not self._buffer and not self._to_skip:
            return ""
        return f"expected whole frames, the stream ended within one, after {len(self._buffer)} bytes of it."


class JsonSplitter:
    """Cuts a byte stream into lines, whatever pieces it comes in; empty lines are passed over.

    A line that is too long is refused as soon as it is, and thrown away up to its end.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._n_skipped = 0
        self._is_skipping = False

    def feed(self, data: bytes) -> list[FrameOrRefusal]:
        """Take the next piece of the stream; return the lines that are complete with it."""
        items: list[FrameOrRefusal] = []
        *lines, last = data.split(_LINE_FEED)
        for piece in lines:
            self._take(piece, items)
            if self._buffer and not self._buffer.isspace():
                items.append(Frame(bytes(self._buffer)))
            self._buffer.clear()
            self._is_skipping = False
        self._take(last, items)
        return items

    def rest(self) -> str:
        """Return the fault of a stream that ends here; empty when it ends after a line feed."""
        if not self._is_skipping and (not self._buffer or self._buffer.isspace()):
            return ""
        n_bytes = self._n_skipped if self._is_skipping else len(self._buffer)
        return f"expected a line feed after each object, the stream ended {n_bytes} bytes into a line."

    def _take(self, piece: bytes, items: list[FrameOrRefusal]) -> None:
        if self._is_skipping:
            before, self._n_skipped = self._n_skipped, self._n_skipped + len(piece)
            if before <= MAX_SKIPPED_BYTES < self._n_skipped:
                text = f"expected a line of at most {MAX_FRAME_BYTES} bytes, was over {MAX_SKIPPED_BYTES}."
                items.append(RefusedFrame(text, is_fatal=True))
        elif len(self._buffer) + len(piece) > MAX_FRAME_BYTES:
            self._is_skipping = True
            self._n_skipped = len(self._buffer) + len(piece)
            self._buffer.clear()
            items.append(RefusedFrame(f"expected a line of at most {MAX_FRAME_BYTES} bytes, was longer."))
        else:
            self._buffer += piece


Splitter = MsgpackSplitter | JsonSplitter


def build_splitter(frame_format: FrameFormat) -> Splitter:
    """Return a fresh splitter for a stream in this format."""
    return JsonSplitter() if frame_format == "json" else MsgpackSplitter()


def encode_fields(frame_format: FrameFormat, fields: Mapping[str, Any]) -> bytes:
    """Return a map as one frame."""
    if frame_format == "json":
        return codec.dump_json_line(dict(fields)) + _LINE_FEED
    return prefix_length(_msgpack.packb(fields, use_bin_type=True))


def encode_message(frame_format: FrameFormat, name: str, payload: bytes) -> bytes:
    """Return the frame of a message for an agent."""
    if frame_format == "json":
        fields: dict[str, Any] = _msgpack.unpackb(payload, raw=False)
        return encode_fields("json", {MESSAGE_KEY: name, **fields})
    return prefix_length(_insert_first_key(MESSAGE_KEY, name, payload))


def decode_fields(frame_format: FrameFormat, frame: bytes) -> dict[str, Any]:
    """Return the map in a frame."""
    if frame_format == "json":
        return _decode_line("frame", frame)
    return codec.unpack_untrusted("frame", frame, has_lists=True)


def decode_payload(frame_format: FrameFormat, frame: bytes, message_type: type[Message] = Command) -> bytes:
    """Return the message of an agent or participant as msgpack, to be checked by the caller.

    A msgpack frame is passed on as it is; an object of JSON becomes the same map in msgpack.
    """
    if frame_format == "msgpack":
        return frame
    name = message_type.__name__
    fields = codec.decode_base64_fields(message_type, _decode_line(name, frame))
    try:
        return _msgpack.packb(fields, use_bin_type=True)
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise ContractError(f"{name}: expected integers below 2^63 and texts in UTF-8 ({error}).") from error


def read_agent_name(payload: bytes) -> str | None:
    """Return the name of the agent in a command; None if it has none, or cannot be read."""
    try:
        fields: Any = _msgpack.unpackb(payload, raw=False)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return None
    name = cast(dict[str, Any], fields).get("agent") if isinstance(fields, dict) else None
    return name if isinstance(name, str) else None


# NaN and Infinity, which Python's parser takes although JSON has none, are left to the validator: it names the field.
def _decode_line(name: str, line: bytes) -> dict[str, Any]:
    if line.startswith(_BYTE_ORDER_MARK):
        raise ContractError(f"expected a line in UTF-8 without a byte order mark, was {_format_start(line)}.")
    try:
        fields = codec.load_untrusted_json(name, line.decode())
    except UnicodeDecodeError as error:
        raise ContractError(f"expected a line in UTF-8, was {_format_start(line)} ({error.reason}).") from error
    except (ValueError, RecursionError) as error:
        raise ContractError(f"expected one JSON object a line, was {_format_start(line)} ({error}).") from error
    if not isinstance(fields, dict):
        raise ContractError(f"expected one JSON object a line, was {_format_start(line)}.")
    return cast(dict[str, Any], fields)


# The map's other bytes stay as they are: only its count of keys grows by one.
def _insert_first_key(key: str, value: str, packed_map: bytes) -> bytes:
    first: bytes = _msgpack.packb(key) + _msgpack.packb(value)
    head = packed_map[0]
    if 0x80 <= head <= 0x8F:
        n_keys, rest = head & 0x0F, packed_map[1:]
    elif head == 0xDE:
        n_keys, rest = int.from_bytes(packed_map[1:3], "big"), packed_map[3:]
    else:
        raise ContractError(f"expected a msgpack map, was {_format_start(packed_map)}.")
    n_keys += 1
    count = bytes([0x80 | n_keys]) if n_keys <= _MAX_SMALL_MAP else b"\xde" + n_keys.to_bytes(2, "big")
    return count + first + rest


def _describe_bad_length(length: int, header: bytes) -> str:
    text = f"expected the length of a frame in 4 bytes, big-endian, at most {MAX_SKIPPED_BYTES}, was {length}."
    if length == 0 or not all(0x20 <= byte < 0x7F or byte in b"\t\r\n" for byte in header):
        little = int.from_bytes(header, "little")
        if little <= MAX_FRAME_BYTES:
            return f"{text} As little-endian it is {little}."
        is_map = header[0] in _MAP_HEADER_BYTES
        return (
            f"{text} Its bytes {header.hex()} begin a msgpack map: is the length before it missing?" if is_map else text
        )
    hint = "Is it JSON? Then set format: json." if header.lstrip()[:1] == b"{" else "Only commands belong here."
    return f"{text} It is the text {header.decode()!r}. {hint}"


def _format_start(data: bytes) -> str:
    shown = data[:40].decode(errors="backslashreplace")
    if data[:1] == b"\0":
        return f"{len(data)} bytes starting {data[:16].hex()}, as in format: msgpack"
    return f"{len(data)} bytes starting {shown!r}"
