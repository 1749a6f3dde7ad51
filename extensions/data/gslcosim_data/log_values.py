"""Values of robot logs: units by their spelling, limits of values by unit, and the numbers of a sensor's readings."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import SensorDescription

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Units as names of columns spell them, in lower case: the unit, and how many of it one is.
_SPELLINGS: dict[str, tuple[str, float]] = {
    "s": ("s", 1.0), "sec": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "ns": ("s", 1e-9), "min": ("s", 60.0),
    "m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3), "km": ("m", 1e3),
    "rad": ("rad", 1.0), "deg": ("rad", math.pi / 180),
    "m_s": ("m/s", 1.0), "cm_s": ("m/s", 1e-2), "mm_s": ("m/s", 1e-3), "km_h": ("m/s", 1 / 3.6),
    "m_s2": ("m/s^2", 1.0), "rad_s": ("rad/s", 1.0), "deg_s": ("rad/s", math.pi / 180),
    "ohm": ("ohm", 1.0), "ohms": ("ohm", 1.0), "kohm": ("ohm", 1e3), "kohms": ("ohm", 1e3), "megaohm": ("ohm", 1e6),
    "ppm": ("ppm", 1.0), "ppb": ("ppm", 1e-3), "ppm_m": ("ppm m", 1.0), "ppmxm": ("ppm m", 1.0),
    "ppb_m": ("ppm m", 1e-3),
    "v": ("V", 1.0), "volt": ("V", 1.0), "volts": ("V", 1.0), "mv": ("V", 1e-3), "uv": ("V", 1e-6),
    "amp": ("A", 1.0), "ma": ("A", 1e-3), "ua": ("A", 1e-6), "na": ("A", 1e-9),
    "pa": ("Pa", 1.0), "hpa": ("Pa", 1e2), "kpa": ("Pa", 1e3), "mbar": ("Pa", 1e2), "bar": ("Pa", 1e5),
    "ut": ("uT", 1.0), "nt": ("uT", 1e-3), "gauss": ("uT", 1e2),
    "c": ("degC", 1.0), "degc": ("degC", 1.0), "celsius": ("degC", 1.0), "kelvin": ("K", 1.0),
    "rh": ("%", 1.0), "percent": ("%", 1.0), "pct": ("%", 1.0), "mg_m3": ("mg/m^3", 1.0), "ug_m3": ("mg/m^3", 1e-3),
    # Two numbers of an anemometer without units can still be distinguished.
    "speed": ("m/s", 1.0), "direction": ("rad", 1.0), "dir": ("rad", 1.0),
}  # fmt: skip

# What a reading consists of, by the unit in its description; others have one number in that unit.
_PARTS: dict[str, tuple[str, ...]] = {
    "m/s, rad": ("m/s", "rad"),
    "m/s": ("m/s",) * 3,
    "m/s^2, rad/s": ("m/s^2",) * 3 + ("rad/s",) * 3,
    "m, m/s": ("m",) * 3 + ("m/s",) * 3,
    "m, 1, m/s": ("m",) * 3 + ("",) * 4 + ("m/s",) * 3,
    "uT": ("uT",) * 3,
}
_N_RANGES = {"four_range_finders": 4}

# Least and greatest value that a log of a robot in a room can have; loggers write others where they know none.
_LIMITS: dict[str, tuple[float, float]] = {
    "ohm": (1e-3, 1e10),
    "ppm": (-90.0, 1e6),
    "ppm m": (-90.0, 1e8),
    "m": (-900.0, 900.0),
    "range": (0.0, 900.0),
    "m/s": (-90.0, 300.0),
    "speed": (0.0, 300.0),
    "rad": (-2 * math.pi, 2 * math.pi),
    "m/s^2": (-900.0, 2000.0),
    "rad/s": (-90.0, 200.0),
    "Pa": (1e3, 2e5),
    "uT": (-900.0, 5000.0),
    "1": (-90.0, 1e6),
}
# Of these units some values are a little below 0; one of the fills, alone below 0, stands for none.
_FILLS = (-1.0, -9.0, -99.0, -999.0)
_WITH_FILLS = ("ppm", "ppm m", "1")


@dataclass(frozen=True, kw_only=True, eq=False)
class LoggedValues:
    """Values of an instrument: (n,) times, ascending [s], and (n, k) values in the unit of its readings."""

    time_s: Floats
    values: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLog:
    """The poses of one vehicle and the readings of its instruments, by the clock of the log.

    Attributes:
        time_s: (n,) times of the poses, ascending [s].
        position_world_m: (n, 3) [m].
        quaternion_wxyz: (n, 4) world from body, unit length.
        instruments: By the sensor's name in the scenario.
        remarks: What was left out or assumed, as sentences.
    """

    time_s: Floats
    position_world_m: Floats
    quaternion_wxyz: Floats
    instruments: Mapping[str, LoggedValues] = field(default_factory=dict[str, LoggedValues])
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class LoggedSensor:
    """A sensor whose readings a log may have.

    Attributes:
        name: Its name in the scenario.
        parts: The unit of each number of a reading.
        is_estimate: Whether it is computed from another's readings; few logs have it.
    """

    name: str
    parts: tuple[str, ...]
    is_estimate: bool = False

    @property
    def limits(self) -> tuple[str, ...]:
        """What limits each of its numbers: its unit, or `speed` and `range`, which are never below 0."""
        if self.parts == ("m/s", "rad"):
            return ("speed", "rad")
        return tuple("range" if set(self.parts) == {"m"} else part for part in self.parts)

    @property
    def units(self) -> str:
        """The units of its numbers, each once, for messages."""
        return ", ".join(dict.fromkeys(self.parts))


def list_parts(sensor: SensorDescription) -> tuple[str, ...]:
    """Return the unit of each number of a sensor's readings."""
    return _PARTS.get(sensor.unit, (sensor.unit,) * _N_RANGES.get(sensor.model, 1))


