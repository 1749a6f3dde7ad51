"""Paths in the recording: what is drawn and plotted where."""

from dataclasses import dataclass

from gslcosim.recording.colors import Rgb, agent_color
from gslcosim.recording.instruments import Curves, is_of_wind, is_on_board, on_board_curves
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.event_kinds import SourceEventSpec
from gslcosim.scenario.models.onboard import CameraSensorSpec
from gslcosim.scenario.models.scenario import AgentSpec, SensorSpec

FILAMENTS = "gas/filaments"
SLICES = "gas/slices"
WIND = "wind"
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
    """Where one agent and its sensors are drawn."""

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
        """Where it was sent."""
        return f"waypoints/{self.agent.name}"

    @property
    def markers(self) -> str:
        """What happened where."""
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
        """What a sensor sees in space."""
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


def entities_of(scenario: Scenario) -> tuple[AgentEntities, ...]:
    """Return the entities of all agents, in the scenario's order."""
    return tuple(_entities(scenario, agent, agent_color(i)) for i, agent in enumerate(scenario.agents))


def _entities(scenario: Scenario, agent: AgentSpec, color: Rgb) -> AgentEntities:
    on_board = [sensor for sensor in agent.sensors if is_on_board(sensor, scenario)]
    others = [sensor for sensor in agent.sensors if sensor not in on_board]
    return AgentEntities(
        agent=agent,
        color=color,
        gas_sensors=tuple(sensor for sensor in others if not is_of_wind(sensor, scenario)),
        wind_sensors=tuple(sensor for sensor in others if is_of_wind(sensor, scenario)),
        on_board_sensors=tuple((sensor, on_board_curves(sensor, scenario)) for sensor in on_board),
    )


def gases_in(scenario: Scenario) -> tuple[str, ...]:
    """Return the gases of a scenario, the one that is searched for first."""
    searched = scenario.gas.gas
    return tuple(dict.fromkeys([searched, *(source.gas or searched for source in scenario.gas.sources)]))


def source_events(scenario: Scenario) -> list[str]:
    """Return where the events of each source are marked; nothing where no source has any."""
    has_any = any(isinstance(event, SourceEventSpec) for event in scenario.events)
    return [f"sources/{i}/events" for i in range(len(scenario.gas.sources))] if has_any else []
