"""Reading one thing that an agent sent: a command, or the first rule that it breaks."""

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgpack

from gslcosim.conformance.diagnosis import remedy_of_bytes, remedy_of_fields, remedy_of_refusal, start_of
from gslcosim.contract import codec
from gslcosim.contract.commands import AGENT_KINDS
from gslcosim.contract.compatibility import check_contract
from gslcosim.contract.messages import Command
from gslcosim.errors import ContractError
from gslcosim.runtime.agents.door import MAX_COMMAND_BYTES

MAX_SHOWN = 200
# No length [m], speed [m/s], duration [s] or probability of a search is beyond these, unless its bytes are swapped.
SANE_MIN, SANE_MAX = 1e-9, 1e6


@dataclass(frozen=True, kw_only=True)
class Problem:
    """What is wrong with something the agent sent; `remedy` says more than that of the rule, where more is known."""

    rule: str
    expected: str
    got: str
    remedy: str = ""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """One thing the agent sent: its tick where that can be read, and either the command or what is wrong with it."""

    tick: int | None = None
    command: Command | None = None
    problem: Problem | None = None
    payload: bytes = b""

    @property
    def shown(self) -> str:
        """The answer in words."""
        if self.command is None:
            return self.problem.got if self.problem else "nothing"
        return f"Command {shown_command(self.command)}"


def shown_command(command: Command) -> str:
    """Return a command on one line, without its empty fields."""
    return _cut(codec.json_line(command.model_dump(exclude_defaults=True)).decode())


def read_answer(payload: bytes) -> Answer:
    """Return what an agent sent, as msgpack, judged by the rules that concern one command by itself."""
    if len(payload) > MAX_COMMAND_BYTES:
        expected = f"at most {MAX_COMMAND_BYTES} bytes"
        return Answer(problem=Problem(rule="size", expected=expected, got=f"{len(payload)} bytes"))
    try:
        fields = _unpacked(payload)
    except ContractError as error:
        expected = "one msgpack map with texts as keys, each once"
        remedy = remedy_of_bytes(payload, str(error))
        problem = Problem(rule="encoding", expected=expected, got=str(error), remedy=remedy)
        return Answer(problem=problem, payload=payload)
    tick = fields.get("tick")
    read = Answer(tick=tick if type(tick) is int else None, payload=payload)
    problem = _contract_problem(fields) or _integer_problem(tick) or _finite_problem(fields)
    if problem is None:
        command, problem = _command(payload, fields)
        if command is not None:
            return Answer(tick=read.tick, command=command, problem=_byte_order_problem(fields), payload=payload)
    return Answer(tick=read.tick, problem=problem, payload=payload)


def refused_answer(text: str) -> Answer:
    """Return what the gateway could not even read, judged by its text."""
    is_size = "expected at most" in text or "expected a line of at most" in text
    expected = text.partition("expected ")[2].partition(", was")[0] or "one command"
    rule = "size" if is_size else "encoding"
    remedy = "" if is_size else remedy_of_refusal(text)
    return Answer(problem=Problem(rule=rule, expected=expected, got=_cut(text), remedy=remedy))


def _unpacked(payload: bytes) -> dict[str, Any]:
    try:
        return _with_text_keys(codec.unpack_foreign("Command", payload, has_lists=True))
    except ContractError as error:
        value = _value(payload)
        if value is not None and not isinstance(value, dict):
            raise ContractError(f"msgpack of a {type(value).__name__}, {_cut(repr(value))}, not of a map") from error
        said = _cut(str(error).removeprefix("Command: "))
        raise ContractError(said if value is not None else f"bytes starting {start_of(payload)}: {said}") from error


# Bytes as keys are no text: a run finds none of the keys that it looks for.
def _with_text_keys(fields: dict[Any, Any]) -> dict[str, Any]:
    bytes_key = next((key for key in fields if isinstance(key, bytes)), None)
    if bytes_key is not None:
        raise ContractError(f"the key {bytes_key!r} as bytes (bin), not as text (str)")
    return fields


# What the bytes say, whatever else is wrong with them; None where they say nothing.
def _value(payload: bytes) -> object:
    try:
        return msgpack.unpackb(payload, raw=False, strict_map_key=False)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return None


def _contract_problem(fields: dict[str, Any]) -> Problem | None:
    told = fields.get("contract")
    if not isinstance(told, str):
        return None  # nothing, or of a wrong type, which the schema tells
    try:
        check_contract(told)
    except ContractError as error:
        return Problem(rule="contract", expected="a contract that fits this gslcosim's, or none", got=str(error))
    return None


def _integer_problem(tick: object) -> Problem | None:
    if type(tick) is int or tick is None:
        return None
    return Problem(rule="integers", expected="tick as an integer", got=f"tick {_cut(repr(tick))}, a {_kind(tick)}")


def _finite_problem(fields: dict[str, Any]) -> Problem | None:
    for place, number in _reals(fields):
        if not math.isfinite(number):
            return Problem(rule="finite", expected="a finite number", got=f"{place}: {number}")
    return None


def _command(payload: bytes, fields: dict[str, Any]) -> tuple[Command | None, Problem | None]:
    try:
        command = codec.decode_foreign(Command, payload)
    except ContractError as error:
        got = str(error)
        is_raw = isinstance(fields.get("position_world_m"), bytes | dict)
        hint = " A position is a list of three numbers, not an array of bytes." if is_raw else ""
        return None, Problem(rule="schema", expected="a valid Command", got=got + hint, remedy=remedy_of_fields(fields))
    if command.kind == "failed":
        expected = f"kind {', '.join(AGENT_KINDS[:-1])} or {AGENT_KINDS[-1]}"
        return None, Problem(rule="schema", expected=expected, got="kind 'failed', which only the runtime writes")
    if codec.decode(Command, codec.encode(command)) != command:
        got = f"{shown_command(command)}, which does not"
        return None, Problem(rule="schema", expected="a command that survives being written and read again", got=got)
    return command, None


# Only where every number of the command is beyond reason and none is with its bytes turned around: a tiny number alone
# may well be the sine of a half turn.
def _byte_order_problem(fields: dict[str, Any]) -> Problem | None:
    numbers = [(place, number) for place, number in _reals(fields) if number != 0.0]
    if not numbers or any(_is_sane(number) or not _is_sane(_turned(number)) for _, number in numbers):
        return None
    place, number = numbers[0]
    got = f"{place}: {number!r}; with its bytes turned around it is {_turned(number)!r}"
    return Problem(rule="byte-order", expected="numbers of a size that a search can have", got=got)


# Without recursion: what an agent nests is not limited by what Python can call.
def _reals(fields: dict[str, Any]) -> Iterator[tuple[str, float]]:
    waiting: list[tuple[str, object]] = [("", fields)]
    while waiting:
        place, value = waiting.pop()
        inside: list[tuple[str, object]] = []
        if isinstance(value, float):
            yield place, value
        elif isinstance(value, dict):
            inside = [(f"{place}.{key}" if place else str(key), item) for key, item in value.items()]
        elif isinstance(value, list):
            inside = [(f"{place}.{i}", item) for i, item in enumerate(value)]
        waiting += reversed(inside)


def _is_sane(number: float) -> bool:
    return math.isfinite(number) and SANE_MIN <= abs(number) <= SANE_MAX


def _turned(number: float) -> float:
    return struct.unpack("<d", struct.pack(">d", number))[0]


def _kind(value: object) -> str:
    return {"float": "real number", "str": "text", "bool": "truth value"}.get(
        type(value).__name__, type(value).__name__
    )


def _cut(text: str) -> str:
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."
