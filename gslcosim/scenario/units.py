"""Units that scenario keys carry in their names, and as people write them behind numbers."""

import math
import re
from dataclasses import dataclass

# The ending of a key's name and what a number under it counts. Longer endings come first.
UNIT_OF_ENDING = {
    "_per_s": "per second",
    "_m_s2": "metres per second squared",
    "_m2_s": "square metres per second",
    "_m_s": "metres per second",
    "_rad_s": "radians per second",
    "_pa_s": "pascals per second",
    "_rad": "radians",
    "_hz": "hertz",
    "_px": "pixels",
    "_pa": "pascals",
    "_ut": "microteslas",
    "_k": "kelvins",
    "_ppm": "ppm",
    "_ms": "milliseconds",
    "_m": "metres",
    "_s": "seconds",
}

# What people write behind numbers: the ending it belongs to, and the factor to that ending's unit.
_WRITTEN_UNITS = {
    "m": ("_m", 1.0), "cm": ("_m", 0.01), "mm": ("_m", 0.001), "km": ("_m", 1000.0),
    "metre": ("_m", 1.0), "metres": ("_m", 1.0), "meter": ("_m", 1.0), "meters": ("_m", 1.0),
    "s": ("_s", 1.0), "sec": ("_s", 1.0), "second": ("_s", 1.0), "seconds": ("_s", 1.0),
    "ms": ("_s", 0.001), "min": ("_s", 60.0), "minute": ("_s", 60.0), "minutes": ("_s", 60.0), "h": ("_s", 3600.0),
    "m/s": ("_m_s", 1.0), "cm/s": ("_m_s", 0.01), "km/h": ("_m_s", 1 / 3.6),
    "m/s2": ("_m_s2", 1.0), "m/s^2": ("_m_s2", 1.0), "m2/s": ("_m2_s", 1.0), "m^2/s": ("_m2_s", 1.0),
    "rad": ("_rad", 1.0), "°": ("_rad", math.pi / 180), "deg": ("_rad", math.pi / 180),
    "degrees": ("_rad", math.pi / 180),
    "ppm": ("_ppm", 1.0), "ppb": ("_ppm", 0.001), "1/s": ("_per_s", 1.0), "/s": ("_per_s", 1.0), "hz": ("_per_s", 1.0),
}  # fmt: skip

_NUMBER_WITH_UNIT = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\s\d][^\s]*)?\s*$")


@dataclass(frozen=True, kw_only=True)
class WrittenQuantity:
    """A number that somebody wrote as text, with the unit behind it as written (empty: none)."""

    number: float
    unit: str


def unit_suffix(key: str) -> str:
    """Return the part of a key's name that says its unit, such as `_m_s`; empty where there is none."""
    if key == "ppm":
        return "_ppm"
    return next((ending for ending in UNIT_OF_ENDING if key.endswith(ending)), "")


def unit_name(key: str) -> str:
    """Return what a number under a key counts, such as `metres per second`; empty where the name says no unit."""
    return UNIT_OF_ENDING.get(unit_suffix(key), "")


def read_quantity(text: str) -> WrittenQuantity | None:
    """Return the number and unit in a text such as `2 m`, or nothing when it is not a number."""
    match = _NUMBER_WITH_UNIT.match(text)
    return match and WrittenQuantity(number=float(match[1]), unit=match[2] or "")


def number_in_unit_of(key: str, quantity: WrittenQuantity) -> float | None:
    """Return the number to write under a key for a written quantity, or nothing when the unit is of another kind."""
    if not quantity.unit:
        return quantity.number
    ending, factor = _WRITTEN_UNITS.get(quantity.unit.lower(), ("", 1.0))
    if ending == "_s" and unit_suffix(key) == "_ms":
        ending, factor = "_ms", factor * 1000.0
    if not ending or ending != unit_suffix(key):
        return None
    return float(f"{quantity.number * factor:.6g}")
