"""What the door does with an agent's word about its contract."""

import msgpack

from gslcosim.contract import codec
from gslcosim.contract.messages import CONTRACT_VERSION, Command, Observation
from gslcosim.contract.schema import format_own_contract
from gslcosim.runtime.agents.validator import CommandValidator


def question(tick):
    return Observation(
        tick=tick,
        agent="beetle",
        time_s=0.0,
        position_world_m=(0.0, 0.0, 0.0),
        yaw_rad=0.0,
        velocity_world_m_s=(0.0, 0.0, 0.0),
        status="on_ground",
        awaiting_command=True,
        readings=(),
    )


def answer(tick, contract):
    return codec.encode(Command(tick=tick, kind="hold", contract=contract))


def asked_door(tick=0):
    door = CommandValidator("beetle")
    door.observed(question(tick))
    return door


def test_what_fits_passes_without_a_trace():
    """The same flight leaves the same commands, whether or not the agent says what it speaks."""
    told, silent = asked_door(), asked_door()
    assert told.received(answer(0, format_own_contract())) == silent.received(answer(0, None))
    assert told.faults == silent.faults == []


def test_an_agent_of_another_major_version_is_gone_with_a_reason():
    door = asked_door()
    (command,) = door.received(answer(0, "2.0"))
    assert command.kind == "failed"
    (fault,) = door.faults
    assert "expected major version 1" in fault.text
    assert door.is_closed


def test_the_contract_is_named_even_where_the_command_makes_no_sense_here():
    door = asked_door()
    (command,) = door.received(msgpack.packb({"tick": 0, "go": "left", "contract": "2.0"}))
    assert command.kind == "failed"
    assert "was 2.0" in door.faults[0].text


def test_another_hash_is_a_fault_once_and_the_flight_goes_on():
    door = asked_door()
    strange = f"{CONTRACT_VERSION}+{'0' * 32}"
    assert door.received(answer(0, strange))[0].kind == "hold"
    door.observed(question(1))
    assert door.received(answer(1, strange))[0].kind == "hold"
    assert len(door.faults) == 1
    assert "expected hash" in door.faults[0].text