def find_unit(words: str) -> tuple[str, float] | None:
    """Return the unit at the end of a name such as `speed_m_s`, and how many of it one is; None where none is known."""
    parts = _plain(words).split("_")
    return next((unit for i in range(len(parts)) if (unit := _SPELLINGS.get("_".join(parts[i:])))), None)


def is_spelling(words: str) -> bool:
    """Return whether words are a unit and nothing else."""
    return _plain(words) in _SPELLINGS


def _plain(words: str) -> str:
    return words.lower().replace("µ", "u").replace("μ", "u").replace("ω", "ohm").replace("/", "_")


@dataclass
class Remarks:
    """What a reader left out or assumed, as sentences."""

    texts: list[str] = field(default_factory=list[str])

    def without_fills(self, name: str, limits: str, values: Floats, place: Callable[[int], str]) -> Floats:
        """Return values with NaN for those that no instrument gives, such as -9999 or 1e300, and remark on them.

        Args:
            limits: What limits them; see `LoggedSensor.limits`.
            values: (n,); NaN where there is none.
        """
        low, high = _LIMITS.get(limits, (-math.inf, math.inf))
        is_wrong = ~np.isnan(values) & ~((values >= low) & (values <= high) & np.isfinite(values))
        below = values[~is_wrong & (values < 0)]
        if limits in _WITH_FILLS and len(below) and below.min() == below.max() and below[0] in _FILLS:
            is_wrong |= values == below[0]
        if is_wrong.any():
            i = int(np.argmax(is_wrong))
            self.texts.append(
                f"{name}: {is_wrong.sum()} of {np.sum(~np.isnan(values))} values are left out, because no {limits} is "
                f"so small or so large, or they stand for none; the first is {values[i]:g} {place(i)}."
            )
        return np.where(is_wrong, np.nan, values)
