"""Sensors of each agent by their streams, and the paths of the agent's streams in the recording."""

from dataclasses import dataclass

from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec, SensorSpec
from gslcosim.scenario.models.sensors import CameraSensorSpec
from gslcosim_services.recorder.colors import Rgb, agent_color
from gslcosim_services.recorder.stream_table import ON_BOARD_STREAMS, Stream, on_board_stream
from gslcosim_services.sensing.briefing import find_sensor_kind
from gslcosim_services.sensing.models.anemometer import QUANTITY as WIND

# Units as messages have them, and as people read them.
_SHOWN_UNITS = {"1": "", "ohm": "Ω", "m/s^2": "m/s²", "uT": "µT", "ppm m": "ppm·m"}


def list_on_board_streams(sensor: SensorSpec, scenario: Scenario) -> tuple[Stream, ...]:
    """Return the streams of an on-board sensor's values; of those of other packages all values are one."""
    kind = find_sensor_kind(scenario, sensor.model)
    return ON_BOARD_STREAMS.get(sensor.model, (on_board_stream(kind.quantity, kind.unit),))


def is_on_board(sensor: SensorSpec, scenario: Scenario) -> bool:
    """Return whether a sensor measures the vehicle and its surroundings, not gas or wind."""
    return find_sensor_kind(scenario, sensor.model).is_on_board


def is_wind_sensor(sensor: SensorSpec, scenario: Scenario) -> bool:
    """Return whether a sensor reports the wind."""
    return find_sensor_kind(scenario, sensor.model).quantity == WIND


def get_unit(sensor: SensorSpec, scenario: Scenario) -> str:
    """Return the unit of a sensor's readings, as messages have it."""
    return find_sensor_kind(scenario, sensor.model).unit


def label_with_unit(title: str, unit: str) -> str:
    """Return a title with its unit, as people read it; without one for pure numbers."""
    shown = _SHOWN_UNITS.get(unit, unit)
    return f"{title} [{shown}]" if shown else title


@dataclass(frozen=True)
class AgentEntities:
    """Sensors of one agent, and the paths of its streams.

    Attributes:
        bearing_sensors: Names of the anemometers that report speed and direction; the others report a vector.
        on_board_sensors: Each with the streams of its values.
    """

    agent: AgentSpec
    color: Rgb
    gas_sensors: tuple[SensorSpec, ...]
    wind_sensors: tuple[SensorSpec, ...]
    bearing_sensors: frozenset[str]
    on_board_sensors: tuple[tuple[SensorSpec, tuple[Stream, ...]], ...]

    @property
    def cameras(self) -> tuple[CameraSensorSpec, ...]:
        """Its cameras."""
        return tuple(sensor for sensor, _ in self.on_board_sensors if isinstance(sensor, CameraSensorSpec))

    def at(self, stream: Stream, **names: str) -> str:
        """Return the path of one of the agent's streams; `names` are those of the sensor and the gas."""
        return stream.at(agent=self.agent.name, **names)


def build_entities(scenario: Scenario) -> tuple[AgentEntities, ...]:
    """Return the entities of all agents, in the scenario's order."""
    return tuple(_build_agent_entities(scenario, agent, agent_color(i)) for i, agent in enumerate(scenario.agents))


def _build_agent_entities(scenario: Scenario, agent: AgentSpec, color: Rgb) -> AgentEntities:
    on_board = [sensor for sensor in agent.sensors if is_on_board(sensor, scenario)]
    others = [sensor for sensor in agent.sensors if sensor not in on_board]
    wind_sensors = tuple(sensor for sensor in others if is_wind_sensor(sensor, scenario))
    return AgentEntities(
        agent=agent,
        color=color,
        gas_sensors=tuple(sensor for sensor in others if not is_wind_sensor(sensor, scenario)),
        wind_sensors=wind_sensors,
        bearing_sensors=frozenset(each.name for each in wind_sensors if get_unit(each, scenario).endswith("rad")),
        on_board_sensors=tuple((sensor, list_on_board_streams(sensor, scenario)) for sensor in on_board),
    )


def list_gas_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the gases of a scenario, the one that is searched for first."""
    searched = scenario.gas.gas
    return tuple(dict.fromkeys([searched, *(source.gas or searched for source in scenario.gas.sources)]))
