"""Instruments of a vehicle as a search method sees them: noses, vanes and range finders."""

import math
from dataclasses import dataclass

from gslcosim.base.quantities import ESTIMATE_QUANTITY, POINT_GAS_QUANTITIES, Vec3
from gslcosim.base.scalar_kernels import norm2
from gslcosim.contract.messages import Briefing, Observation, SensorDescription
from gslcosim.methods.card import CAMERA_QUANTITY, RANGE_QUANTITY, WIND_QUANTITY
from gslcosim_search import elementary

# The ending of the name under which the estimate of a MOX sensor comes.
ESTIMATE_ENDING = "_ppm"


@dataclass(frozen=True, kw_only=True)
class Nose:
    """A gas sensor at a point. `unit` is `ohm` (less is more gas), `ppm`, or `1` for detections and hits.

    `estimate` names the mixing ratio that a MOX sensor's reading suggests, where the run offers one.
    """

    name: str
    unit: str
    mount_body_m: Vec3
    estimate: str | None = None

    def value(self, observation: Observation) -> float:
        """Return the reading as it is, in `unit`."""
        return observation.reading(self.name).values[0]

    def is_ready(self, observation: Observation) -> bool:
        """Return True if the sensor measures: it has warmed up."""
        return not observation.reading(self.name).is_warming_up

    def ppm(self, observation: Observation) -> float:
        """Return the mixing ratio [ppm] that the sensor shows or suggests; hits and detections as they are."""
        return observation.reading(self.estimate or self.name).values[0] if self._knows_ppm else self.value(observation)

    def amount(self, observation: Observation) -> float:
        """Return a number that grows with the gas: ppm or hits as they are, the conductance [1/ohm] of a MOX sensor."""
        value = self.value(observation)
        if self.unit != "ohm":
            return value
        return 1.0 / value if value > 0.0 else math.inf

    @property
    def _knows_ppm(self) -> bool:
        return self.unit == "ppm" or self.estimate is not None


@dataclass(frozen=True, kw_only=True)
class Vane:
    """An anemometer: the speed of the wind and the direction it comes from, or its three components."""

    name: str
    is_3d: bool = False

    def is_ready(self, observation: Observation) -> bool:
        """Return True if the sensor measures: it has warmed up."""
        return not observation.reading(self.name).is_warming_up

    def speed_m_s(self, observation: Observation) -> float:
        """Return the speed of the wind [m/s], in the plane."""
        return norm2(*self.wind_world_m_s(observation))

    def upwind_rad(self, observation: Observation) -> float:
        """Return the direction the wind comes from, world frame, counter-clockwise from x [rad]."""
        if not self.is_3d:
            return observation.reading(self.name).values[1]
        x_m_s, y_m_s = self.wind_world_m_s(observation)
        return elementary.atan2(-y_m_s, -x_m_s)

    def wind_world_m_s(self, observation: Observation) -> tuple[float, float]:
        """Return the horizontal wind vector, world frame [m/s]: where the air goes."""
        values = observation.reading(self.name).values
        if self.is_3d:
            return values[0], values[1]
        speed_m_s, upwind_rad = values
        return -speed_m_s * elementary.cos(upwind_rad), -speed_m_s * elementary.sin(upwind_rad)


@dataclass(frozen=True, kw_only=True)
class RangeFinder:
    """A range finder: distances along fixed directions of the body frame."""

    name: str
    directions_body: tuple[Vec3, ...]

    def values_m(self, observation: Observation) -> tuple[float, ...]:
        """Return the distance along each direction [m]."""
        return observation.reading(self.name).values


def find_noses(briefing: Briefing) -> tuple[Nose, ...]:
    """Return the gas sensors at points, in the briefing's order; estimates belong to their sensors."""
    estimates = {sensor.name for sensor in briefing.sensors if sensor.quantity == ESTIMATE_QUANTITY}
    return tuple(
        Nose(
            name=sensor.name,
            unit=sensor.unit,
            mount_body_m=sensor.mount_body_m,
            estimate=sensor.name + ESTIMATE_ENDING if sensor.name + ESTIMATE_ENDING in estimates else None,
        )
        for sensor in briefing.sensors
        if sensor.quantity in POINT_GAS_QUANTITIES
    )


def find_vanes(briefing: Briefing) -> tuple[Vane, ...]:
    """Return the anemometers, in the briefing's order."""
    return tuple(
        Vane(name=sensor.name, is_3d=sensor.unit == "m/s")
        for sensor in briefing.sensors
        if sensor.quantity == WIND_QUANTITY
    )


def find_vane(briefing: Briefing) -> Vane:
    """Return the first anemometer.

    Raises:
        IndexError: there is none; `load_settings` says so in a sentence where the method's card needs one.
    """
    return find_vanes(briefing)[0]


def find_range_finders(briefing: Briefing) -> tuple[RangeFinder, ...]:
    """Return the range finders, in the briefing's order."""
    return tuple(
        RangeFinder(name=sensor.name, directions_body=_directions(sensor))
        for sensor in briefing.sensors
        if sensor.quantity == RANGE_QUANTITY
        and sensor.directions_body is not None
        and len(sensor.directions_body.shape) == 2
    )


def find_cameras(briefing: Briefing) -> tuple[str, ...]:
    """Return the names of the cameras that see colours, in the briefing's order."""
    return tuple(sensor.name for sensor in briefing.sensors if sensor.quantity == CAMERA_QUANTITY)


def _directions(sensor: SensorDescription) -> tuple[Vec3, ...]:
    assert sensor.directions_body is not None
    return tuple((float(x), float(y), float(z)) for x, y, z in sensor.directions_body.to_array())
