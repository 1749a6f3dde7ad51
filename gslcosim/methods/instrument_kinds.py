"""Kinds of instruments that a method may need, by what they report."""

from collections.abc import Callable, Iterable

from gslcosim.contract.messages import SensorDescription

# What gas sensors at points report.
GAS_QUANTITIES = ("resistance", "mixing_ratio", "gas_detected", "hits")
ESTIMATE_QUANTITY = "estimated_mixing_ratio"
WIND_QUANTITY = "apparent_wind"
RANGE_QUANTITY = "range"
CAMERA_QUANTITY = "picture"


def _is_gas(sensor: SensorDescription) -> bool:
    return sensor.quantity in GAS_QUANTITIES


def _is_gas_ohm(sensor: SensorDescription) -> bool:
    return sensor.quantity == "resistance"


def _is_gas_ppm(sensor: SensorDescription) -> bool:
    return sensor.quantity in ("mixing_ratio", ESTIMATE_QUANTITY)


def _is_wind(sensor: SensorDescription) -> bool:
    return sensor.quantity == WIND_QUANTITY


def _is_range(sensor: SensorDescription) -> bool:
    return sensor.quantity == RANGE_QUANTITY


def _is_camera(sensor: SensorDescription) -> bool:
    return sensor.quantity == CAMERA_QUANTITY


# For each kind its predicate, and an example that a person may add to a scenario.
INSTRUMENT_KINDS: dict[str, tuple[Callable[[SensorDescription], bool], str]] = {
    "gas": (_is_gas, "{model: tgs2600, name: nose}"),
    "gas_ohm": (_is_gas_ohm, "{model: tgs2600, name: nose}"),
    "gas_ppm": (_is_gas_ppm, "{model: pid, name: nose}"),
    "wind": (_is_wind, "{model: anemometer, name: wind}"),
    "range": (_is_range, "{model: four_range_finders, name: ranges}"),
    "camera": (_is_camera, "{model: camera, name: eye}"),
}


def count_instruments(kind: str, sensors: Iterable[SensorDescription]) -> int:
    """Return how many sensors are of a kind of `INSTRUMENT_KINDS`; the estimate of a MOX sensor counts as ppm."""
    is_of_kind, _ = INSTRUMENT_KINDS[kind]
    return sum(is_of_kind(sensor) for sensor in sensors)
