"""What the validator does with an agent's word about its contract."""

import msgpack
from built_messages import build_observation

from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim.contract.version import CONTRACT_VERSION, format_own_contract
from gslcosim.runtime.agents.validator import CommandValidator


def question(tick):
    return build_observation(tick, status="on_ground")


def answer(tick, contract):
    return codec.encode(Command(tick=tick, kind="hold", contract=contract))


def asked_validator(tick=0):
    validator = CommandValidator("beetle")
    validator.on_observation(question(tick))
    return validator


def test_what_fits_passes_without_a_trace():
    """The same run leaves the same commands, whether or not the agent says what it speaks."""
    stated, silent = asked_validator(), asked_validator()
    assert stated.on_answer(answer(0, format_own_contract())) == silent.on_answer(answer(0, None))
    assert stated.faults == silent.faults == []


def test_an_agent_of_another_major_version_is_gone_with_a_reason():
    validator = asked_validator()
    (command,) = validator.on_answer(answer(0, "2.0"))
    assert command.kind == "failed"
    (fault,) = validator.faults
    assert "expected major version 1" in fault.text
    assert validator.is_closed


def test_the_contract_is_named_even_where_the_command_makes_no_sense_here():
    validator = asked_validator()
    (command,) = validator.on_answer(msgpack.packb({"tick": 0, "go": "left", "contract": "2.0"}))
    assert command.kind == "failed"
    assert "was 2.0" in validator.faults[0].text


def test_another_hash_is_a_fault_once_and_the_run_goes_on():
    validator = asked_validator()
    strange = f"{CONTRACT_VERSION}+{'0' * 32}"
    assert validator.on_answer(answer(0, strange))[0].kind == "hold"
    validator.on_observation(question(1))
    assert validator.on_answer(answer(1, strange))[0].kind == "hold"
    assert len(validator.faults) == 1
    assert "expected hash" in validator.faults[0].text
