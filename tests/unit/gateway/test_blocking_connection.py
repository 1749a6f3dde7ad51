"""Question and answer over a stream: what comes, what does not, and what comes too much."""

import os

import msgpack
import pytest
from deadlines import EVENT_S

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.contract.messages import Command, Ending
from gslcosim.gateway.connections import AnswerTimeoutError, BlockingConnection, PipeStream, StreamEndedError
from gslcosim.gateway.frame_codec import decode_fields, encode_fields

ENDING = codec.encode(Ending(tick=3, reason="over"))


class OtherSide:
    """The program's ends of the two pipes."""

    def __init__(self, frame_format):
        input_pipe, output_pipe = os.pipe(), os.pipe()
        self.stream = PipeStream(
            os.fdopen(output_pipe[1], "wb", buffering=0), os.fdopen(input_pipe[0], "rb", buffering=0)
        )
        self.exchange = BlockingConnection(self.stream, frame_format)
        self.input, self.output = (
            os.fdopen(output_pipe[0], "rb", buffering=0),
            os.fdopen(input_pipe[1], "wb", buffering=0),
        )

    def close(self):
        self.exchange.close_output()
        self.exchange.close_input()
        self.input.close()
        self.output.close()


@pytest.fixture(params=["msgpack", "json"])
def sides(request):
    other = OtherSide(request.param)
    yield request.param, other
    other.close()


def test_a_message_goes_out_with_its_name_and_the_answer_comes_back_as_msgpack(sides):
    frame_format, other = sides
    other.exchange.send("Ending", ENDING, within_s=EVENT_S)
    frame = other.input.read(1000)
    frame = frame[4:] if frame_format == "msgpack" else frame
    assert decode_fields(frame_format, frame) == {"message": "Ending", "tick": 3, "reason": "over"}
    other.output.write(encode_fields(frame_format, {"tick": 3, "kind": "hold"}))
    assert msgpack.unpackb(other.exchange.receive(Command, within_s=EVENT_S)) == {"tick": 3, "kind": "hold"}
    assert not other.exchange.has_more


def test_what_comes_too_much_is_seen(sides):
    frame_format, other = sides
    other.output.write(2 * encode_fields(frame_format, {"tick": 3}))
    other.exchange.receive(Command, within_s=EVENT_S)
    assert other.exchange.has_more


def test_silence_ends_after_the_limit(sides):
    _, other = sides
    with pytest.raises(AnswerTimeoutError, match=r"nothing came within 0\.01 s"):
        other.exchange.receive(Command, within_s=0.01)


def test_an_ended_stream_is_reported_with_what_was_cut_off(sides):
    frame_format, other = sides
    other.output.write(encode_fields(frame_format, {"tick": 3})[:-2])
    other.output.close()
    with pytest.raises(StreamEndedError, match="the stream ended"):
        other.exchange.receive(Command, within_s=EVENT_S)


def test_a_frame_that_is_none_is_refused(sides):
    frame_format, other = sides
    other.output.write(b"\xff\xff\xff\xff" if frame_format == "msgpack" else b"[1]\n")
    with pytest.raises(ContractError, match="expected"):
        other.exchange.receive(Command, within_s=EVENT_S)


def test_who_does_not_read_is_not_waited_for(sides):
    _, other = sides
    long = codec.encode(Ending(tick=3, reason="x" * 1_000_000))
    with pytest.raises(AnswerTimeoutError, match="has not read what it was sent within"):
        other.exchange.send("Ending", long, within_s=0.01)


def test_who_has_closed_its_input_is_noticed(sides):
    _, other = sides
    other.input.close()
    with pytest.raises(StreamEndedError, match="does not read"):
        other.exchange.send("Ending", ENDING, within_s=EVENT_S)
