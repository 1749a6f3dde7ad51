"""Length-prefixed frames on a byte stream: the length of a payload in 4 bytes, big-endian, and the payload."""

from io import RawIOBase
from typing import BinaryIO

LENGTH_BYTES = 4


def prefix_length(payload: bytes) -> bytes:
    """Return a payload behind its length."""
    return len(payload).to_bytes(LENGTH_BYTES, "big") + payload


def read_frame(stream: BinaryIO | RawIOBase) -> bytes | None:
    """Return the payload of the next frame of a stream; None where the stream ends before or within it."""
    head = _read(stream, LENGTH_BYTES)
    n_bytes = int.from_bytes(head, "big")
    payload = _read(stream, n_bytes)
    return payload if len(head) == LENGTH_BYTES and len(payload) == n_bytes else None


# An unbuffered stream returns fewer bytes than it was asked for.
def _read(stream: BinaryIO | RawIOBase, n_bytes: int) -> bytes:
    data = stream.read(n_bytes) or b""
    while len(data) < n_bytes and (piece := stream.read(n_bytes - len(data))):
        data += piece
    return data
