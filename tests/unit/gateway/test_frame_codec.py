"""Frames: what is taken, what is refused and in which words, and that limits hold."""

import json

import msgpack
import pytest
from built_messages import build_observation

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.contract.messages import Ending, Observation
from gslcosim.gateway import frame_codec
from gslcosim.gateway.frame_codec import Frame, JsonSplitter, MsgpackSplitter, RefusedFrame

OBSERVATION = build_observation(7, time_s=0.7, position_world_m=(1.0, 2.5, -0.1), yaw_rad=1e-17, notice="größer, ↑")


def with_length(payload):
    return len(payload).to_bytes(4, "big") + payload


def frames_of(splitter, data):
    return [item.payload if isinstance(item, Frame) else item for item in splitter.feed(data)]


@pytest.mark.parametrize("frame_format", ["msgpack", "json"])
def test_a_message_arrives_with_its_type_and_nothing_else_changed(frame_format):
    frame = frame_codec.encode_message(frame_format, "Observation", codec.encode(OBSERVATION))
    (payload,) = frames_of(frame_codec.build_splitter(frame_format), frame)
    fields = frame_codec.decode_fields(frame_format, payload)
    assert next(iter(fields)) == "message"
    assert fields.pop("message") == "Observation"
    assert codec.decode(Observation, msgpack.packb(fields)) == OBSERVATION


@pytest.mark.parametrize("n_keys", [1, 14, 15, 16, 300])
def test_the_type_fits_into_maps_of_every_size(n_keys):
    """msgpack counts up to 15 keys in one byte, more in three."""
    fields = {f"key_{i}": i for i in range(n_keys)}
    frame = frame_codec.encode_message("msgpack", "Ending", msgpack.packb(fields))
    assert msgpack.unpackb(frame[4:]) == {"message": "Ending", **fields}


def test_a_json_frame_is_one_line():
    frame = frame_codec.encode_message("json", "Ending", codec.encode(Ending(tick=3, reason="line\nfeed")))
    assert frame.count(b"\n") == 1
    assert json.loads(frame) == {"message": "Ending", "tick": 3, "reason": "line\nfeed"}


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"starting up", "expected one JSON object a line, was 11 bytes starting 'starting up'"),
        (b"[1, 2]", "expected one JSON object a line, was 6 bytes starting '[1, 2]'"),
        (b'{"tick": 5,}', "expected one JSON object a line"),
        (b'{"reason": "\xff"}', "expected a line in UTF-8"),
        (b"\x00\x00\x00\x05\x81\xa4tick", "as in format: msgpack"),
        (b'{"tick": 36893488147419103232}', "expected integers below 2^63"),
        (b'{"tick": ' + b"9" * 5000 + b"}", "expected one JSON object a line"),
        (b'{"reason": "\\ud800"}', "texts in UTF-8"),
        (b"[" * 100_000, "expected one JSON object a line"),
        (b'{"a":' * 100_000, "expected one JSON object a line"),
        (b'{"tick": 1, "tick": 2}', "Command: expected each key once, was 'tick' 2 times."),
        (b'{"a": ' + b"[" * 32 + b"]" * 32 + b"}", "Command: expected lists and maps at most 32 deep, were deeper."),
        (b'\xef\xbb\xbf{"tick": 1}', "expected a line in UTF-8 without a byte order mark"),
    ],
)
def test_a_line_that_is_no_object_is_refused_in_words(line, expected):
    with pytest.raises(ContractError) as refusal:
        frame_codec.decode_payload("json", line)
    assert expected in str(refusal.value)


@pytest.mark.parametrize("payload", [b"\xc1", b"", b"\x93\x01", msgpack.packb([1]), b"\x81\x01\x01", b"\x91" * 5000])
def test_what_is_no_msgpack_map_has_no_fields(payload):
    with pytest.raises(ContractError, match="expected a msgpack map"):
        frame_codec.decode_fields("msgpack", payload)


