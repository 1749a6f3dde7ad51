"""Only who shows the token is let in, and only once."""

import contextlib
import queue
import socket

import pytest
from deadlines import EVENT_S

from gslcosim.base.errors import SimulationFault
from gslcosim.gateway import connections as listener_module
from gslcosim.gateway.connections import Listener
from gslcosim.gateway.frame_codec import encode_fields


@pytest.fixture(params=["tcp", "unix"])
def listener(request, tmp_path):
    listener = Listener.open_tcp() if request.param == "tcp" else Listener.open_unix(tmp_path / "agent.sock")
    yield listener
    listener.close()


@pytest.fixture
def connections():
    """Return a function that connects to a listener; all connections are closed afterwards."""
    made = []

    def connect(listener):
        kind, _, address = listener.address.partition(":")
        if kind == "unix":
            connection = socket.socket(socket.AF_UNIX)
            made.append(connection)
            connection.connect(address)
            return connection
        host, _, port = address.rpartition(":")
        made.append(socket.create_connection((host, int(port))))
        return made[-1]

    yield connect
    for connection in made:
        connection.close()


@pytest.fixture
def events(listener):
    """Return the queue of what a listener tells, for agents that speak JSON."""
    events = queue.SimpleQueue()
    listener.admit(
        "json", lambda stream, hello: events.put(("in", stream, hello)), lambda text: events.put(("out", text))
    )
    return events


def let_in(events):
    kind, stream, hello = events.get(timeout=EVENT_S)
    assert kind == "in"
    return stream, hello


def test_who_shows_the_token_is_let_in_and_what_follows_is_kept(listener, events, connections):
    connection = connections(listener)
    connection.sendall(encode_fields("json", {"token": listener.token, "extra": 1}) + b"first line\n")
    stream, hello = let_in(events)
    assert hello["extra"] == 1
    assert stream.read() == b"first line\n"
    assert stream.write_now(b"back") == 4
    assert connection.recv(10) == b"back"
    stream.close_input()
    stream.close_output()


@pytest.mark.parametrize(
    "first",
    [
        encode_fields("json", {"token": "guessed"}),
        encode_fields("json", {}),
        encode_fields("json", {"token": 5}),
        b'{"token": "\\ud800"}\n',
        b"hello\n",
        encode_fields("msgpack", {"token": "x"}) + b"\n",
        b"x" * 5000,
    ],
)
def test_anybody_else_is_sent_away_and_the_agent_may_still_come(listener, events, connections, first):
    stranger = connections(listener)
    stranger.sendall(first)
    kind, text = events.get(timeout=EVENT_S)
    assert kind == "out"
    assert text.startswith("a connection was refused: expected ")
    connections(listener).sendall(encode_fields("json", {"token": listener.token}))
    stream, _ = let_in(events)
    stream.close_input()
    stream.close_output()


def test_strangers_who_say_nothing_do_not_keep_the_agent_out(listener, events, connections, monkeypatch):
    monkeypatch.setattr(listener_module, "HELLO_TIMEOUT_S", 0.05)
    for _ in range(2 * listener_module.MAX_PENDING_CONNECTIONS):
        connections(listener)
    connections(listener).sendall(encode_fields("json", {"token": listener.token}))
    while (event := events.get(timeout=EVENT_S))[0] == "out":
        pass
    event[1].close_input()
    event[1].close_output()


def test_nobody_follows_the_agent(listener, events, connections):
    hello = encode_fields("json", {"token": listener.token})
    first, second = connections(listener), connections(listener)
    first.sendall(hello)
    stream, _ = let_in(events)
    second.settimeout(EVENT_S)
    # It may be turned away before it has said a word.
    with contextlib.suppress(ConnectionError):
        second.sendall(hello)
        assert second.recv(1) == b""
    stream.close_input()
    stream.close_output()
    assert events.empty()


def test_a_place_that_is_taken_is_a_fault_with_its_name(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(SimulationFault, match="expected to listen on"):
        Listener.open_unix(tmp_path / "taken")


def test_a_unix_socket_is_for_its_owner_only(tmp_path):
    listener = Listener.open_unix(tmp_path / "agent.sock")
    assert (tmp_path / "agent.sock").stat().st_mode & 0o077 == 0
    listener.admit("json", lambda *_: None, lambda _: None)
    listener.close()
