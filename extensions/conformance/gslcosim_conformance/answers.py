"""Answers of agents, judged one by one: a command, or the first rule that it breaks and the remedy."""

import json
import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgpack

from gslcosim.base.errors import ContractError
from gslcosim.contract import codec
from gslcosim.contract.length_prefix import LENGTH_BYTES, prefix_length
from gslcosim.contract.messages import AGENT_KINDS, Command
from gslcosim.contract.version import check_contract
from gslcosim.runtime.agents.validator import MAX_COMMAND_BYTES

_STDERR_REMEDY = "Only commands belong there; write notes to the standard error: print(text, file=sys.stderr)."
_MSGPACK_REMEDY = (
    "Pack the command with a msgpack library, msgpack.packb(command) in place of json.dumps(command); behind "
    "the gateway you may also start it with format: json (--format json here)."
)
_ONE_OBJECT_REMEDY = "Write one object, then a line feed, then flush: print(json.dumps(command), flush=True)."
_DUPLICATE_KEY_REMEDY = (
    "Write each key once: fill a map (a dict) and encode it when it is complete, in place of joining pieces of text."
)
_NESTING_REMEDY = "Leave out what nests so deep: no field of Command does."
_UTF_8_REMEDY = (
    "Write texts in UTF-8: text.encode('utf-8') in place of text.encode('latin-1'), or open the stream with "
    "encoding='utf-8'."
)
_BIN_REMEDY = "Pack bytes as bin and texts as str: msgpack.packb(command, use_bin_type=True)."
_BASE64_REMEDY = (
    "JSON has no bytes: write base64 text, base64.b64encode(data).decode() in place of str(data) or list(data)."
)
_LENGTH_REMEDY = "Write the length of each map before it: output.write(len(payload).to_bytes(4, 'big') + payload)."

# What the gateway says of what it refuses, the first that fits.
_REMEDIES_BY_TEXT = (
    ("byte order mark", "Leave the mark out: encoding='utf-8' in place of 'utf-8-sig'."),
    ("begin a msgpack map", _LENGTH_REMEDY),
    ("As little-endian it is", "Write the length big-endian: len(payload).to_bytes(4, 'big') in place of 'little'."),
    (
        "Is it JSON?",
        "Start it with format: json (--format json here), or write msgpack.packb(command) after its length.",
    ),
    ("expected the length of a frame", f"{_LENGTH_REMEDY} {_STDERR_REMEDY}"),
    ("as in format: msgpack", "Start it with format: msgpack (--format msgpack here), or write json.dumps(command)."),
    ("each key once", _DUPLICATE_KEY_REMEDY),
    ("deep, were deeper", _NESTING_REMEDY),
    ("expected base64 text", _BASE64_REMEDY),
    ("expected a line in UTF-8", _UTF_8_REMEDY),
    ("Extra data", _ONE_OBJECT_REMEDY),
    ("starting \"{'", "Write json.dumps(command) in place of str(command): JSON has double quotes."),
    ("starting '{", "Write the line with a JSON library: json.dumps(command)."),
    ("starting '[", 'Write an object {"tick": ..., "kind": ...}, not the list of its values.'),
    ("expected one JSON object a line", _STDERR_REMEDY),
    ("line feed after each object", _ONE_OBJECT_REMEDY),
)
MAX_SHOWN = 200
# No length [m], speed [m/s], duration [s] or probability of a search is beyond these, unless its bytes are swapped.
MIN_SANE, MAX_SANE = 1e-9, 1e6


def find_refusal_remedy(text: str) -> str:
    """Return what to change about a frame that the gateway refused with a text; empty where nothing more is known."""
    return next((remedy for words, remedy in _REMEDIES_BY_TEXT if words in text), "")


def find_bytes_remedy(payload: bytes, said: str) -> str:
    """Return what to change about bytes that are no msgpack map as a command needs one; empty where nothing is known.

    Args:
        said: What is wrong with it, as the reader says it.
    """
    if "each key once" in said or "deep, were deeper" in said:
        return find_refusal_remedy(said)
    if "as bytes (bin)" in said:
        return _BIN_REMEDY.replace("Pack bytes as bin and texts as str", "Keys are texts, 'tick' and not b'tick'")
    if (inner := payload[LENGTH_BYTES:]) and payload == prefix_length(inner):
        return "Send the map alone, without its length before it: publisher.put(msgpack.packb(command))."
    if payload.lstrip()[:1] == b"{":
        return _MSGPACK_REMEDY if _is_json(payload) else f"{_STDERR_REMEDY} {_MSGPACK_REMEDY}"
    if payload[:16].isascii() and payload[:16].decode(errors="replace").isprintable() and payload:
        return _STDERR_REMEDY
    if (raw := _unpack_raw(payload)) is None:
        return "Send whole maps, one a message or frame: msgpack.packb(command)."
    return _find_raw_remedy(raw)


