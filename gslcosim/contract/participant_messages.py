"""Messages between a run and a user's own model, through the gateway: a contract beside that of agents.

It has a version of its own: agents take no part in it, and their briefing does not change with it.
"""

import re
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import msgspec
from pydantic import Field, StringConstraints

from gslcosim.contract.environment_messages import WIND, SourceRate, WindShare, build_source_port
from gslcosim.contract.messages import Bounds, ParameterValue
from gslcosim.contract.record import Message, Name, Record

PARTICIPATION_VERSION = "1.1"
VENTILATION = "ventilation"
"""The word for the output that changes the wind of the room, a `WindShare`."""

_SOURCE_WORD = re.compile(r"source_(0|[1-9][0-9]{0,8})")

MAX_PORTS = 64
MAX_VALUES = 256
_Port = Annotated[str, StringConstraints(min_length=1, max_length=200)]
_Ports = Annotated[tuple[_Port, ...], Field(max_length=MAX_PORTS)]


def build_own_port(participant: str, word: str) -> str:
    """Return the port of a participant's own output, by its word in `writes`."""
    return f"participant/{participant}/{word}"


class RoomOutput(NamedTuple):
    """Output of a participant that changes the room: it holds until the next, and is there every tick.

    `value` is the name of the only value in its message.
    """

    port: str
    message_type: type[Message]
    value: str


def find_room_output(word: str) -> RoomOutput | None:
    """Return the output that changes the room under a word of `writes`; None for a port of the participant's own.

    `ventilation` is the wind, and `source_0` the rate of the first source in `gas.sources`.
    """
    if word == VENTILATION:
        return RoomOutput(WIND, WindShare, "share")
    i_source = find_driven_source(word)
    return None if i_source is None else RoomOutput(build_source_port(i_source), SourceRate, "filaments_per_s")


def find_driven_source(word: str) -> int | None:
    """Return the index in `gas.sources` of the source whose rate a word of `writes` sets, or None."""
    found = _SOURCE_WORD.fullmatch(word)
    return int(found[1]) if found else None


class ParticipantHello(Message):
    """The first frame of a participant's program: the ports it was made for. `tick` is 0.

    `reads` are the ports that it reads and `writes` the words of its outputs, in any order: exactly those that the
    scenario declares. `contract` may name the version of this contract that it was made for, such as `1.0`.
    """

    reads: _Ports
    writes: _Ports
    contract: Annotated[str, StringConstraints(max_length=80)] | None = None


class PortRead(Record):
    """A port that the participant reads: a `message` of that type, from `delay_ticks` before."""

    port: str
    delay_ticks: int
    message: str


class PortWrite(Record):
    """An output of the participant: its `word` in the answer, its `port`, and the type of its `message`."""

    word: str
    port: str
    message: str


class VehicleOfRun(Record):
    """An agent of the run and the names of its vehicle's sensors, as `BodyPoses` and `FieldSamples` have them."""

    agent: Name
    sensors: tuple[Name, ...]


class ParticipantBriefing(Message):
    """Ports, scenario and settings that a participant gets in answer to its hello. `tick` is 0.

    It steps at tick 0 and every `period_ticks` after it. `seed` is its own, for all its random draws; `bounds` is the
    room. `reads` and `writes` are the ports as the run resolved them, `parameters` its settings in the scenario.
    `contract_version` is that of this contract.
    """

    participant: Name
    contract_version: str
    scenario: Name
    tick_ns: int
    period_ticks: int
    seed: int
    time_limit_s: float
    bounds: Bounds
    gases: tuple[str, ...]
    vehicles: tuple[VehicleOfRun, ...]
    reads: tuple[PortRead, ...]
    writes: tuple[PortWrite, ...]
    parameters: dict[Name, ParameterValue] = {}  # noqa: RUF012 - msgspec copies it


class ParticipantInputs(Message):
    """All inputs of one step of a participant, in one frame. `time_s` is the simulated time of its tick.

    `inputs` maps each port to the message of `tick - delay_ticks`, with all its fields; a port is missing where there
    is no such message: before tick 0, and between the periods of its writer. Exactly one `ParticipantOutputs` with this
    tick is expected in return, and simulated time waits for it.
    """

    time_s: float
    inputs: dict[str, dict[str, Any]]


class ParticipantOutputs(Message):
    """A participant's answer to the inputs of the same `tick`: one map for each word of its `writes`, and no other.

    Under `ventilation` are the fields of a `WindShare`, under `source_0`, `source_1` and so on (since 1.1) those of a
    `SourceRate`, and under any other word numbers and booleans by name. `tick` is not repeated in them.
    """

    outputs: Annotated[dict[str, dict[str, Any]], Field(max_length=MAX_PORTS)]


class ParticipantValues(Message):
    """Values that a participant writes on a port of its own, `participant/<name>/<word>`, once a period.

    Numbers and booleans by name, curves in the recording; other participants may read them.
    """

    values: Annotated[dict[Name, bool | float], Field(max_length=MAX_VALUES)]


def encode_inputs(tick: int, time_s: float, payloads: Mapping[str, bytes]) -> bytes:
    """Return the canonical bytes of `ParticipantInputs` from those of its messages."""
    inputs = {port: msgspec.Raw(payload) for port, payload in payloads.items()}
    return msgspec.msgpack.encode({"tick": tick, "time_s": time_s, "inputs": inputs})
