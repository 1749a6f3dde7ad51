"""Entities of the recording: paths of what is drawn and plotted, and the curves of each sensor's readings."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gslcosim.contract.messages import Reading
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import SourceEventSpec
from gslcosim.scenario.models.scenario import AgentSpec, SensorSpec
from gslcosim.scenario.models.sensors import CameraSensorSpec
from gslcosim_services.recorder.colors import AXES, Rgb, agent_color
from gslcosim_services.sensing.briefing import find_sensor_kind
from gslcosim_services.sensing.models.anemometer import QUANTITY as WIND

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


def list_on_board_curves(sensor: SensorSpec, scenario: Scenario) -> tuple[Curves, ...]:
    """Return the curves of an on-board sensor; of those of other packages all values in one plot."""
    kind = find_sensor_kind(scenario, sensor.model)
    return ON_BOARD_CURVES.get(sensor.model, (Curves(quantity=kind.quantity, unit=kind.unit),))


def is_on_board(sensor: SensorSpec, scenario: Scenario) -> bool:
    """Return whether a sensor looks at the vehicle and what is around it, not at gas or wind."""
    return find_sensor_kind(scenario, sensor.model).is_on_board


def is_wind_sensor(sensor: SensorSpec, scenario: Scenario) -> bool:
    """Return whether a sensor reports the wind."""
    return find_sensor_kind(scenario, sensor.model).quantity == WIND


def get_unit(sensor: SensorSpec, scenario: Scenario) -> str:
    """Return the unit of a sensor's readings, as messages have it."""
    return find_sensor_kind(scenario, sensor.model).unit


def wind_speed_m_s(reading: Reading) -> Sequence[float]:
    """Return the speed that an anemometer reports: its first value before a direction, else the length of all."""
    return reading.values[:1] if reading.unit.endswith("rad") else (math.hypot(*reading.values),)


def label_with_unit(title: str, unit: str) -> str:
    """Return a title with its unit behind, as people read it; nothing behind pure numbers."""
    shown = _SHOWN_UNITS.get(unit, unit)
    return f"{title} [{shown}]" if shown else title


FILAMENTS = "gas/filaments"
SLICES = "gas/slices"
WIND_ARROWS = "wind"
EVENTS = "events"
CONTACTS = "contacts"
RADIO = "radio"
FAULTS = "faults"
SUMMARY = "summary"
LEGEND = "legend"
SEEN = "seen"
MESHES = "room/geometry"
DOORS = "room/doors"
BELIEFS = "beliefs"

GAS_PLOTS = "plots/gas_ppm"
RESPONSE_PLOTS = "plots/response"
WIND_PLOTS = "plots/wind_m_s"
DISTANCE_PLOTS = "plots/distance_m"
BELIEF_PLOTS = "plots/belief_frac"
TRACKING_PLOTS = "plots/tracking_error_m"
DECISION_PLOTS = "plots/decision_ms"
ON_BOARD_PLOTS = "plots/on_board"
SERVICE_PLOTS = "plots/services"


