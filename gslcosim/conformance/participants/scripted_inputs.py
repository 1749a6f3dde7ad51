"""The inputs that a check plays: made up and the same for every participant, but of the kinds that a run has."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import msgpack

from gslcosim.conformance.scripted_world import ROOM_M, TICK_NS, with_unknown_fields
from gslcosim.contract import keys
from gslcosim.contract.channels import AGENT as ANY_AGENT
from gslcosim.contract.channels import CHANNELS
from gslcosim.contract.knowledge import ParameterValue
from gslcosim.contract.messages import Bounds, FieldSamples, GasAmount, Message, MountSample
from gslcosim.contract.participation import (
    PARTICIPATION_VERSION,
    VENTILATION,
    ParticipantBriefing,
    ParticipantHello,
    ParticipantInputs,
    ParticipantValues,
    PortRead,
    PortWrite,
    VehicleOfRun,
    own_port,
)
from gslcosim.contract.publish.examples import EXAMPLES
from gslcosim.contract.ventilation import WIND, WindShare
from gslcosim.rng import stream
from gslcosim.ticks import seconds_from_ticks

NAME = "model_1"
VEHICLE = "beetle"
# In a row, and over the places where integers get longer in msgpack.
TICKS = (*range(40), *range(120, 131), *range(250, 260), *range(65_530, 65_540))
# Without any input, as at the beginning of a run where all have a delay.
EMPTY_TICKS = 5
_NOT_READ = (keys.briefing(ANY_AGENT), keys.question(ANY_AGENT), keys.raw_command(ANY_AGENT), keys.ending(ANY_AGENT))
_OWN = own_port("", "").split("/")[0]


def message_name(port: str) -> str | None:
    """Return the type of the message on a port of a run, None where no run has such a port."""
    parts = port.split("/")
    if port == WIND:
        return WindShare.__name__
    if parts[0] == _OWN and len(parts) == 3 and all(parts):
        return ParticipantValues.__name__
    for channel in CHANNELS:
        wanted = channel.key.split("/")
        fits = len(parts) == len(wanted) and all(b == ANY_AGENT or a == b for a, b in zip(parts, wanted, strict=True))
        if fits and all(parts) and channel.key not in _NOT_READ:
            return channel.message
    return None


def briefing_of_check(
    hello: ParticipantHello, seed: int, parameters: Mapping[str, ParameterValue]
) -> ParticipantBriefing:
    """Return what a participant is told first."""
    return ParticipantBriefing(
        tick=0,
        participant=NAME,
        contract_version=PARTICIPATION_VERSION,
        scenario="check",
        tick_ns=TICK_NS,
        period_ticks=1,
        seed=seed,
        time_limit_s=10_000.0,
        bounds=Bounds(min_m=(0.0, 0.0, 0.0), max_m=ROOM_M),
        gases=("ethanol",),
        vehicles=(VehicleOfRun(agent=VEHICLE, sensors=("nose", "wind")),),
        reads=tuple(PortRead(port=port, delay_ticks=0, message=message_name(port) or "") for port in hello.reads),
        writes=tuple(_write(word) for word in hello.writes),
        parameters=dict(parameters),
    )


class ScriptedInputs:
    """One session's inputs. The same seed gives the same."""

    def __init__(self, reads: Iterable[str], seed: int) -> None:
        self._reads = tuple(reads)
        self._noise = stream(seed, "conformance.inputs")

    def at(self, tick: int) -> ParticipantInputs:
        """Return the inputs of a tick; to be called for each tick in turn."""
        inputs = {port: _message(port, tick, float(self._noise.standard_normal())) for port in self._reads}
        return ParticipantInputs(
            tick=tick,
            time_s=seconds_from_ticks(tick, TICK_NS),
            inputs={port: message.model_dump() for port, message in inputs.items()},
        )


def with_later_fields(message: Message) -> dict[str, Any]:
    """Return the fields of a message as a later minor version might send it, also within the inputs."""
    fields = message.model_dump()
    inputs: dict[str, Any] = fields.pop("inputs", {})
    later = with_unknown_fields(fields)
    if isinstance(message, ParticipantInputs):
        is_data = {port: message_name(port) == ParticipantValues.__name__ for port in inputs}
        later["inputs"] = {
            port: value if is_data[port] else with_unknown_fields(value) for port, value in inputs.items()
        }
    return later


def payload_of(fields: Mapping[str, Any]) -> bytes:
    """Return fields as msgpack."""
    payload: Any = msgpack.packb(fields)
    return bytes(payload)


# In gas for a while, then not, with noise.
def _message(port: str, tick: int, noise: float) -> Message:
    name = message_name(port)
    if name == FieldSamples.__name__:
        ppm = max(0.0, 5.0 * math.sin(tick / 6.0) + 0.1 * noise)
        gases = (GasAmount(gas="ethanol", mixing_ratio_ppm=ppm),)
        wind_m_s = (0.5 + 0.01 * noise, 0.0, 0.0)
        names = ("nose", "wind")
        samples = (MountSample(agent=VEHICLE, sensor=each, gases=gases, wind_world_m_s=wind_m_s) for each in names)
        return FieldSamples(tick=tick, samples=tuple(samples))
    if name == ParticipantValues.__name__:
        return ParticipantValues(tick=tick, values={"level": noise, "is_on": noise > 0})
    if name == WindShare.__name__:
        return WindShare(tick=tick, share=abs(noise))
    example = next(message for message in EXAMPLES.values() if type(message).__name__ == name)
    return example.model_copy(update={"tick": tick})


def _write(word: str) -> PortWrite:
    if word == VENTILATION:
        return PortWrite(word=word, port=WIND, message=WindShare.__name__)
    return PortWrite(word=word, port=own_port(NAME, word), message=ParticipantValues.__name__)
