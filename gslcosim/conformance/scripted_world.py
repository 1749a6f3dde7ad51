"""Scripted world of a check: small, pure, and the same for every agent; no physics, but all that a session has.

A vehicle is where its last waypoint was as soon as the next question comes. Ticks leap over the places where integers
get longer in msgpack, which a run reaches only after hours.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gslcosim.base.rng import stream
from gslcosim.contract.messages import (
    CONTRACT_VERSION,
    Bounds,
    Briefing,
    ChannelDescription,
    Command,
    KnownMap,
    Observation,
    Vec3,
)
from gslcosim.contract.record import NumericArray
from gslcosim.contract.schema import get_contract_hash
from gslcosim.methods.card import Needs
from gslcosim.methods.example_instruments import GAS, MISSION, PLUME, ROOM_M, SOURCE_M, build_readings, build_sensors

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
        time_limit_s=10_000.0,
        sensors=build_sensors(needs),
        contract_hash=get_contract_hash(),
        channels=_CHANNELS if needs.radio else (),
        known_map=_MAP if "map" in needs.knows else None,
        plume=PLUME if "plume" in needs.knows else None,
        known_sources=(SOURCE_M,) if "source" in needs.knows else (),
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