@dataclass(frozen=True)
class AgentEntities:
    """Entities of one agent and its sensors."""

    agent: AgentSpec
    color: Rgb
    gas_sensors: tuple[SensorSpec, ...]
    wind_sensors: tuple[SensorSpec, ...]
    on_board_sensors: tuple[tuple[SensorSpec, tuple[Curves, ...]], ...]

    @property
    def vehicle(self) -> str:
        """The moving vehicle."""
        return f"vehicles/{self.agent.name}"

    @property
    def track(self) -> str:
        """The line that it leaves."""
        return f"tracks/{self.agent.name}"

    @property
    def plan(self) -> str:
        """The paths that it planned around obstacles."""
        return f"plans/{self.agent.name}"

    @property
    def waypoints(self) -> str:
        """Waypoints that it was given."""
        return f"waypoints/{self.agent.name}"

    @property
    def markers(self) -> str:
        """Marks of its events in the room."""
        return f"markers/{self.agent.name}"

    @property
    def distance(self) -> str:
        """Curve of the distance to the nearest source."""
        return f"{DISTANCE_PLOTS}/{self.agent.name}"

    @property
    def belief(self) -> str:
        """Picture of where it believes the source to be."""
        return f"{BELIEFS}/{self.agent.name}"

    @property
    def belief_mass(self) -> str:
        """Curve of the probability that its belief gives to the surroundings of the source."""
        return f"{BELIEF_PLOTS}/{self.agent.name}"

    @property
    def belief_distance(self) -> str:
        """Curve of the mean distance of the believed places to the nearest source."""
        return f"{self.distance}/belief"

    @property
    def tracking_error(self) -> str:
        """Curve of the distance to where the controller wants the vehicle."""
        return f"{TRACKING_PLOTS}/{self.agent.name}"

    @property
    def decision(self) -> str:
        """Curve of how long it took for its decisions, by the clock."""
        return f"{DECISION_PLOTS}/{self.agent.name}"

    @property
    def cameras(self) -> tuple[CameraSensorSpec, ...]:
        """Its cameras."""
        return tuple(sensor for sensor, _ in self.on_board_sensors if isinstance(sensor, CameraSensorSpec))

    def seen(self, sensor: str) -> str:
        """View of a sensor in space."""
        return f"{SEEN}/{self.agent.name}/{sensor}"

    def gas(self, sensor: str, gas: str) -> str:
        """Curve of the true mixing ratio at a sensor."""
        return f"{GAS_PLOTS}/{self.agent.name}/{sensor}/{gas}"

    def response(self, sensor: str) -> str:
        """Curve of what a gas sensor reports."""
        return f"{RESPONSE_PLOTS}/{self.agent.name}/{sensor}"

    def true_wind(self, sensor: str) -> str:
        """Curve of the true wind speed at a sensor."""
        return f"{WIND_PLOTS}/{self.agent.name}/{sensor}/true"

    def measured_wind(self, sensor: str) -> str:
        """Curve of the wind speed that an anemometer reports."""
        return f"{WIND_PLOTS}/{self.agent.name}/{sensor}/measured"

    def on_board(self, sensor: str, curves: Curves) -> str:
        """Curves of an on-board sensor."""
        return f"{ON_BOARD_PLOTS}/{self.agent.name}/{sensor}/{curves.entity}"


def build_entities(scenario: Scenario) -> tuple[AgentEntities, ...]:
    """Return the entities of all agents, in the scenario's order."""
    return tuple(_build_agent_entities(scenario, agent, agent_color(i)) for i, agent in enumerate(scenario.agents))


def _build_agent_entities(scenario: Scenario, agent: AgentSpec, color: Rgb) -> AgentEntities:
    on_board = [sensor for sensor in agent.sensors if is_on_board(sensor, scenario)]
    others = [sensor for sensor in agent.sensors if sensor not in on_board]
    return AgentEntities(
        agent=agent,
        color=color,
        gas_sensors=tuple(sensor for sensor in others if not is_wind_sensor(sensor, scenario)),
        wind_sensors=tuple(sensor for sensor in others if is_wind_sensor(sensor, scenario)),
        on_board_sensors=tuple((sensor, list_on_board_curves(sensor, scenario)) for sensor in on_board),
    )


def list_gas_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the gases of a scenario, the one that is searched for first."""
    searched = scenario.gas.gas
    return tuple(dict.fromkeys([searched, *(source.gas or searched for source in scenario.gas.sources)]))


def source_events(scenario: Scenario) -> list[str]:
    """Return where the events of each source are marked; nothing where no source has any."""
    has_any = any(isinstance(event, SourceEventSpec) for event in scenario.events)
    return [f"sources/{i}/events" for i in range(len(scenario.gas.sources))] if has_any else []
