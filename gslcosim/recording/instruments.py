"""Which values of a sensor's readings are drawn as curves, together with which, and under which title."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gslcosim.contract.messages import Reading
from gslcosim.recording.colors import AXES, Rgb, agent_color
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import SensorSpec
from gslcosim.sensing.models.anemometer import QUANTITY as WIND
from gslcosim.sensing.table import kind_in

XYZ = ("x", "y", "z")
# Units as they are written in messages, and as people read them.
_SHOWN_UNITS = {"1": "", "ohm": "Ω", "m/s^2": "m/s²", "uT": "µT", "ppm m": "ppm·m"}


@dataclass(frozen=True, kw_only=True)
class Curves:
    """Some of the values of a sensor's readings: those from `first` on, as many as there are labels (none: all)."""

    quantity: str
    unit: str
    labels: tuple[str, ...] = ()
    first: int = 0

    @property
    def entity(self) -> str:
        """The last part of their path."""
        return self.quantity.replace(" ", "_")

    @property
    def colors(self) -> list[Rgb]:
        """A colour for each label: red, green and blue for x, y and z."""
        return [AXES.get(label, agent_color(i)) for i, label in enumerate(self.labels)]

    def values_of(self, reading: Reading) -> Sequence[float]:
        """Return what is drawn of a reading."""
        return reading.values[self.first : self.first + len(self.labels) or None]


ON_BOARD_CURVES: dict[str, tuple[Curves, ...]] = {
    "imu": (
        Curves(quantity="specific force", unit="m/s^2", labels=XYZ),
        Curves(quantity="angular velocity", unit="rad/s", labels=XYZ, first=3),
    ),
    "gps": (
        Curves(quantity="position", unit="m", labels=XYZ),
        Curves(quantity="velocity", unit="m/s", labels=XYZ, first=3),
    ),
    "barometer": (Curves(quantity="pressure", unit="Pa", labels=("pressure",)),),
    "magnetometer": (Curves(quantity="magnetic field", unit="uT", labels=XYZ),),
    "pose": (
        Curves(quantity="position", unit="m", labels=XYZ),
        Curves(quantity="attitude quaternion", unit="1", labels=("w", *XYZ), first=3),
        Curves(quantity="velocity", unit="m/s", labels=XYZ, first=7),
    ),
    "range_finder": (Curves(quantity="range", unit="m", labels=("range",)),),
    "four_range_finders": (Curves(quantity="ranges", unit="m", labels=("front", "left", "back", "right")),),
    "lidar_2d": (Curves(quantity="least range", unit="m", labels=("least",)),),
    "lidar_3d": (Curves(quantity="least range", unit="m", labels=("least",)),),
    "bump": (Curves(quantity="contact", unit="1", labels=("contact",)),),
    "camera": (),
    "depth_camera": (),
}


def on_board_curves(sensor: SensorSpec, scenario: Scenario) -> tuple[Curves, ...]:
    """Return the curves of an on-board sensor; of those of other packages all values in one plot."""
    kind = kind_in(scenario, sensor.model)
    return ON_BOARD_CURVES.get(sensor.model, (Curves(quantity=kind.quantity, unit=kind.unit),))


def is_on_board(sensor: SensorSpec, scenario: Scenario) -> bool:
    """Return whether a sensor looks at the vehicle and what is around it, not at gas or wind."""
    return kind_in(scenario, sensor.model).is_on_board


def is_of_wind(sensor: SensorSpec, scenario: Scenario) -> bool:
    """Return whether a sensor reports the wind."""
    return kind_in(scenario, sensor.model).quantity == WIND


def unit_of(sensor: SensorSpec, scenario: Scenario) -> str:
    """Return the unit of a sensor's readings, as messages have it."""
    return kind_in(scenario, sensor.model).unit


def wind_speed_m_s(reading: Reading) -> Sequence[float]:
    """Return the speed that an anemometer reports: its first value before a direction, else the length of all."""
    return reading.values[:1] if reading.unit.endswith("rad") else (math.hypot(*reading.values),)


def with_unit(title: str, unit: str) -> str:
    """Return a title with its unit behind, as people read it; nothing behind pure numbers."""
    shown = _SHOWN_UNITS.get(unit, unit)
    return f"{title} [{shown}]" if shown else title
