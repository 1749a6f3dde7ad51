"""Golden vectors: bytes and texts that every reader of the contract accepts, and those it must reject, with the reason.

A vectors file has for one message:
`accept`: `fields` is what the message says, with every key; `msgpack` (hexadecimal) and `json` are ways to write it.
Where `canonical` is true they are exactly what gslcosim writes; otherwise another sender's right to write differently.
`reject`: `msgpack` and `json` as above, a `reason`, and whether the JSON Schema already finds it (`schema_refuses`).
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import msgpack  # pyright: ignore[reportMissingTypeStubs]
from contract_examples import EXAMPLES

from gslcosim.contract.version import CONTRACT_VERSION
from gslcosim.contract import codec
from gslcosim.contract.messages import Command, Message
from gslcosim.contract.participant_messages import PARTICIPATION_VERSION, ParticipantHello, ParticipantOutputs
from gslcosim_conformance.message_schemas import list_message_types

# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack
_Fields = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class AcceptedVector:
    """A message as somebody may write it; see this module's docstring."""

    name: str
    canonical: bool
    fields: _Fields
    msgpack: str | None = None
    json: str | None = None


@dataclass(frozen=True, kw_only=True)
class RejectedVector:
    """Bytes or text that are no message of this type; `json` with bytes that are no UTF-8 is given as `json_hex`."""

    name: str
    reason: str
    schema_refuses: bool
    msgpack: str | None = None
    json: str | None = None
    json_hex: str | None = None


def build_vectors(message_type: type[Message]) -> dict[str, Any]:
    """Return the content of a message's vectors file."""
    accepted, rejected = list(build_accepted(message_type)), list(build_rejected(message_type))
    return {
        "message": message_type.__name__,
        "contract": CONTRACT_VERSION if message_type in list_message_types() else PARTICIPATION_VERSION,
        "accept": [_drop_absent(case) for case in accepted],
        "reject": [_drop_absent(case) for case in rejected],
    }


def build_accepted(message_type: type[Message]) -> Iterator[AcceptedVector]:
    """Yield the examples of a message as gslcosim writes them, then the first of them as others may write it."""
    examples = {name: message for name, message in EXAMPLES.items() if type(message) is message_type}
    for name, message in examples.items():
        yield _build_accepted_case(name, message.model_dump(), message, canonical=True)
    message = next(iter(examples.values()))
    for name, change in _ALTERNATIVE_ENCODINGS.items():
        yield _build_accepted_case(name, change(message), message, canonical=False)
    wide = _pack_wide(message.model_dump())
    fields = _as_json(message.model_dump())
    yield AcceptedVector(name="wide_headers", canonical=False, fields=fields, msgpack=wide.hex())
    yield AcceptedVector(name="indented", canonical=False, fields=fields, json=json.dumps(fields, indent=1))


def build_rejected(message_type: type[Message]) -> Iterator[RejectedVector]:
    """Yield what a reader of this message must reject."""
    example = next(message for message in EXAMPLES.values() if type(message) is message_type)
    for fault in (*_COMMON_FAULTS, *_FAULTS_BY_MESSAGE.get(message_type.__name__, ())):
        yield _apply_fault(fault, {**example.model_dump(), **fault.change})
    whole = codec.encode(example)
    yield RejectedVector(
        name="cut_off",
        reason="ends before the message does",
        schema_refuses=True,
        msgpack=whole[:-1].hex(),
        json=codec.encode_json(example).decode()[:-1],
    )
    yield RejectedVector(
        name="more_behind",
        reason="something follows the message",
        schema_refuses=True,
        msgpack=(whole + b"\xc0").hex(),
        json=codec.encode_json(example).decode() + "{}",
    )
    yield from _build_untrusted_rejections(example)
    yield RejectedVector(name="no_map", reason="an array, not a map", schema_refuses=True, msgpack="9107", json="[7]")
    yield RejectedVector(name="nothing", reason="no bytes at all", schema_refuses=True, msgpack="", json="")
    yield RejectedVector(name="number_as_key", reason="keys are text", schema_refuses=True, msgpack="810707")
    yield RejectedVector(
        name="never_used_byte", reason="c1 begins nothing in msgpack", schema_refuses=True, msgpack="c1"
    )
    yield RejectedVector(
        name="not_utf_8", reason="text is UTF-8", schema_refuses=True, msgpack="81a1ff07", json_hex="22ff22"
    )


