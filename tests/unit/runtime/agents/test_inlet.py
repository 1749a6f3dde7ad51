"""Commands from the bus wait in bounded memory, however many come and however large they are."""

from gslcosim.runtime.agents.door import MAX_COMMAND_BYTES
from gslcosim.runtime.agents.inlet import COMMAND, MAX_WAITING_BYTES, REFUSED, CommandQueue


def inlet_with_events():
    events = []
    return CommandQueue("beetle", lambda *event: events.append(event)), events


def test_a_command_becomes_an_event():
    inlet, events = inlet_with_events()
    inlet.on_command("agents/beetle/command", b"payload")
    assert events == [(COMMAND, "beetle", b"payload")]


def test_a_flood_is_dropped_beyond_the_limit_and_told_once():
    inlet, events = inlet_with_events()
    payload = bytes(MAX_COMMAND_BYTES)
    for _ in range(100):
        inlet.on_command("agents/beetle/command", payload)
    kinds = [kind for kind, _, _ in events]
    assert kinds.count(COMMAND) == MAX_WAITING_BYTES // MAX_COMMAND_BYTES
    assert kinds[-1] == REFUSED
    assert kinds.count(REFUSED) == 1
    assert b"was a flood" in events[-1][2]


def test_many_tiny_commands_count_for_what_they_cost():
    inlet, events = inlet_with_events()
    for _ in range(200_000):
        inlet.on_command("agents/beetle/command", b"")
    assert len(events) < 150_000


def test_who_is_judged_in_time_is_never_dropped():
    inlet, events = inlet_with_events()
    payload = bytes(MAX_COMMAND_BYTES)
    for _ in range(200):
        inlet.on_command("agents/beetle/command", payload)
        inlet.handled(events.pop()[2])
    assert events == []


def test_a_command_that_is_too_long_is_refused_with_both_figures():
    inlet, events = inlet_with_events()
    inlet.on_longer("agents/beetle/command", 50_000_000)
    assert events == [(REFUSED, "beetle", b"expected at most 1048576 bytes, was 50000000.")]
