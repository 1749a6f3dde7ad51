"""Scripted world of a check: small, pure, and the same for every agent; no physics, but all that a session has.

A room with a smooth plume and a steady wind with noise. A vehicle is where its last waypoint was as soon as the next
question comes. Ticks leap over the places where integers get longer in msgpack, which a run reaches only after hours.
"""

import base64
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gslcosim.base.rng import stream
from gslcosim.contract.messages import (
    CONTRACT_VERSION,
    Bounds,
    Briefing,
    CameraImage,
    ChannelDescription,
    Command,
    KnownMap,
    NominalPlume,
    Observation,
    Reading,
    SensorDescription,
    Vec3,
)
from gslcosim.contract.record import NumericArray
from gslcosim.contract.schema import get_contract_hash
from gslcosim.methods.card import Needs
from gslcosim.methods.instrument_kinds import CAMERA_QUANTITY, RANGE_QUANTITY, WIND_QUANTITY, count_instruments

AGENT = "agent_1"
OTHER_AGENT = "agent_2"
TICK_NS = 100_000_000
ROOM_M: Vec3 = (12.0, 8.0, 3.0)
START_M: Vec3 = (9.0, 4.0, 1.5)
SOURCE_M: Vec3 = (2.0, 4.0, 1.5)
CLEAN_AIR_OHM = 50_000.0
_BEAM_DIRECTIONS = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], np.float32)
_MODELS_BY_KIND = {
    "gas": ("pid", "mixing_ratio", "ppm"),
    "gas_ohm": ("tgs2600", "resistance", "ohm"),
    "gas_ppm": ("pid", "mixing_ratio", "ppm"),
    "wind": ("anemometer", WIND_QUANTITY, "m/s, rad"),
    "range": ("four_range_finders", RANGE_QUANTITY, "m"),
    "camera": ("camera", CAMERA_QUANTITY, "1"),
}
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
_PLUME = NominalPlume(
    release_ppm_m3_s=1.6,
    puffs_per_s=10.0,
    initial_sigma_m=0.1,
    growth_m2_s=0.001,
    diffusivity_m2_s=0.002,
    wind_speed_m_s=0.5,
)
# A grey picture of 8 x 8 pixels.
_IMAGE = CameraImage(
    encoding="png",
    width_px=8,
    height_px=8,
    focal_px=6.0,
    centre_px=(4.0, 4.0),
    position_body_m=(0.1, 0.0, 0.0),
    quaternion_body_wxyz=(0.5, -0.5, 0.5, -0.5),
    taken_tick=0,
    data=base64.b64decode(
        "iVBORw0KGgoAAAANSUhEUgAAAAgAAAAICAIAAABLbSncAAAAFElEQVR4nGNsaGhgwAaYsIoOWgkAMBcBkGHHl6YAAAAASUVORK5CYII="
    ),
)
REFUSED_QUESTION = 6

# Questions one by one and in a row, after pauses of several lengths; 2^7, 2^8 and 2^16 are crossed by questions.
QUESTION_TICKS = (4, 9, 10, 11, 40, 127, 128, 255, 256, 257, 300, 65_535, 65_536, 70_000)
OTHER_TICKS = (*range(4), *range(5, 9), *range(12, 40), *range(120, 127), 129, 254, 258, 299, *range(65_530, 65_535))


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
        mission="Find the source of ethanol in the room: come within 1 m of it in at most 10000 s.",
        tick_ns=TICK_NS,
        seed=seed,
        mode="on_request",
        latency_ticks=1,
        gas="ethanol",
        bounds=Bounds(min_m=(0.0, 0.0, 0.0), max_m=ROOM_M),
        search_height_m=START_M[2],
        hold_s=2.0,
        time_limit_s=10_000.0,
        sensors=build_sensors(needs),
        contract_hash=get_contract_hash(),
        channels=_CHANNELS if needs.radio else (),
        known_map=_MAP if "map" in needs.knows else None,
        plume=_PLUME if "plume" in needs.knows else None,
        known_sources=(SOURCE_M,) if "source" in needs.knows else (),
    )


def build_sensors(needs: Needs) -> tuple[SensorDescription, ...]:
    """Return a nose, an anemometer and a PID, and after them as many more as a method needs.

    Nose and PID are on either side of the vehicle, for methods that compare two sides.
    """
    sensors = [
        _build_sensor("nose", "tgs2600", "resistance", "ohm", y_m=0.2),
        _build_sensor("wind", "anemometer", WIND_QUANTITY, "m/s, rad"),
        _build_sensor("pid", "pid", "mixing_ratio", "ppm", y_m=-0.2),
    ]
    for kind, n_needed in needs.sensors.items():
        n_missing = n_needed - count_instruments(kind, sensors)
        sensors += [_build_sensor(f"{kind}_{i + 1}", *_MODELS_BY_KIND[kind]) for i in range(n_missing)]
    return tuple(sensors)


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
            readings=self._readings(),
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

    def _readings(self) -> tuple[Reading, ...]:
        ppm = 100.0 * math.exp(-math.dist(self.position_m, SOURCE_M) / 3.0)
        ohm = CLEAN_AIR_OHM / (1.0 + 0.02 * ppm) * (1.0 + 0.01 * float(self._noise.standard_normal()))
        upwind_rad = math.pi + 0.1 * float(self._noise.standard_normal())
        values = {
            "resistance": (ohm,),
            "mixing_ratio": (ppm,),
            WIND_QUANTITY: (0.5, upwind_rad),
            RANGE_QUANTITY: self._ranges_m(),
            CAMERA_QUANTITY: (),
        }
        return tuple(
            Reading(
                sensor=sensor.name,
                quantity=sensor.quantity,
                unit=sensor.unit,
                values=values[sensor.quantity],
                image=_IMAGE if sensor.quantity == CAMERA_QUANTITY else None,
            )
            for sensor in build_sensors(self.needs)
        )

    # The vehicle looks along +x; ahead, left, back, right.
    def _ranges_m(self) -> tuple[float, ...]:
        x_m, y_m, _ = self.position_m
        return (ROOM_M[0] - x_m, ROOM_M[1] - y_m, x_m, y_m)


# Maps whose keys are data: what is added there would be data, too.
_FREE_FORM_FIELDS = ("parameters",)


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


def _build_sensor(name: str, model: str, quantity: str, unit: str, *, y_m: float = 0.0) -> SensorDescription:
    return SensorDescription(
        name=name,
        model=model,
        quantity=quantity,
        unit=unit,
        mount_body_m=(0.0, y_m, 0.1),
        directions_body=NumericArray.from_array(_BEAM_DIRECTIONS) if quantity == RANGE_QUANTITY else None,
    )
