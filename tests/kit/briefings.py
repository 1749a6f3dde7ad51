"""Briefings and observations for tests of agents: a room, a vehicle, and readings by the sensors' names."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from built_messages import build_briefing, build_observation

from gslcosim.contract.messages import (
    Bounds,
    Briefing,
    ChannelDescription,
    KnownMap,
    NominalPlume,
    Observation,
    RadioReception,
    Reading,
    SensorDescription,
    Task,
)
from gslcosim.contract.record import NumericArray
from gslcosim.scenario.models.scenario import RefereeSpec
from gslcosim.scenario.models.success import SuccessSpec
from gslcosim_services.sensing.briefing import build_task

DIRECTIONS = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], np.float32)
# Per model: quantity and unit as gslcosim's sensors have them.
MODELS = {
    "tgs2600": ("resistance", "ohm"),
    "tgs2620": ("resistance", "ohm"),
    "pid": ("mixing_ratio", "ppm"),
    "binary": ("gas_detected", "1"),
    "hit_counter": ("hits", "1"),
    "tdlas": ("path_integrated_mixing_ratio", "ppm m"),
    "anemometer": ("apparent_wind", "m/s, rad"),
    "anemometer_3d": ("apparent_wind", "m/s"),
    "four_range_finders": ("range", "m"),
    "camera": ("picture", "1"),
}
PLUME = NominalPlume(
    release_ppm_m3_s=1.6, puffs_per_s=10.0, initial_sigma_m=0.1, growth_m2_s=0.001, diffusivity_m2_s=0.002,
    wind_speed_m_s=0.5,
)  # fmt: skip


def task_of(success: SuccessSpec) -> Task:
    """Return the task that an agent is briefed with under a criterion."""
    return build_task(RefereeSpec(success=success))


def sensor(model: str, name: str, mount_body_m=(0.0, 0.0, 0.0)) -> SensorDescription:
    quantity, unit = MODELS[model]
    directions = NumericArray.from_array(DIRECTIONS) if quantity == "range" else None
    return SensorDescription(
        name=name, model=model, quantity=quantity, unit=unit, mount_body_m=mount_body_m, directions_body=directions
    )


def with_estimates(sensors: Sequence[SensorDescription]) -> tuple[SensorDescription, ...]:
    """Add what the run tells beside MOX sensors: an estimate in ppm under the sensor's name with `_ppm`."""
    estimates = [
        item.model_copy(update={"name": f"{item.name}_ppm", "quantity": "estimated_mixing_ratio", "unit": "ppm"})
        for item in sensors
        if item.unit == "ohm"
    ]
    return (*sensors, *estimates)


def briefing(
    *,
    sensors: Sequence[tuple[Any, ...]] = (("tgs2600", "nose"), ("anemometer", "vane")),
    seed: int = 1,
    name: str = "searcher",
    size_m=(15.0, 10.0, 8.0),
    parameters: Mapping[str, Any] | None = None,
    known_map: KnownMap | None = None,
    plume: NominalPlume | None = None,
    known_sources=(),
    members: Sequence[str] = (),
    **changes: Any,
) -> Briefing:
    """Return a briefing of a room from (0, 0, 0) to `size_m`; `members` are the agents on the channel `radio`."""
    channels = (
        (ChannelDescription(name="radio", members=tuple(members), range_m=None, delay_ticks=1, max_bytes=1024),)
        if members
        else ()
    )
    fields = {
        "agent": name, "mission": "find it", "seed": seed,
        "bounds": Bounds(min_m=(0.0, 0.0, 0.0), max_m=size_m), "search_height_m": 2.0, "hold_s": 2.0,
        "time_limit_s": 300.0, "sensors": with_estimates([sensor(*item) for item in sensors]), "channels": channels,
        "parameters": dict(parameters or {}), "known_map": known_map, "plume": plume,
        "known_sources": tuple(known_sources),
    }  # fmt: skip
    return build_briefing(**{**fields, **changes})


def open_map(size_m=(15.0, 10.0), cell_m=0.25, walls=()) -> KnownMap:
    """Return the plan of a room; `walls` are solid rectangles (x0, y0, x1, y1) [m]."""
    shape = (round(size_m[0] / cell_m), round(size_m[1] / cell_m))
    occupied = np.zeros(shape, np.uint8)
    for x0, y0, x1, y1 in walls:
        i0, j0, i1, j1 = (round(value / cell_m) for value in (x0, y0, x1, y1))
        occupied[i0:i1, j0:j1] = 1
    return KnownMap(origin_m=(0.0, 0.0, 2.0), cell_m=cell_m, occupied=NumericArray.from_array(occupied), height_m=2.0)


def observation(
    *,
    tick: int = 40,
    position_m=(7.0, 5.0, 2.0),
    readings: Mapping[str, Any] | None = None,
    yaw_rad: float = 0.0,
    velocity_m_s=(0.0, 0.0, 0.0),
    asked: bool = True,
    notice: str | None = None,
    heard: Sequence[tuple[str, str]] = (),
    name: str = "searcher",
    warming: Sequence[str] = (),
    **changes: Any,
) -> Observation:
    """Return an observation; `readings` maps a sensor's name to its value or values, `heard` has (sender, text)."""
    fields = {
        "agent": name, "position_world_m": position_m, "yaw_rad": yaw_rad, "velocity_world_m_s": velocity_m_s,
        "awaiting_command": asked, "notice": notice,
        "readings": tuple(
            Reading(
                sensor=sensor_name,
                quantity="any",
                unit="any",
                values=tuple(float(v) for v in value) if isinstance(value, Sequence) else (float(value),),
                is_warming_up=sensor_name in warming,
            )
            for sensor_name, value in (readings or {"nose": 50_000.0, "nose_ppm": 0.0, "vane": (0.5, np.pi)}).items()
        ),
        "incoming": tuple(
            RadioReception(sender=sender, channel="radio", text=text, sent_tick=max(0, tick - 1))
            for sender, text in heard
        ),
    }  # fmt: skip
    return build_observation(tick, **{**fields, **changes})
