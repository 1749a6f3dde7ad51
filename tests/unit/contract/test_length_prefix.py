"""Length-prefixed frames: what is written is read again, and the end of a stream is seen."""

import io
import os
import threading

import pytest

from gslcosim.contract.length_prefix import prefix_length, read_frame


def test_payloads_come_back_in_order_and_then_nothing():
    stream = io.BytesIO(b"".join(map(prefix_length, (b"one", b"", b"three"))))
    assert [read_frame(stream) for _ in range(4)] == [b"one", b"", b"three", None]


def test_a_frame_that_comes_in_pieces_is_whole():
    payload = bytes(range(256)) * 1024  # more than a pipe holds
    source, sink = os.pipe()
    with os.fdopen(source, "rb", buffering=0) as stream:
        writer = threading.Thread(target=os.write, args=(sink, prefix_length(payload)))
        writer.start()
        assert read_frame(stream) == payload
        writer.join()
    os.close(sink)


@pytest.mark.parametrize("n_bytes", [2, 6], ids=["length", "payload"])
def test_an_end_within_a_frame_is_the_end_of_the_stream(n_bytes):
    assert read_frame(io.BytesIO(prefix_length(b"four")[:n_bytes])) is None
