"""Scripted world of a check, small and pure: every message that it sends to an agent or to a participant.

There are no physics, but all that a session has. A vehicle is where its last waypoint was as soon as the next question
comes. Ticks leap over the places where integers get longer in msgpack, which a run reaches only after hours.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import msgpack
import numpy as np

from gslcosim.base.bundled import bundled_contract
from gslcosim.base.rng import stream
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract import codec, keys
from gslcosim.contract.environment_messages import PROBES, WIND, ProbeSamples, SourceRate, WindShare, build_source_port
from gslcosim.contract.messages import (
    Bounds,
    Briefing,
    ChannelDescription,
    Command,
    FieldSamples,
    KnownMap,
    Message,
    Observation,
    ParameterValue,
    Vec3,
)
from gslcosim.contract.participant_messages import (
    PARTICIPATION_VERSION,
    ParticipantBriefing,
    ParticipantHello,
    ParticipantInputs,
    ParticipantValues,
    PortRead,
    PortWrite,
    VehicleOfRun,
    build_own_port,
    find_room_output,
)
from gslcosim.contract.record import NumericArray
from gslcosim.contract.version import CONTRACT_HASH, CONTRACT_VERSION
from gslcosim.methods.card import Needs
from gslcosim_conformance.example_instruments import (
    GAS,
    MISSION,
    PLUME,
    ROOM_M,
    SAMPLED_SENSORS,
    SOURCE_M,
    TASK,
    build_readings,
    build_samples,
    build_sensors,
)
from gslcosim_conformance.key_table import AGENT_PLACEHOLDER as ANY_AGENT
from gslcosim_conformance.key_table import KEY_TABLE
from gslcosim_conformance.message_schemas import list_published_types

AGENT = "agent_1"
OTHER_AGENT = "agent_2"
TICK_NS = 100_000_000
START_M: Vec3 = (9.0, 4.0, 1.5)
_CHANNELS = (
    ChannelDescription(name="radio", members=(AGENT, OTHER_AGENT), range_m=None, delay_ticks=1, max_bytes=1024),
)
_MAP_CELL_M = 0.25
_MAP = KnownMap(
    origin_m=(0.0, 0.0, START_M[2]),
    cell_m=_MAP_CELL_M,
    occupied=NumericArray.from_array(
        np.zeros((round(ROOM_M[0] / _MAP_CELL_M), round(ROOM_M[1] / _MAP_CELL_M)), np.uint8)
    ),
    height_m=START_M[2],
)
REFUSED_QUESTION = 6

# Questions one by one and in a row, after pauses of several lengths; 2^7, 2^8 and 2^16 are crossed by questions.
QUESTION_TICKS = (4, 9, 10, 11, 40, 127, 128, 255, 256, 257, 300, 65_535, 65_536, 70_000)
OTHER_TICKS = (*range(4), *range(5, 9), *range(12, 40), *range(120, 127), 129, 254, 258, 299, *range(65_530, 65_535))
# Maps whose keys are data: what is added there would be data, too.
_FREE_FORM_FIELDS = ("parameters",)
PARTICIPANT_NAME = "model_1"
VEHICLE_NAME = "beetle"
# In a row, and over the places where integers get longer in msgpack.
INPUT_TICKS = (*range(40), *range(120, 131), *range(250, 260), *range(65_530, 65_540))
# Without any input, as at the beginning of a run where all have a delay.
N_EMPTY_TICKS = 5
_HIDDEN_KEYS = (keys.briefing(ANY_AGENT), keys.question(ANY_AGENT), keys.raw_command(ANY_AGENT), keys.ending(ANY_AGENT))
_OWN_PORT_PREFIX = build_own_port("", "").split("/")[0]
_SOURCE_PORTS_PREFIX = build_source_port(0).removesuffix("0")


def iter_ticks() -> Iterator[tuple[int, bool]]:
    """Yield all ticks of a run in order, and whether the agent is asked."""
    for tick in sorted({*QUESTION_TICKS, *OTHER_TICKS}):
        yield tick, tick in QUESTION_TICKS


def build_briefing(seed: int, needs: Needs | None = None) -> Briefing:
    """Return the agent's briefing; its seed is the check's. What its method needs is there."""
    needs = needs or Needs()
    return Briefing(
        tick=0,
        agent=AGENT,
        contract_version=CONTRACT_VERSION,
        mission=MISSION,
        tick_ns=TICK_NS,
        seed=seed,
        mode="on_request",
        latency_ticks=1,
        gas=GAS,
        bounds=Bounds(min_m=(0.0, 0.0, 0.0), max_m=ROOM_M),
        search_height_m=START_M[2],
        hold_s=2.0,
        time_limit_s=TASK.time_limit_s,
        sensors=build_sensors(needs),
        contract_hash=CONTRACT_HASH,
        channels=_CHANNELS if needs.radio else (),
        known_map=_MAP if "map" in needs.knows else None,
        plume=PLUME if "plume" in needs.knows else None,
        known_sources=(SOURCE_M,) if "source" in needs.knows else (),
        task=TASK,
    )


@dataclass
class ScriptedWorld:
    """One run's world. The same seed and the same commands give the same observations."""

    seed: int
    needs: Needs = field(default_factory=Needs)
    position_m: Vec3 = START_M
    notice: str | None = None
    _n_commands: int = 0
    _noise: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self._noise = stream(self.seed, "conformance.noise")

    def observe(self, tick: int, *, is_asked: bool) -> Observation:
        """Return the agent's observation of a tick."""
        return Observation(
            tick=tick,
            agent=AGENT,
            time_s=tick * TICK_NS * 1e-9,
            position_world_m=self.position_m,
            yaw_rad=0.0,
            velocity_world_m_s=(0.0, 0.0, 0.0),
            status="holding" if is_asked else "flying",
            awaiting_command=is_asked,
            readings=build_readings(build_sensors(self.needs), self.position_m, self._noise),
            notice=self.notice,
        )

    def obey(self, command: Command) -> None:
        """Do what the agent commands; once it is refused, so that the agent gets a notice."""
        self._n_commands += 1
        self.notice = None
        if command.position_world_m is not None:
            self._go_to(command.position_world_m)
        elif command.velocity_world_m_s is not None:
            duration_s = 2.0 if command.hold_s is None else command.hold_s
            moves_m = (speed * duration_s for speed in command.velocity_world_m_s)
            x_m, y_m, z_m = (at + move for at, move in zip(self.position_m, moves_m))
            self._go_to((x_m, y_m, z_m))

    def _go_to(self, target_m: Vec3) -> None:
        is_inside = all(0.0 < at < limit for at, limit in zip(target_m, ROOM_M))
        if is_inside and self._n_commands != REFUSED_QUESTION:
            self.position_m = target_m
        else:
            self.notice = "waypoint: expected a place in free air, was within an obstacle or outside of the room."


