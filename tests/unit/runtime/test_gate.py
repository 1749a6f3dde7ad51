"""The gate of one participant: what it waits for, and what it ignores."""

from built_messages import build_body, build_poses
from toy_cores import COMMAND, ToyFields, toy_cores, toy_dataflow

from gslcosim.contract import keys
from gslcosim.contract.messages import Command
from gslcosim.contract.participant import WINDOW_TICKS
from gslcosim.runtime.stepper import Gate, MissingInput


def poses(tick, *, awaiting=False):
    return build_poses(tick, build_body(awaiting_command=awaiting))


def open_gate(name):
    gate = Gate(toy_dataflow(), name)
    for reader in toy_cores():
        gate.grant(reader, 10_000)
    return gate


def test_a_reader_waits_for_every_tick_of_a_port():
    gate = open_gate("fields")
    gate.deliver(keys.BODIES, poses(1))
    assert gate.missing() == [MissingInput(keys.BODIES, 0)]
    assert gate.has_later(MissingInput(keys.BODIES, 0))
    gate.deliver(keys.BODIES, poses(0))
    assert gate.can_step()
    assert gate.take()[0] == 0


def test_the_world_waits_for_a_command_only_where_it_asked():
    gate = open_gate("world")
    for tick, awaiting in enumerate([False, True, False]):
        assert gate.can_step() == (tick != 2)
        if tick == 2:
            assert gate.missing() == [MissingInput(COMMAND, 1)]
            gate.deliver(COMMAND, Command(tick=1, kind="noop"))
        took, inbox = gate.take()
        assert (took, COMMAND in inbox) == (tick, tick == 2)
        gate.note(keys.BODIES, poses(tick, awaiting=awaiting))


def test_a_closed_port_is_waited_for_no_more():
    gate = open_gate("referee")
    samples = ToyFields(toy_cores()["fields"].spec)
    gate.deliver(COMMAND, Command(tick=0, kind="failed", reason="gone"))
    for tick in range(3):
        message = poses(tick, awaiting=True)
        gate.deliver(keys.BODIES, message)
        gate.deliver(keys.SAMPLES, samples.step(tick, {keys.BODIES: message})[keys.SAMPLES])
        assert gate.can_step(), tick
        assert (COMMAND in gate.take()[1]) == (tick == 0)


def test_the_past_and_the_known_are_ignored():
    gate = open_gate("fields")
    assert gate.deliver(keys.BODIES, poses(0))
    assert not gate.deliver(keys.BODIES, poses(0))
    gate.take()
    assert not gate.deliver(keys.BODIES, poses(0))
    assert not gate.deliver("truth/unread", poses(1))


def test_a_writer_stops_at_the_end_of_its_credit():
    gate = Gate(toy_dataflow(), "world")
    for reader in ("fields", "sensing", "referee", "recorder", "agent_beetle"):
        gate.grant(reader, 10 if reader == "fields" else 10_000)
    for tick in range(10 + WINDOW_TICKS + 1):
        assert gate.can_step()
        gate.take()
        gate.note(keys.BODIES, poses(tick))
    assert gate.lacking_credit() == ["fields"]
    gate.grant("fields", 11)
    assert gate.can_step()


def test_nothing_is_stepped_after_the_final_tick():
    gate = open_gate("world")
    gate.final_tick = 0
    gate.take()
    assert gate.is_finished
    assert not gate.can_step()
