"""Sensors of a scenario: their kinds, gases of its own included, and their descriptions for agents."""

import numpy as np

from gslcosim.contract.messages import SensorDescription
from gslcosim.contract.record import NumericArray
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.sensor_base import RaySensorSpec, TurnedSensorSpec
from gslcosim_services.sensing.models import SensorKind, sensor_kind
from gslcosim_services.sensing.models.base import estimate_name
from gslcosim_services.sensing.models.mox import ESTIMATE_QUANTITY, ESTIMATE_UNIT
from gslcosim_services.sensing.models.range_finders import ray_directions_body


def find_sensor_kind(scenario: Scenario, model: str) -> SensorKind:
    """Return a sensor model as it is in a scenario that may define gases of its own.

    Raises:
        ScenarioError: there is no such model.
    """
    kind, definitions = sensor_kind(model), scenario.gas.define
    return kind.for_gases(definitions) if definitions and kind.for_gases else kind


def describe_sensors(agent: AgentSpec, scenario: Scenario) -> tuple[SensorDescription, ...]:
    """Describe an agent's sensors to it: first those it has, then the estimates from their readings."""
    kinds = [(sensor, find_sensor_kind(scenario, sensor.model)) for sensor in agent.sensors]
    sensors = tuple(
        SensorDescription(
            name=sensor.name,
            model=sensor.model,
            quantity=kind.quantity,
            unit=kind.unit,
            mount_body_m=sensor.mount_m,
            mount_rpy_rad=sensor.mount_rpy_rad if isinstance(sensor, TurnedSensorSpec) else (0.0, 0.0, 0.0),
            directions_body=_ray_directions(sensor) if isinstance(sensor, RaySensorSpec) else None,
        )
        for sensor, kind in kinds
    )
    estimates = tuple(
        SensorDescription(
            name=estimate_name(sensor.name),
            model=sensor.model,
            quantity=ESTIMATE_QUANTITY,
            unit=ESTIMATE_UNIT,
            mount_body_m=sensor.mount_m,
        )
        for sensor, kind in kinds
        if kind.estimator and kind.estimator(scenario.gas.gas)
    )
    return sensors + estimates


def _ray_directions(sensor: RaySensorSpec) -> NumericArray:
    return NumericArray.from_array(ray_directions_body(sensor).astype(np.float32))
