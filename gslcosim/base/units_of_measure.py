"""Units of measure: those at the ends of names, such as `_m_s`, and those that users write behind numbers."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

# Units that users write behind numbers: the ending for each, and the factor to the unit of that ending.
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


@dataclass(frozen=True)
class Unit:
    """Unit at the end of names: its words, usual symbols, base units of SI (None: it has none) and factor to these."""

    words: str
    symbols: tuple[str, ...] = ()
    exponents: Mapping[str, int] | None = None
    factor: float = 1.0


# A number of things, or a fraction of one, has no words: "expected a number" is enough.
UNITS = {
    "_per_s": Unit("per second", ("1/s", "s-1"), {"s": -1}),
    "_m_s2": Unit("metres per second squared", ("m/s2", "m/s^2", "m.s-2", "m/(s.s)"), {"m": 1, "s": -2}),
    "_kg_m3": Unit("kilograms per cubic metre", ("kg/m3", "kg/m^3", "kg.m-3"), {"kg": 1, "m": -3}),
    "_kg_s": Unit("kilograms per second", ("kg/s", "kg.s-1", "kg s-1"), {"kg": 1, "s": -1}),
    "_m3_s": Unit("cubic metres per second", ("m3/s", "m^3/s", "m3.s-1"), {"m": 3, "s": -1}),
    "_m2_s": Unit("square metres per second", ("m2/s", "m^2/s", "m2.s-1"), {"m": 2, "s": -1}),
    "_m_s": Unit("metres per second", ("m/s", "m.s-1", "m s-1", "m*s^-1"), {"m": 1, "s": -1}),
    "_rad_s": Unit("radians per second", ("rad/s", "rad.s-1", "1/s"), {"rad": 1, "s": -1}),
    "_pa_s": Unit("pascals per second", ("Pa/s",), {"kg": 1, "m": -1, "s": -3}),
    "_share": Unit("", ("1", "-", ""), {}),
    "_frac": Unit("", ("1", "-", ""), {}),
    "_rad": Unit("radians", ("rad",), {"rad": 1}),
    "_ppm": Unit("ppm", ("ppm", "umol/mol"), {}, 1e-6),
    "_hz": Unit("hertz", ("Hz", "1/s", "s-1"), {"s": -1}),
    "_px": Unit("pixels", ("px",)),
    "_pa": Unit("pascals", ("Pa", "N/m2"), {"kg": 1, "m": -1, "s": -2}),
    "_ut": Unit("microteslas", ("uT",), {"kg": 1, "s": -2, "A": -1}, 1e-6),
    "_ev": Unit("electronvolts", ("eV",)),
    "_kg": Unit("kilograms", ("kg",), {"kg": 1}),
    "_ms": Unit("milliseconds", ("ms",), {"s": 1}, 1e-3),
    "_m2": Unit("square metres", ("m2", "m^2"), {"m": 2}),
    "_k": Unit("kelvins", ("K",), {"K": 1}),
    "_m": Unit("metres", ("m",), {"m": 1}),
    "_s": Unit("seconds", ("s",), {"s": 1}),
    "_w": Unit("watts", ("W", "J/s"), {"kg": 1, "m": 2, "s": -3}),
    "_j": Unit("joules", ("J", "W.s", "N.m"), {"kg": 1, "m": 2, "s": -2}),
    "_v": Unit("volts", ("V",), {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "_a": Unit("amperes", ("A",), {"A": 1}),
}
UNIT_SUFFIXES = tuple(sorted(UNITS, key=len, reverse=True))
"""Ends of names that denote a unit, longer ones first."""


def unit_suffix(key: str) -> str:
    """Return the end of a name that denotes its unit, such as `_m_s`; empty if there is none."""
    # A letter alone, such as `a`, is a name and no unit.
    whole = f"_{key}" if len(key) > 1 else key
    return next((suffix for suffix in UNIT_SUFFIXES if whole.endswith(suffix)), "")


def unit_name(key: str) -> str:
    """Return the unit of a number in words from its name, such as `metres per second`; empty if the name has none."""
    suffix = unit_suffix(key)
    return UNITS[suffix].words if suffix else ""


@dataclass(frozen=True, kw_only=True)
class WrittenQuantity:
    """A number written as text, with the unit behind it as written (empty: none)."""

    number: float
    unit: str


def read_quantity(text: str) -> WrittenQuantity | None:
    """Return the number and unit in a text such as `2 m`, or None if it is not a number."""
    match = _NUMBER_WITH_UNIT.match(text)
    return match and WrittenQuantity(number=float(match[1]), unit=match[2] or "")


def number_in_unit_of(key: str, quantity: WrittenQuantity) -> float | None:
    """Return the number to write under a key for a written quantity, or None if its unit is of another kind."""
    if not quantity.unit:
        return quantity.number
    ending, factor = _WRITTEN_UNITS.get(quantity.unit.lower(), ("", 1.0))
    if ending == "_s" and unit_suffix(key) == "_ms":
        ending, factor = "_ms", factor * 1000.0
    if not ending or ending != unit_suffix(key):
        return None
    return float(f"{quantity.number * factor:.6g}")
