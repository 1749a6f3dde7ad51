"""Paths in the recording: what is drawn and plotted where."""

from dataclasses import dataclass

from gslcosim.recording.colors import Rgb, agent_color
from gslcosim.scenario import Scenario
from gslcosim.scenario.models import AgentSpec
from gslcosim.scenario.sensor_models import CAMERA_SENSORS, ON_BOARD_SENSORS

FILAMENTS = "gas/filaments"
SLICES = "gas/slices"
WIND = "wind"
EVENTS = "events"
RADIO = "radio"
SUMMARY = "summary"

GAS_PLOTS = "plots/gas_ppm"
RESPONSE_PLOTS = "plots/response"
WIND_PLOTS = "plots/wind_m_s"
DISTANCE_PLOTS = "plots/distance_m"
TRACKING_PLOTS = "plots/tracking_error_m"

# Instruments that report the wind: speed [m/s] first.
WIND_MODELS = frozenset({"anemometer"})
# Sensors whose first value is no curve beside those of gas.
NOT_GAS_MODELS = WIND_MODELS | frozenset(ON_BOARD_SENSORS)
LIDAR_MODELS = frozenset({"lidar_2d", "lidar_3d"})
CAMERA_MODELS = frozenset(CAMERA_SENSORS)
# Figaro's metal oxide sensors: they report their resistance.
RESISTIVE_MODELS = "tgs"


@dataclass(frozen=True)
class AgentEntities:
    """Where one agent is drawn."""

    agent: AgentSpec
    color: Rgb

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
    def tracking_error(self) -> str:
        """Curve of the distance to where the controller wants the vehicle."""
        return f"{TRACKING_PLOTS}/{self.agent.name}"

    def on_board(self, sensor: str) -> str:
        """What an on-board sensor sees, in the frame of the vehicle."""
        return f"{self.vehicle}/{sensor}"

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

    @property
    def gas_sensors(self) -> tuple[str, ...]:
        """Names of the instruments that report gas."""
        return tuple(sensor.name for sensor in self.agent.sensors if sensor.model not in NOT_GAS_MODELS)

    @property
    def wind_sensors(self) -> tuple[str, ...]:
        """Names of the instruments that report the wind."""
        return tuple(sensor.name for sensor in self.agent.sensors if sensor.model in WIND_MODELS)


def entities_of(scenario: Scenario) -> tuple[AgentEntities, ...]:
    """Return the entities of all agents, in the scenario's order."""
    return tuple(AgentEntities(agent, agent_color(i)) for i, agent in enumerate(scenario.agents))