def find_fields_remedy(fields: dict[str, Any]) -> str:
    """Return what to change about fields that a schema refuses, where it is how bytes were encoded; else empty."""
    for place, value in _iter_leaves(fields.get("belief")):
        if place.endswith("data") and isinstance(value, str):
            return f"belief{place} is text. {_BIN_REMEDY}"
        if place.endswith("data[0]"):
            return f"belief.probability.data is a list of numbers. In msgpack write bytes; in JSON: {_BASE64_REMEDY}"
    return ""


def format_start(payload: bytes) -> str:
    """Return the first bytes of something in hexadecimal, and as text where it is one."""
    shown = payload[:16].hex()
    is_text = payload[:16].isascii() and payload[:1].isascii() and payload[:16].decode(errors="replace").isprintable()
    return f"{shown} ({payload[:16].decode()!r} as text)" if payload and is_text else shown


# Read without a look at texts, so that the one that is no UTF-8 can be named.
def _find_raw_remedy(raw: object) -> str:
    if not isinstance(raw, dict):
        return "Pack a map {'tick': ..., 'kind': ...}, not the list of its values and not a text."
    for place, value in _iter_leaves(raw):
        if isinstance(value, bytes) and not _is_utf_8(value):
            name = place.lstrip(".")
            if name.endswith("data"):
                return f"{name} holds bytes, packed as text (str). {_BIN_REMEDY}"
            return f"{name} is {value.decode('latin-1')[:40]!r} in Latin-1. {_UTF_8_REMEDY}"
    return "Keys are texts: {'tick': ...}, and no numbers."


def _unpack_raw(payload: bytes) -> object:
    try:
        return msgpack.unpackb(payload, raw=True, strict_map_key=False)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return None


# Without recursion, as agents may nest as they like. The places are written `.belief.probability.data`.
def _iter_leaves(value: object) -> Iterator[tuple[str, object]]:
    waiting: list[tuple[str, object]] = [("", value)]
    while waiting:
        place, item = waiting.pop()
        if isinstance(item, dict):
            waiting += [(f"{place}.{_decode_key(key)}", inner) for key, inner in item.items()]
        elif isinstance(item, list):
            waiting += [(f"{place}[{i}]", inner) for i, inner in enumerate(item)]
        else:
            yield place, item


def _decode_key(key: object) -> str:
    return key.decode(errors="replace") if isinstance(key, bytes) else str(key)


def _is_utf_8(value: bytes) -> bool:
    try:
        value.decode()
    except UnicodeDecodeError:
        return False
    return True