def add_unknown_fields(fields: dict[str, Any]) -> dict[str, Any]:
    """Return a message's map as a later minor version might send it: more keys, of every type, at every level."""
    more: dict[str, Any] = {
        "x_text": "later",
        "x_whole": -7,
        "x_real": 0.5,
        "x_flag": True,
        "x_nothing": None,
        "x_list": [1, [2.5, "three"], {"four": 4}],
        "x_map": {"a": {"b": []}},
    }
    later = {key: value if key in _FREE_FORM_FIELDS else _extend(value, more) for key, value in fields.items()} | more
    if "contract_version" in later:
        major = CONTRACT_VERSION.split(".")[0]
        later |= {"contract_version": f"{major}.99", "contract_hash": "0" * 32}
    return later


def _extend(value: Any, more: dict[str, Any]) -> Any:
    if isinstance(value, dict):
        return {key: _extend(item, more) for key, item in value.items()} | more
    return [_extend(item, more) for item in value] if isinstance(value, list | tuple) else value


def get_message_name(port: str) -> str | None:
    """Return the type of the message on a port of a run, None where no run has such a port."""
    parts = port.split("/")
    if port == WIND:
        return WindShare.__name__
    if port == PROBES:
        return ProbeSamples.__name__
    if port.startswith(_SOURCE_PORTS_PREFIX) and parts[-1].isdecimal():
        return SourceRate.__name__
    if parts[0] == _OWN_PORT_PREFIX and len(parts) == 3 and all(parts):
        return ParticipantValues.__name__
    for channel in KEY_TABLE:
        wanted = channel.key.split("/")
        fits = len(parts) == len(wanted) and all(b == ANY_AGENT or a == b for a, b in zip(parts, wanted, strict=True))
        if fits and all(parts) and channel.key not in _HIDDEN_KEYS:
            return channel.message
    return None


