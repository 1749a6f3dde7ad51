"""Sensor models by name, with quantity, unit and description; those of installed packages included."""

import sys
from functools import lru_cache
from pathlib import Path

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.models.sensors import SENSOR_OFFERS
from gslcosim_services.sensing.models.anemometer import ANEMOMETER, ANEMOMETER_3D
from gslcosim_services.sensing.models.base import (
    KernelSensorKind,
    SensorKernel,
    SensorKind,
    SensorModel,
    build_sensor,
    ideal_kind,
)
from gslcosim_services.sensing.models.gas_sensors import PID, PPM_KINDS, TDLAS
from gslcosim_services.sensing.models.mox import MOX_PARAMETERS, build_mox_kind
from gslcosim_services.sensing.models.navigation import BAROMETER, GPS, IMU, MAGNETOMETER, POSE
from gslcosim_services.sensing.models.range_finders import BUMPER, CAMERA_KINDS, RANGE_KINDS

_MOX_KINDS = tuple(build_mox_kind(parameters) for parameters in MOX_PARAMETERS.values())
_ON_BOARD_KINDS = (IMU, GPS, BAROMETER, MAGNETOMETER, POSE, *RANGE_KINDS, BUMPER, *CAMERA_KINDS)
_IDEAL_KINDS = tuple(ideal_kind(kind) for kind in (*_MOX_KINDS, PID, TDLAS, ANEMOMETER, ANEMOMETER_3D))

SENSOR_MODELS: dict[str, SensorKind] = {
    kind.name: kind
    for kind in (*_MOX_KINDS, *PPM_KINDS, TDLAS, ANEMOMETER, ANEMOMETER_3D, *_ON_BOARD_KINDS, *_IDEAL_KINDS)
}


def sensor_kind(name: str) -> SensorKind:
    """Return the sensor model of a name: one of `SENSOR_MODELS`, or one that an installed package offers.

    A package offers a `SensorKind` by an entry point of the group `gslcosim.sensors`; it is imported here, when a
    scenario names it, and not before.

    Raises:
        ScenarioError: there is none, or what the package offers is something else.
    """
    if name in SENSOR_MODELS:
        return SENSOR_MODELS[name]
    if name not in SENSOR_OFFERS.names():
        raise ScenarioError(f"model: expected one of {', '.join(sensor_names())}, was {name!r}.")
    return SENSOR_OFFERS.loaded(
        name,
        lambda offered: offered if isinstance(offered, SensorKind) and offered.name == name else None,
        f"the SensorKind {name!r}",
    )


def sensor_names() -> tuple[str, ...]:
    """Return the names of all sensor models: gslcosim's, then those of installed packages."""
    places = tuple(sys.path)
    return (*SENSOR_MODELS, *sorted(_load_offered(places, tuple(_changed_ns(place) for place in places))))


# Read again only after an installation or removal: each look-up reads a file for every installed package.
@lru_cache(maxsize=8)
def _load_offered(places: tuple[str, ...], changed_ns: tuple[int, ...]) -> frozenset[str]:
    del places, changed_ns
    return frozenset({*SENSOR_OFFERS.names()} - SENSOR_MODELS.keys())


def _changed_ns(place: str) -> int:
    try:
        return Path(place).stat().st_mtime_ns
    except OSError:
        return 0


__all__ = [
    "SENSOR_MODELS",
    "KernelSensorKind",
    "SensorKernel",
    "SensorKind",
    "SensorModel",
    "build_sensor",
    "sensor_kind",
    "sensor_names",
]