def _is_json(payload: bytes) -> bool:
    try:
        return isinstance(json.loads(payload), dict)
    except (ValueError, RecursionError):
        return False


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Fault of something the agent sent; `remedy` says more than that of the rule, where more is known."""

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
        return f"Command {format_command(self.command)}"


def format_command(command: Command) -> str:
    """Return a command on one line, without its empty fields."""
    return _shorten(codec.dump_json_line(command.model_dump(exclude_defaults=True)).decode())


def read_answer(payload: bytes) -> Answer:
    """Return what an agent sent, as msgpack, judged by the rules that concern one command by itself."""
    if len(payload) > MAX_COMMAND_BYTES:
        expected = f"at most {MAX_COMMAND_BYTES} bytes"
        return Answer(problem=Problem(rule="size", expected=expected, got=f"{len(payload)} bytes"))
    try:
        fields = _unpack(payload)
    except ContractError as error:
        expected = "one msgpack map with texts as keys, each once"
        remedy = find_bytes_remedy(payload, str(error))
        problem = Problem(rule="encoding", expected=expected, got=str(error), remedy=remedy)
        return Answer(problem=problem, payload=payload)
    tick = fields.get("tick")
    read = Answer(tick=tick if type(tick) is int else None, payload=payload)
    problem = _find_contract_problem(fields) or _find_integer_problem(tick) or _find_finite_problem(fields)
    if problem is None:
        command, problem = _read_command(payload, fields)
        if command is not None:
            return Answer(tick=read.tick, command=command, problem=_find_byte_order_problem(fields), payload=payload)
    return Answer(tick=read.tick, problem=problem, payload=payload)


def build_refused_answer(text: str) -> Answer:
    """Return what the gateway could not even read, judged by its text."""
    is_size = "expected at most" in text or "expected a line of at most" in text
    expected = text.partition("expected ")[2].partition(", was")[0] or "one command"
    rule = "size" if is_size else "encoding"
    remedy = "" if is_size else find_refusal_remedy(text)
    return Answer(problem=Problem(rule=rule, expected=expected, got=_shorten(text), remedy=remedy))


def _unpack(payload: bytes) -> dict[str, Any]:
    try:
        return _decode_keys(codec.unpack_untrusted("Command", payload, has_lists=True))
    except ContractError as error:
        value = _get_value(payload)
        if value is not None and not isinstance(value, dict):
            raise ContractError(
                f"msgpack of a {type(value).__name__}, {_shorten(repr(value))}, not of a map"
            ) from error
        said = _shorten(str(error).removeprefix("Command: "))
        raise ContractError(said if value is not None else f"bytes starting {format_start(payload)}: {said}") from error


# Bytes as keys are no text: a run finds none of the keys that it looks for.
def _decode_keys(fields: dict[Any, Any]) -> dict[str, Any]:
    bytes_key = next((key for key in fields if isinstance(key, bytes)), None)
    if bytes_key is not None:
        raise ContractError(f"the key {bytes_key!r} as bytes (bin), not as text (str)")
    return fields


# What the bytes say, whatever else is wrong with them; None where they say nothing.
def _get_value(payload: bytes) -> object:
    try:
        return msgpack.unpackb(payload, raw=False, strict_map_key=False)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return None


def _find_contract_problem(fields: dict[str, Any]) -> Problem | None:
    contract = fields.get("contract")
    if not isinstance(contract, str):
        return None  # nothing, or of a wrong type, which the schema reports
    try:
        check_contract(contract)
    except ContractError as error:
        return Problem(rule="contract", expected="a contract that fits this gslcosim's, or none", got=str(error))
    return None


def _find_integer_problem(tick: object) -> Problem | None:
    if type(tick) is int or tick is None:
        return None
    return Problem(
        rule="integers", expected="tick as an integer", got=f"tick {_shorten(repr(tick))}, a {_name_kind(tick)}"
    )


def _find_finite_problem(fields: dict[str, Any]) -> Problem | None:
    for place, number in _iter_reals(fields):
        if not math.isfinite(number):
            return Problem(rule="finite", expected="a finite number", got=f"{place}: {number}")
    return None


def _read_command(payload: bytes, fields: dict[str, Any]) -> tuple[Command | None, Problem | None]:
    try:
        command = codec.decode_untrusted(Command, payload)
    except ContractError as error:
        got = str(error)
        is_raw = isinstance(fields.get("position_world_m"), bytes | dict)
        hint = " A position is a list of three numbers, not an array of bytes." if is_raw else ""
        return None, Problem(
            rule="schema", expected="a valid Command", got=got + hint, remedy=find_fields_remedy(fields)
        )
    if command.kind == "failed":
        expected = f"kind {', '.join(AGENT_KINDS[:-1])} or {AGENT_KINDS[-1]}"
        return None, Problem(rule="schema", expected=expected, got="kind 'failed', which only the runtime writes")
    if codec.decode(Command, codec.encode(command)) != command:
        got = f"{format_command(command)}, which does not"
        return None, Problem(rule="schema", expected="a command that survives being written and read again", got=got)
    return command, None


# Only where every number of the command is beyond reason and none is with its bytes turned around: a tiny number alone
# may well be the sine of a half turn.
def _find_byte_order_problem(fields: dict[str, Any]) -> Problem | None:
    numbers = [(place, number) for place, number in _iter_reals(fields) if number != 0.0]
    if not numbers or any(_is_sane(number) or not _is_sane(_swap_byte_order(number)) for _, number in numbers):
        return None
    place, number = numbers[0]
    got = f"{place}: {number!r}; with its bytes turned around it is {_swap_byte_order(number)!r}"
    return Problem(rule="byte-order", expected="numbers of a size that a search can have", got=got)


# Without recursion: what an agent nests is not limited by what Python can call.
def _iter_reals(fields: dict[str, Any]) -> Iterator[tuple[str, float]]:
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
    return math.isfinite(number) and MIN_SANE <= abs(number) <= MAX_SANE


def _swap_byte_order(number: float) -> float:
    return struct.unpack("<d", struct.pack(">d", number))[0]


def _name_kind(value: object) -> str:
    return {"float": "real number", "str": "text", "bool": "truth value"}.get(
        type(value).__name__, type(value).__name__
    )


def _shorten(text: str) -> str:
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."