def build_check_briefing(
    hello: ParticipantHello, seed: int, parameters: Mapping[str, ParameterValue]
) -> ParticipantBriefing:
    """Return the briefing of a participant."""
    return ParticipantBriefing(
        tick=0,
        participant=PARTICIPANT_NAME,
        contract_version=PARTICIPATION_VERSION,
        scenario="check",
        tick_ns=TICK_NS,
        period_ticks=1,
        seed=seed,
        time_limit_s=TASK.time_limit_s,
        bounds=Bounds(min_m=(0.0, 0.0, 0.0), max_m=ROOM_M),
        gases=(GAS,),
        vehicles=(VehicleOfRun(agent=VEHICLE_NAME, sensors=SAMPLED_SENSORS),),
        reads=tuple(PortRead(port=port, delay_ticks=0, message=get_message_name(port) or "") for port in hello.reads),
        writes=tuple(_build_write(word) for word in hello.writes),
        parameters=dict(parameters),
    )


class ScriptedInputs:
    """One session's inputs. The same seed gives the same."""

    def __init__(self, reads: Iterable[str], seed: int) -> None:
        self._reads = tuple(reads)
        self._noise = stream(seed, "conformance.inputs")

    def at(self, tick: int) -> ParticipantInputs:
        """Return the inputs of a tick; to be called for each tick in turn."""
        inputs = {port: _build_input(port, tick, float(self._noise.standard_normal())) for port in self._reads}
        return ParticipantInputs(
            tick=tick,
            time_s=seconds_from_ticks(tick, TICK_NS),
            inputs={port: message.model_dump() for port, message in inputs.items()},
        )


def add_later_fields(message: Message) -> dict[str, Any]:
    """Return the fields of a message as a later minor version might send it, also within the inputs."""
    fields = message.model_dump()
    inputs: dict[str, Any] = fields.pop("inputs", {})
    later = add_unknown_fields(fields)
    if isinstance(message, ParticipantInputs):
        is_data = {port: get_message_name(port) == ParticipantValues.__name__ for port in inputs}
        later["inputs"] = {
            port: value if is_data[port] else add_unknown_fields(value) for port, value in inputs.items()
        }
    return later


def pack_fields(fields: Mapping[str, Any]) -> bytes:
    """Return fields as msgpack."""
    payload: Any = msgpack.packb(fields)
    return bytes(payload)


def _build_input(port: str, tick: int, noise: float) -> Message:
    name = get_message_name(port)
    if name == FieldSamples.__name__:
        return build_samples(tick, noise, agent=VEHICLE_NAME)
    if name == ParticipantValues.__name__:
        return ParticipantValues(tick=tick, values={"level": noise, "is_on": noise > 0})
    if name == WindShare.__name__:
        return WindShare(tick=tick, share=abs(noise))
    if name == SourceRate.__name__:
        return SourceRate(tick=tick, filaments_per_s=abs(noise))
    return load_example(name).model_copy(update={"tick": tick})


def _build_write(word: str) -> PortWrite:
    room = find_room_output(word)
    if room is not None:
        return PortWrite(word=word, port=room.port, message=room.message_type.__name__)
    return PortWrite(word=word, port=build_own_port(PARTICIPANT_NAME, word), message=ParticipantValues.__name__)


@cache
def load_example(name: str) -> Message:
    """Return the first golden vector of the message type of a name, such as `BodyPoses`, in the published contract."""
    message_type = next(item for item in list_published_types() if item.__name__ == name)
    vectors = json.loads((bundled_contract() / "vectors" / f"{name}.json").read_text(encoding="utf-8"))
    return codec.decode(message_type, bytes.fromhex(vectors["accept"][0]["msgpack"]))
