"""Commands from the bus wait in bounded memory, however many come and however large they are."""

from gslcosim.runtime.agents.bus_transport import MAX_QUEUED_BYTES, BusTransport
from gslcosim.runtime.agents.session import CommandReceived, CommandRefused
from gslcosim.runtime.agents.validator import MAX_COMMAND_BYTES


def link_with_events():
    events = []
    return BusTransport("beetle", None, events.append), events


def test_a_command_becomes_an_event():
    link, events = link_with_events()
    link.on_command("agents/beetle/command", b"payload")
    assert events == [CommandReceived(agent="beetle", payload=b"payload")]


def test_a_flood_is_dropped_beyond_the_limit_and_reported_once():
    link, events = link_with_events()
    payload = bytes(MAX_COMMAND_BYTES)
    for _ in range(100):
        link.on_command("agents/beetle/command", payload)
    kinds = [type(event) for event in events]
    assert kinds.count(CommandReceived) == MAX_QUEUED_BYTES // MAX_COMMAND_BYTES
    assert kinds[-1] is CommandRefused
    assert kinds.count(CommandRefused) == 1
    assert "was a flood" in events[-1].text


def test_many_tiny_commands_count_for_what_they_cost():
    link, events = link_with_events()
    for _ in range(200_000):
        link.on_command("agents/beetle/command", b"")
    assert len(events) < 150_000


def test_who_is_judged_in_time_is_never_dropped():
    link, events = link_with_events()
    payload = bytes(MAX_COMMAND_BYTES)
    for _ in range(200):
        link.on_command("agents/beetle/command", payload)
        link.acknowledge(events.pop())
    assert events == []


def test_a_command_that_is_too_long_is_refused_with_both_figures():
    link, events = link_with_events()
    link.on_longer("agents/beetle/command", 50_000_000)
    assert events == [CommandRefused(agent="beetle", text="expected at most 1048576 bytes, was 50000000.")]