# Only what agents write is looked at so closely: see `codec.unpack_untrusted`.
def _build_untrusted_rejections(example: Message) -> Iterator[RejectedVector]:
    if not isinstance(example, Command | ParticipantHello | ParticipantOutputs):
        return
    fields = example.model_dump()
    twice: bytes = _msgpack.Packer(use_bin_type=True).pack_map_pairs([("tick", 8), *fields.items()])
    yield RejectedVector(
        name="key_twice",
        reason="a key is there once",
        schema_refuses=False,
        msgpack=twice.hex(),
        json='{"tick":8,' + codec.encode_json(example).decode()[1:],
    )
    nested: list[Any] = []
    for _ in range(codec.MAX_NESTING - 1):
        nested = [nested]
    reason = f"lists and maps are at most {codec.MAX_NESTING} deep"
    fault = _Fault(name="too_deep", reason=reason, change={"later": nested}, schema_refuses=False)
    yield _apply_fault(fault, {**fields, **fault.change})


# ---------------------------------------------------------------- other ways to write the same


def _build_accepted_case(name: str, written: _Fields, message: Message, *, canonical: bool) -> AcceptedVector:
    return AcceptedVector(
        name=name,
        canonical=canonical,
        fields=_as_json(message.model_dump()),
        msgpack=_msgpack.packb(written, use_bin_type=True).hex(),
        json=codec.dump_json_line(written).decode(),
    )


_ALTERNATIVE_ENCODINGS: dict[str, Callable[[Message], _Fields]] = {
    "unknown_keys": lambda message: {**message.model_dump(), "a_later_key": {"n": [1, None, "x"]}, "message": "any"},
    "defaults_left_out": lambda message: message.model_dump(exclude_defaults=True),
    "keys_in_other_order": lambda message: dict(reversed(message.model_dump().items())),
    "whole_numbers_for_reals": lambda message: _with_integers(message.model_dump()),
}