def test_an_agent_is_known_by_its_key():
    assert frame_codec.read_agent_name(msgpack.packb({"tick": 1, "agent": "beetle"})) == "beetle"
    for payload in (msgpack.packb({"tick": 1}), msgpack.packb({"agent": 5}), msgpack.packb([1]), b"\xc1", b""):
        assert frame_codec.read_agent_name(payload) is None


def test_a_long_frame_is_refused_at_its_length_and_what_follows_is_read():
    splitter = MsgpackSplitter()
    n_bytes = frame_codec.MAX_FRAME_BYTES + 1
    (refused,) = splitter.feed(n_bytes.to_bytes(4, "big"))
    assert refused == RefusedFrame(f"expected at most {frame_codec.MAX_FRAME_BYTES} bytes, was {n_bytes}.")
    assert splitter.feed(bytes(n_bytes - 10)) == []
    assert "ended within one" in splitter.rest()
    assert frames_of(splitter, bytes(10) + with_length(b"next")) == [b"next"]
    assert splitter.rest() == ""


def test_the_longest_frame_is_taken():
    payload = bytes(frame_codec.MAX_FRAME_BYTES)
    assert frames_of(MsgpackSplitter(), with_length(payload)) == [payload]
    line = b"x" * frame_codec.MAX_FRAME_BYTES
    assert frames_of(JsonSplitter(), line + b"\n") == [line]


@pytest.mark.parametrize(
    ("header", "hint"),
    [
        (b"Hell", "It is the text 'Hell'. Only commands belong here."),
        (b'{"ti', "Is it JSON? Then set format: json."),
        (b"\x2a\x00\x00\x00", "As little-endian it is 42."),
        (b"\x82\xa4ti", "Its bytes 82a47469 begin a msgpack map: is the length before it missing?"),
        (b"\xff\xff\xff\xff", "was 4294967295."),
    ],
)
def test_a_length_that_cannot_be_is_the_end_and_says_what_it_looks_like(header, hint):
    splitter = MsgpackSplitter()
    (refused,) = splitter.feed(header + b"anything")
    assert refused.is_fatal
    assert hint in refused.text


def test_a_long_line_is_refused_before_its_end_and_what_follows_is_read():
    splitter = JsonSplitter()
    (refused,) = splitter.feed(b"x" * (frame_codec.MAX_FRAME_BYTES + 1))
    assert refused == RefusedFrame(f"expected a line of at most {frame_codec.MAX_FRAME_BYTES} bytes, was longer.")
    assert splitter.feed(b"y" * 1000) == []
    assert "into a line" in splitter.rest()
    assert frames_of(splitter, b"z\nnext\n") == [b"next"]


@pytest.mark.slow
def test_a_line_without_an_end_is_given_up():
    """Once, after as much as is thrown away, and nothing of it is kept."""
    splitter = JsonSplitter()
    piece = b"x" * 2**20
    items = [item for _ in range(140) for item in splitter.feed(piece)]
    assert [item.is_fatal for item in items] == [False, True]
    assert len(splitter._buffer) == 0


def test_empty_lines_are_passed_over():
    assert frames_of(JsonSplitter(), b"\n\r\n  \n{}\r\n") == [b"{}\r"]
    assert frame_codec.decode_payload("json", b"{}\r") == msgpack.packb({})


def test_a_stream_may_end_between_frames_only():
    whole, part = MsgpackSplitter(), MsgpackSplitter()
    whole.feed(with_length(b"abc"))
    part.feed(with_length(b"abc")[:-1])
    assert whole.rest() == ""
    assert part.rest() == "expected whole frames, the stream ended within one, after 6 bytes of it."
    line = JsonSplitter()
    line.feed(b"{}\n{")
    assert line.rest() == "expected a line feed after each object, the stream ended 1 bytes into a line."


def test_a_token_frame_has_each_key_once():
    with pytest.raises(ContractError, match="frame: expected each key once"):
        frame_codec.decode_fields("json", b'{"token": "a", "token": "b"}')
    with pytest.raises(ContractError, match="frame: expected each key once"):
        frame_codec.decode_fields("msgpack", b"\x82\xa1t\x01\xa1t\x02")
