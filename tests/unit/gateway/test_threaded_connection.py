"""A link never makes the run wait, never keeps more than it may, and says once how it ended."""

import os
import queue
import socket
import threading

import msgpack
import pytest
from deadlines import EVENT_S

from gslcosim.contract import codec
from gslcosim.contract.messages import Command, Ending
from gslcosim.gateway import connections as link_module
from gslcosim.gateway.connections import MAX_UNHANDLED, PipeStream, SocketStream, ThreadedConnection
from gslcosim.gateway.frame_codec import encode_fields

HOLD = {"tick": 1, "kind": "hold"}


class Agent:
    """The agent's side of a link."""

    def __init__(self, link, door):
        if door == "socket":
            ours, self.socket = socket.socketpair()
            link.open(SocketStream(ours))
            self.input, self.output = self.socket.makefile("rb"), self.socket.makefile("wb", buffering=0)
        else:
            (their_in, our_out), (our_in, their_out) = os.pipe(), os.pipe()
            link.open(PipeStream(os.fdopen(our_out, "wb", 0), os.fdopen(our_in, "rb", 0)))
            self.socket = None
            self.input, self.output = os.fdopen(their_in, "rb"), os.fdopen(their_out, "wb", 0)

    def close(self):
        self.input.close()
        self.output.close()
        if self.socket:
            self.socket.close()


@pytest.fixture(params=["pipes", "socket"])
def linked(request):
    """Return a function that makes a link with its events and its agent; all are closed afterwards."""
    made = []

    def make(frame_format="msgpack"):
        events = queue.SimpleQueue()
        link = ThreadedConnection(frame_format, lambda kind, data: events.put((kind, data)))
        made.append((link, Agent(link, request.param)))
        return link, events, made[-1][1]

    yield make
    for link, agent in made:
        link.end()
        agent.close()


@pytest.mark.parametrize("frame_format", ["msgpack", "json"])
def test_messages_go_out_and_commands_come_in(linked, frame_format):
    link, events, agent = linked(frame_format)
    link.send("Ending", codec.encode(Ending(tick=3, reason="success")))
    expected = encode_fields(frame_format, {"message": "Ending", "tick": 3, "reason": "success"})
    assert agent.input.read(len(expected)) == expected
    agent.output.write(encode_fields(frame_format, HOLD))
    kind, payload = events.get(timeout=EVENT_S)
    assert kind == "command"
    assert codec.decode(Command, payload) == Command(**HOLD)


def test_what_is_sent_before_the_agent_connects_waits_for_it():
    events = queue.SimpleQueue()
    link = ThreadedConnection("json", lambda kind, data: events.put((kind, data)))
    link.send("Ending", codec.encode(Ending(tick=1, reason="a")))
    agent = Agent(link, "socket")
    assert b'"reason":"a"' in agent.input.readline()
    link.end()
    agent.close()


def test_an_agent_that_reads_late_gets_everything_in_order(linked):
    """Telling never waits, though a pipe holds only a few kilobytes."""
    link, _, agent = linked()
    n_messages = 20_000
    for tick in range(n_messages):
        link.send("Ending", codec.encode(Ending(tick=tick, reason="x" * 100)))
    link.end()
    unpacked = []
    while header := agent.input.read(4):
        unpacked.append(msgpack.unpackb(agent.input.read(int.from_bytes(header, "big")))["tick"])
    assert unpacked == list(range(n_messages))


def test_an_agent_that_never_reads_is_given_up(linked, monkeypatch):
    monkeypatch.setattr(link_module, "MAX_BACKLOG_BYTES", 1_000_000)
    link, events, _ = linked()
    payload = codec.encode(Ending(tick=1, reason="x" * 10_000))
    for _ in range(200):
        link.send("Ending", payload)
    kind, text = events.get(timeout=EVENT_S)
    assert (kind, text) == ("closed", b"expected an agent that reads what it is sent, 1000000 bytes are unread.")
    assert not link._backlog


def test_no_more_events_wait_than_allowed(linked):
    """The reader stops at the limit, and the agent with it, until events are handled."""
    link, events, agent = linked()
    frame = encode_fields("msgpack", HOLD)
    n_frames = 50_000
    writing = threading.Thread(target=lambda: agent.output.write(frame * n_frames), daemon=True)
    writing.start()
    for _ in range(n_frames):
        assert events.get(timeout=EVENT_S)[0] == "command"
        assert events.qsize() < MAX_UNHANDLED
        link.acknowledge()
    writing.join(EVENT_S)
    assert not writing.is_alive()


def test_after_the_end_whatever_is_said_is_thrown_away(linked):
    """An agent that goes on talking can do so, and nobody waits for anybody."""
    link, events, agent = linked()
    link.end()
    assert agent.input.read() == b""
    frames = memoryview(encode_fields("msgpack", HOLD) * 100_000)
    while frames:  # an unbuffered write may write less
        frames = frames[agent.output.write(frames) :]
    assert events.empty()


def test_a_bad_frame_is_reported_and_the_next_one_read(linked):
    _, events, agent = linked("json")
    agent.output.write(b"hello\n" + encode_fields("json", HOLD))
    assert events.get(timeout=EVENT_S)[0] == "refused"
    assert events.get(timeout=EVENT_S)[0] == "command"


def test_a_hundred_megabytes_are_refused_and_not_kept(linked):
    _, events, agent = linked()
    n_bytes = 100_000_000
    agent.output.write(n_bytes.to_bytes(4, "big"))
    assert events.get(timeout=EVENT_S) == ("refused", b"expected at most 1048576 bytes, was 100000000.")
    left = n_bytes
    while left:
        left -= agent.output.write(bytes(min(left, 2**20)))
    agent.output.write(encode_fields("msgpack", HOLD))
    assert events.get(timeout=EVENT_S)[0] == "command"


def test_nonsense_for_a_length_ends_the_link(linked):
    _, events, agent = linked()
    agent.output.write(b"Starting up\n")
    kind, text = events.get(timeout=EVENT_S)
    assert kind == "closed"
    assert b"'Star'" in text
    assert agent.input.read() == b""
    assert events.empty()


@pytest.mark.parametrize(("last", "expected"), [(b"", b""), (b"\0\0\0", b"expected whole frames")])
def test_the_end_of_the_agents_stream_is_reported_after_all_it_said(linked, last, expected):
    _, events, agent = linked()
    agent.output.write(encode_fields("msgpack", HOLD) + last)
    agent.output.close()
    if agent.socket:
        agent.socket.shutdown(socket.SHUT_WR)
    assert events.get(timeout=EVENT_S)[0] == "command"
    kind, text = events.get(timeout=EVENT_S)
    assert kind == "ended"
    assert text.startswith(expected)


def test_an_agent_that_has_closed_its_input_is_still_received(linked):
    link, events, agent = linked()
    agent.input.close()
    if agent.socket:
        agent.socket.shutdown(socket.SHUT_RD)
    for _ in range(3):
        link.send("Ending", codec.encode(Ending(tick=1, reason="a")))
    agent.output.write(encode_fields("msgpack", HOLD))
    assert events.get(timeout=EVENT_S)[0] == "command"