# Languages with one kind of number write 12.0 as 12.
def _with_integers(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _with_integers(item) for name, item in value.items()}  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, list | tuple):
        return [_with_integers(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    return value


# Some libraries always write the longest headers; that is msgpack too.
def _pack_wide(value: Any) -> bytes:
    if isinstance(value, dict):
        pairs = [_pack_wide(key) + _pack_wide(item) for key, item in value.items()]  # pyright: ignore
        return b"\xdf" + _pack_length(pairs) + b"".join(pairs)
    if isinstance(value, list | tuple):
        return b"\xdd" + _pack_length(value) + b"".join(map(_pack_wide, value))  # pyright: ignore[reportUnknownArgumentType]
    if isinstance(value, str):
        return b"\xdb" + _pack_length(value.encode()) + value.encode()
    if isinstance(value, bytes):
        return b"\xc6" + _pack_length(value) + value
    if type(value) is int:
        return b"\xcf" + value.to_bytes(8, "big") if value >= 0 else b"\xd3" + value.to_bytes(8, "big", signed=True)
    return _msgpack.packb(value)


def _pack_length(value: Any) -> bytes:
    return len(value).to_bytes(4, "big")


# ---------------------------------------------------------------- what is wrong


@dataclass(frozen=True, kw_only=True)
class _Fault:
    name: str
    reason: str
    change: _Fields
    schema_refuses: bool = True


_NAN, _INFINITY = float("nan"), float("inf")
_DROP = object()
_POINT = [1.0, 2.0, 3.0]
_COMMON_FAULTS = (
    _Fault(name="no_tick", reason="tick is missing", change={"tick": _DROP}),
    _Fault(name="tick_is_text", reason="tick is a whole number, nothing is converted", change={"tick": "7"}),
    _Fault(name="tick_is_nil", reason="tick is a whole number", change={"tick": None}),
    _Fault(name="tick_is_bool", reason="tick is a whole number", change={"tick": True}),
    _Fault(name="tick_is_real", reason="3.0 is no tick; 3 is", change={"tick": 3.0}, schema_refuses=False),
    _Fault(name="tick_below_0", reason="ticks begin at 0", change={"tick": -1}),
    _Fault(name="tick_above_2_53", reason="ticks end at 2^53", change={"tick": 2**53 + 1}),
)
_WAYPOINT = {"tick": 7, "kind": "waypoint"}


def _belief(dtype: str, shape: list[int], data_hex: str) -> _Fields:
    probability = {"dtype": dtype, "shape": shape, "data": bytes.fromhex(data_hex)}
    return {"origin_m": _POINT, "cell_m": 0.5, "probability": probability}


_FAULTS_BY_MESSAGE = {
    "WindShare": (
        _Fault(name="no_share", reason="share is missing", change={"share": _DROP}),
        _Fault(name="share_below_0", reason="air does not flow backwards", change={"share": -0.5}),
        _Fault(name="share_is_nan", reason="numbers are finite", change={"share": _NAN}, schema_refuses=False),
    ),
    "SourceRate": (
        _Fault(name="no_rate", reason="filaments_per_s is missing", change={"filaments_per_s": _DROP}),
        _Fault(name="rate_below_0", reason="a source takes nothing back", change={"filaments_per_s": -0.5}),
        _Fault(
            name="rate_is_nan",
            reason="numbers are finite",
            change={"filaments_per_s": _NAN},
            schema_refuses=False,
        ),
    ),
    "ProbeSamples": (
        _Fault(name="no_samples", reason="samples is missing", change={"samples": _DROP}),
        _Fault(name="samples_is_map", reason="samples is a list", change={"samples": {}}),
        _Fault(
            name="sample_without_wind",
            reason="wind_world_m_s is missing",
            change={"samples": [{"probe": "return_air", "gases": []}]},
        ),
    ),
    "ParticipantHello": (
        _Fault(name="no_writes", reason="writes is missing", change={"writes": _DROP}),
        _Fault(name="reads_is_text", reason="reads is a list", change={"reads": "truth/samples"}),
        _Fault(name="port_is_nothing", reason="a port has a name", change={"reads": [""]}),
    ),
    "ParticipantOutputs": (
        _Fault(name="no_outputs", reason="outputs is missing", change={"outputs": _DROP}),
        _Fault(name="outputs_is_list", reason="outputs is a map", change={"outputs": [1.0]}),
        _Fault(name="output_is_number", reason="each output is a map", change={"outputs": {"state": 1.0}}),
    ),
    "ParticipantInputs": (_Fault(name="no_inputs", reason="inputs is missing", change={"inputs": _DROP}),),
    "ParticipantValues": (
        _Fault(name="value_is_text", reason="values are numbers", change={"values": {"on": "yes"}}),
        _Fault(
            name="name_in_capitals",
            reason="names are lower-case",
            change={"values": {"ON": True}},
            schema_refuses=False,
        ),
        _Fault(name="value_is_nan", reason="numbers are finite", change={"values": {"a": _NAN}}, schema_refuses=False),
    ),
    "Command": (
        _Fault(name="no_kind", reason="kind is missing", change={"kind": _DROP}),
        _Fault(name="unknown_kind", reason="there is no such kind", change={"kind": "teleport"}),
        _Fault(name="kind_in_capitals", reason="text is compared as it is", change={"kind": "HOLD"}),
        _Fault(
            name="waypoint_without_position",
            reason="a waypoint needs position_world_m",
            change={**_WAYPOINT, "position_world_m": None},
        ),
        _Fault(
            name="velocity_without_velocity",
            reason="a velocity command needs velocity_world_m_s",
            change={"kind": "velocity", "velocity_world_m_s": None},
        ),
        _Fault(
            name="declaration_without_declaration",
            reason="declare_source needs declaration",
            change={"kind": "declare_source", "declaration": None},
        ),
        _Fault(
            name="mission_without_waypoints",
            reason="a mission needs waypoints",
            change={"kind": "mission", "waypoints": None},
        ),
        _Fault(name="mission_of_nothing", reason="a mission has a waypoint", change={"waypoints": []}),
        _Fault(
            name="attitude_without_attitude",
            reason="an attitude command needs attitude",
            change={"kind": "attitude", "attitude": None},
        ),
        _Fault(name="rates_without_rates", reason="a rates command needs rates", change={"kind": "rates"}),
        _Fault(name="drive_without_drive", reason="a drive command needs drive", change={"kind": "drive"}),
        _Fault(
            name="thrust_below_0",
            reason="rotors push upwards only",
            change={"attitude": {"roll_rad": 0.0, "thrust_n": -1.0}},
        ),
        _Fault(
            name="rate_beyond_50",
            reason="rates are at most 50 rad/s",
            change={"rates": {"rates_body_rad_s": [0.0, 51.0, 0.0]}},
        ),
        _Fault(
            name="roll_is_nan",
            reason="numbers are finite",
            change={"attitude": {"roll_rad": _NAN}},
            schema_refuses=False,
        ),
        _Fault(
            name="position_with_two_numbers",
            reason="a position has x, y and z",
            change={**_WAYPOINT, "position_world_m": [1.0, 2.0]},
        ),
        _Fault(
            name="position_with_four_numbers",
            reason="a position has x, y and z",
            change={**_WAYPOINT, "position_world_m": [*_POINT, 4.0]},
        ),
        _Fault(
            name="position_as_map",
            reason="a position is a list",
            change={**_WAYPOINT, "position_world_m": {"x": 1.0, "y": 2.0, "z": 3.0}},
        ),
        _Fault(
            name="position_as_text",
            reason="numbers are not text",
            change={**_WAYPOINT, "position_world_m": ["1.0", "2.0", "3.0"]},
        ),
        _Fault(
            name="position_with_nan",
            reason="numbers are finite",
            change={**_WAYPOINT, "position_world_m": [_NAN, 2.0, 3.0]},
            schema_refuses=False,
        ),
        _Fault(
            name="position_with_infinity",
            reason="numbers are finite",
            change={**_WAYPOINT, "position_world_m": [_INFINITY, 2.0, 3.0]},
            schema_refuses=False,
        ),
        _Fault(name="hold_below_0", reason="hold_s is at least 0", change={"hold_s": -0.5}),
        _Fault(name="hold_above_an_hour", reason="hold_s is at most 3600", change={"hold_s": 3600.5}),
        _Fault(name="hold_is_bool", reason="true is no number", change={"hold_s": True}),
        _Fault(
            name="confidence_above_1",
            reason="confidence is at most 1",
            change={"declaration": {"position_world_m": _POINT, "confidence": 1.5}},
        ),
        _Fault(
            name="belief_with_another_sum",
            reason="the probabilities of a belief are together 1",
            change={"belief": _belief("float32", [2, 1], "0000003f0000803e")},
            schema_refuses=False,
        ),
        _Fault(
            name="belief_below_0",
            reason="no probability is negative",
            change={"belief": _belief("float32", [2, 1], "0000c03f000000bf")},
            schema_refuses=False,
        ),
        _Fault(
            name="belief_in_float64",
            reason="a belief is float32",
            change={"belief": _belief("float64", [1, 1], "000000000000f03f")},
            schema_refuses=False,
        ),
        _Fault(
            name="belief_with_one_axis",
            reason="a belief has 2 or 3 axes",
            change={"belief": _belief("float32", [1], "0000803f")},
            schema_refuses=False,
        ),
        _Fault(
            name="belief_without_cells",
            reason="a belief has at least one cell",
            change={"belief": _belief("float32", [0, 3], "")},
            schema_refuses=False,
        ),
        _Fault(
            name="belief_in_cells_of_0",
            reason="cells have a size",
            change={"belief": {**_belief("float32", [1, 1], "0000803f"), "cell_m": 0.0}},
        ),
        _Fault(
            name="note_with_17_values",
            reason="a note has at most 16 values",
            change={"note": {"values": {f"value_{i}": 1.0 for i in range(17)}}},
        ),
        _Fault(
            name="note_with_a_long_mode",
            reason="the mode of a note has at most 40 characters",
            change={"note": {"mode": "x" * 41}},
        ),
        _Fault(name="reason_too_long", reason="reason has at most 500 characters", change={"reason": "x" * 501}),
        _Fault(name="reason_is_nil", reason="reason is text; leave it out instead", change={"reason": None}),
    ),
    "Observation": (
        _Fault(name="agent_in_capitals", reason="names are a-z, 0-9 and _", change={"agent": "Beetle"}),
        _Fault(name="no_readings", reason="without sensors it is empty", change={"readings": _DROP}),
        _Fault(name="awaiting_is_a_number", reason="1 is not true", change={"awaiting_command": 1}),
        _Fault(name="yaw_is_nan", reason="numbers are finite", change={"yaw_rad": _NAN}, schema_refuses=False),
    ),
    "Briefing": (
        _Fault(name="unknown_mode", reason="there is no such mode", change={"mode": "real_time"}),
        _Fault(
            name="parameter_in_capitals",
            reason="names are a-z, 0-9 and _",
            change={"parameters": {"Step": 1.0}},
            schema_refuses=False,
        ),
        _Fault(name="parameter_is_a_map", reason="a scalar or a list", change={"parameters": {"step_m": {"a": 1}}}),
        _Fault(name="parameter_is_nil", reason="a scalar or a list", change={"parameters": {"step_m": None}}),
        _Fault(
            name="map_in_cells_of_0",
            reason="cells have a size",
            change={
                "known_map": {
                    "origin_m": _POINT,
                    "cell_m": 0.0,
                    "occupied": {"dtype": "uint8", "shape": [1, 1], "data": bytes(1)},
                }
            },
        ),
        _Fault(name="no_seed", reason="seed is missing", change={"seed": _DROP}),
    ),
    "Ending": (_Fault(name="no_reason", reason="reason is missing", change={"reason": _DROP}),),
    "FilamentCloud": (
        _Fault(
            name="array_too_short",
            reason="two float32 are 8 bytes",
            change={"sigma_m": {"dtype": "float32", "shape": [2], "data": bytes(7)}},
            schema_refuses=False,
        ),
        _Fault(
            name="array_with_nan",
            reason="numbers are finite, in arrays too",
            change={"sigma_m": {"dtype": "float32", "shape": [1], "data": bytes.fromhex("0000c07f")}},
            schema_refuses=False,
        ),
        _Fault(
            name="array_of_unknown_dtype",
            reason="there is no such dtype",
            change={"sigma_m": {"dtype": ">f4", "shape": [1], "data": bytes(4)}},
        ),
    ),
}


def _apply_fault(fault: _Fault, fields: _Fields) -> RejectedVector:
    written = {name: value for name, value in fields.items() if value is not _DROP}
    # NaN is no JSON; but some languages write it, and a reader must not let it in.
    text = json.dumps(_as_json(written), ensure_ascii=False, separators=(",", ":"))
    return RejectedVector(
        name=fault.name,
        reason=fault.reason,
        schema_refuses=fault.schema_refuses,
        msgpack=_msgpack.packb(written, use_bin_type=True).hex(),
        json=text,
    )


# As in JSON: bytes are base64 text, tuples are lists.
def _as_json(fields: _Fields) -> _Fields:
    text = json.dumps(fields, default=codec.encode_base64)
    return json.loads(text)


def _drop_absent(case: AcceptedVector | RejectedVector) -> dict[str, Any]:
    return {name: value for name, value in asdict(case).items() if value is not None}
