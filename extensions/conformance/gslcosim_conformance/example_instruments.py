"""Example instruments of each kind, and what they read in a small room with a smooth plume and a steady wind.

Checks of methods and of participants play them: no physics, but all that a session has.
"""

import base64
import math
from collections.abc import Iterable

import numpy as np

from gslcosim.contract.messages import (
    CameraImage,
    FieldSamples,
    GasAmount,
    MountSample,
    NominalPlume,
    Reading,
    SensorDescription,
    Task,
    Vec3,
)
from gslcosim.contract.record import NumericArray
from gslcosim.methods.card import CAMERA_QUANTITY, RANGE_QUANTITY, WIND_QUANTITY, Needs, count_instruments

ROOM_M: Vec3 = (12.0, 8.0, 3.0)
SOURCE_M: Vec3 = (2.0, 4.0, 1.5)
CLEAN_AIR_OHM = 50_000.0
GAS = "ethanol"
MISSION = f"Find the source of {GAS} in the room: come within 1 m of it in at most 10000 s."
TASK = Task(goal="source", success_radius_m=1.0, time_limit_s=10_000.0, distance_of="vehicle")
PLUME = NominalPlume(
    release_ppm_m3_s=1.6,
    puffs_per_s=10.0,
    initial_sigma_m=0.1,
    growth_m2_s=0.001,
    diffusivity_m2_s=0.002,
    wind_speed_m_s=0.5,
)
# Those whose mounts `build_samples` tells of.
SAMPLED_SENSORS = ("nose", "wind")
_BEAM_DIRECTIONS = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], np.float32)
_MODELS_BY_KIND = {
    "gas": ("pid", "mixing_ratio", "ppm"),
    "gas_ohm": ("tgs2600", "resistance", "ohm"),
    "gas_ppm": ("pid", "mixing_ratio", "ppm"),
    "wind": ("anemometer", WIND_QUANTITY, "m/s, rad"),
    "range": ("four_range_finders", RANGE_QUANTITY, "m"),
    "camera": ("camera", CAMERA_QUANTITY, "1"),
}
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


def _build_sensor(name: str, model: str, quantity: str, unit: str, *, y_m: float = 0.0) -> SensorDescription:
    return SensorDescription(
        name=name,
        model=model,
        quantity=quantity,
        unit=unit,
        mount_body_m=(0.0, y_m, 0.1),
        directions_body=NumericArray.from_array(_BEAM_DIRECTIONS) if quantity == RANGE_QUANTITY else None,
    )


def build_readings(
    sensors: Iterable[SensorDescription], position_m: Vec3, noise: np.random.Generator
) -> tuple[Reading, ...]:
    """Return what sensors read on a vehicle at a place that looks along +x.

    Args:
        sensors: Those of `build_sensors`.
        position_m: The place, world frame [m].
        noise: Two draws are taken from it: first for gas, then for wind.
    """
    ppm = 100.0 * math.exp(-math.dist(position_m, SOURCE_M) / 3.0)
    ohm = CLEAN_AIR_OHM / (1.0 + 0.02 * ppm) * (1.0 + 0.01 * float(noise.standard_normal()))
    upwind_rad = math.pi + 0.1 * float(noise.standard_normal())
    x_m, y_m, _ = position_m
    values = {
        "resistance": (ohm,),
        "mixing_ratio": (ppm,),
        WIND_QUANTITY: (0.5, upwind_rad),
        # Ahead, left, back, right.
        RANGE_QUANTITY: (ROOM_M[0] - x_m, ROOM_M[1] - y_m, x_m, y_m),
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
        for sensor in sensors
    )


def build_samples(tick: int, noise: float, *, agent: str) -> FieldSamples:
    """Return the truth at the mounts of a vehicle that is in gas for a while, then not.

    Args:
        tick: When.
        noise: A draw of the standard normal distribution, by which gas and wind differ from tick to tick.
        agent: The vehicle.
    """
    ppm = max(0.0, 5.0 * math.sin(tick / 6.0) + 0.1 * noise)
    gases = (GasAmount(gas=GAS, mixing_ratio_ppm=ppm),)
    wind_m_s = (0.5 + 0.01 * noise, 0.0, 0.0)
    samples = (MountSample(agent=agent, sensor=name, gases=gases, wind_world_m_s=wind_m_s) for name in SAMPLED_SENSORS)
    return FieldSamples(tick=tick, samples=tuple(samples))
