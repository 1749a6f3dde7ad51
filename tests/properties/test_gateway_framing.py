"""A stream means the same however it is cut, and no bytes at all bring the gateway down."""

import itertools

import msgpack
from hypothesis import given
from hypothesis import strategies as st

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.gateway import frame_codec
from gslcosim.gateway.frame_codec import Frame, RefusedFrame
from gslcosim.runtime.agents.validator import CommandValidator

FORMATS = st.sampled_from(["msgpack", "json"])
TEXTS = st.text(st.characters(codec="utf-8"), max_size=20)
NUMBERS = st.integers(-(2**63), 2**64 - 1) | st.floats(allow_nan=False, allow_infinity=False)
LEAVES = st.none() | st.booleans() | NUMBERS | TEXTS
VALUES = st.recursive(LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3))
MAPS = st.dictionaries(TEXTS, VALUES, max_size=20)


def pieces(data, cuts):
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[start:end] for start, end in itertools.pairwise(edges)]


def split(frame_format, data, cuts=()):
    splitter = frame_codec.build_splitter(frame_format)
    items = [item for piece in pieces(data, cuts) for item in splitter.feed(piece)]
    return items, splitter.rest()


@given(FORMATS, st.lists(MAPS, max_size=5), st.lists(st.integers(0, 2**20), max_size=10))
def test_maps_come_back_however_the_stream_is_cut(frame_format, maps, cuts):
    data = b"".join(frame_codec.encode_fields(frame_format, fields) for fields in maps)
    items, rest = split(frame_format, data, cuts)
    assert [frame_codec.decode_fields(frame_format, item.payload) for item in items] == maps
    assert rest == ""


@given(FORMATS, MAPS)
def test_both_formats_reach_the_validator_as_the_same_bytes(frame_format, fields):
    (item,), _ = split(frame_format, frame_codec.encode_fields(frame_format, fields))
    assert frame_codec.decode_payload(frame_format, item.payload) == msgpack.packb(fields)


@given(TEXTS.filter(bool), MAPS.filter(lambda fields: "message" not in fields))
def test_the_type_is_the_first_key_and_the_rest_stays_as_it_was(name, fields):
    (item,), _ = split("msgpack", frame_codec.encode_message("msgpack", name, msgpack.packb(fields)))
    assert item.payload == msgpack.packb({"message": name, **fields})


@given(FORMATS, st.binary(max_size=400), st.lists(st.integers(0, 400), max_size=8))
def test_any_bytes_are_frames_or_refusals_and_the_validator_judges_them(frame_format, data, cuts):
    """Whatever it is, it is refused with a reason or becomes a command's bytes; where it is cut does not matter."""
    items, rest = split(frame_format, data, cuts)
    assert (items, rest) == split(frame_format, data) or any(isinstance(item, RefusedFrame) for item in items)
    validator = CommandValidator("beetle")
    for item in items:
        assert isinstance(item, Frame) or item.text
        if isinstance(item, Frame):
            judge(validator, frame_format, item.payload)


def judge(validator, frame_format, frame):
    try:
        payload = frame_codec.decode_payload(frame_format, frame)
    except ContractError:
        return
    frame_codec.read_agent_name(payload)
    assert validator.on_answer(payload) == []


@given(st.integers(0, 2**32 - 1), st.binary(max_size=64))
def test_a_length_is_taken_refused_or_the_end(length, data):
    splitter = frame_codec.MsgpackSplitter()
    items = splitter.feed(length.to_bytes(4, "big") + data)
    is_fatal = any(isinstance(item, RefusedFrame) and item.is_fatal for item in items[:1])
    assert is_fatal == (length > frame_codec.MAX_SKIPPED_BYTES)
    assert len(splitter._buffer) <= 4 + len(data)


def test_the_validator_takes_what_a_frame_may_hold():
    from gslcosim.runtime.agents.validator import MAX_COMMAND_BYTES

    assert frame_codec.MAX_FRAME_BYTES == MAX_COMMAND_BYTES
    assert codec.MAX_MESSAGE_BYTES >= frame_codec.MAX_FRAME_BYTES
