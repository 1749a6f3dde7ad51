"""Whether what a participant's program says is what it may say: pure functions that name what was expected."""

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from gslcosim.contract import codec
from gslcosim.contract.compatibility import check_version
from gslcosim.contract.messages import Message
from gslcosim.contract.participation import (
    MAX_VALUES,
    PARTICIPATION_VERSION,
    VENTILATION,
    ParticipantHello,
    ParticipantOutputs,
    ParticipantValues,
)
from gslcosim.contract.ventilation import WindShare
from gslcosim.errors import ContractError
from gslcosim.gateway.framing import MAX_FRAME_BYTES

_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
_MOST_SHOWN = 60


def read_hello(payload: bytes) -> ParticipantHello:
    """Return a program's hello.

    Raises:
        ContractError: it is none, or was made for another contract.
    """
    hello = codec.decode_foreign(ParticipantHello, payload, max_bytes=MAX_FRAME_BYTES)
    if hello.contract is not None:
        check_version(hello.contract, PARTICIPATION_VERSION)
    return hello


def check_hello(hello: ParticipantHello, *, reads: Iterable[str], writes: Iterable[str]) -> None:
    """Check that a program was made for the ports that its scenario declares.

    Args:
        hello: What it says.
        reads: The ports that it gets.
        writes: The words of its outputs.

    Raises:
        ContractError: it was made for others.
    """
    for key, told, declared in (("reads", hello.reads, tuple(reads)), ("writes", hello.writes, tuple(writes))):
        if {*told} != {*declared}:
            raise ContractError(
                f"ParticipantHello: {key}: expected what the scenario declares, {_listed(declared)}, was "
                f"{_listed(told)}. Correct the scenario or the program."
            )


def read_outputs(payload: bytes, tick: int, words: Iterable[str]) -> Mapping[str, Message]:
    """Return the messages in a program's answer by the words of its outputs.

    Args:
        payload: What it said.
        tick: The tick of the inputs that it answers.
        words: What it declares to write.

    Raises:
        ContractError: it is no answer to them.
    """
    answer = codec.decode_foreign(ParticipantOutputs, payload, max_bytes=MAX_FRAME_BYTES)
    if answer.tick != tick:
        raise ContractError(f"ParticipantOutputs: tick: expected {tick}, that of the inputs, was {answer.tick}.")
    declared = tuple(words)
    if answer.outputs.keys() != {*declared}:
        raise ContractError(
            f"ParticipantOutputs: outputs: expected {_listed(declared)}, as it declares, was {_listed(answer.outputs)}."
        )
    return {word: _message(word, tick, answer.outputs[word]) for word in declared}


def is_name(word: str) -> bool:
    """Return whether a word can be the name of an output or of a value in it."""
    return _NAME.fullmatch(word) is not None


def _message(word: str, tick: int, fields: dict[str, Any]) -> Message:
    if word == VENTILATION:
        try:
            return codec.from_fields(WindShare, {**fields, "tick": tick})
        except ContractError as error:
            raise ContractError(f"ParticipantOutputs: outputs.{word}: {error}") from error
    if len(fields) > MAX_VALUES:
        raise ContractError(
            f"ParticipantOutputs: outputs.{word}: expected at most {MAX_VALUES} values, was {len(fields)}."
        )
    for name, value in fields.items():
        place = f"ParticipantOutputs: outputs.{word}"
        if not is_name(name):
            expected = "names of at most 40 lower-case letters, digits and _"
            raise ContractError(f"{place}: expected {expected}, was {_shown(name)}.")
        if not isinstance(value, bool | int | float) or not math.isfinite(value):
            raise ContractError(f"{place}.{name}: expected a number or a truth value, was {_shown(value)}.")
    values = {name: value if isinstance(value, bool) else float(value) for name, value in fields.items()}
    return ParticipantValues(tick=tick, values=values)


def _listed(words: Iterable[str]) -> str:
    found = sorted(words)
    text = ", ".join(found[:8]) + (" …" if len(found) > 8 else "")
    return text or "nothing"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _MOST_SHOWN else f"{text[: _MOST_SHOWN - 3]}..."
