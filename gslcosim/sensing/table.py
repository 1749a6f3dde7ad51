"""The sensors of a scenario as rows of the table, and as agents are told of them."""

import numpy as np

from gslcosim.contract.arrays import NumericArray
from gslcosim.contract.messages import SensorDescription
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.sensor_base import RaySensorSpec, TurnedSensorSpec
from gslcosim.sensing.models import SensorKind, sensor_kind
from gslcosim.sensing.models.base import estimate_name
from gslcosim.sensing.models.mox import ESTIMATE_QUANTITY, ESTIMATE_UNIT
from gslcosim.sensing.models.ranging import directions_body


def kind_in(scenario: Scenario, model: str) -> SensorKind:
    """Return a sensor model as it is in a scenario that may define gases of its own.

    Raises:
        ScenarioError: there is no such model.
    """
    kind, definitions = sensor_kind(model), scenario.gas.define
    return kind.for_gases(definitions) if definitions and kind.for_gases else kind


def descriptions_of(agent: AgentSpec, scenario: Scenario) -> tuple[SensorDescription, ...]:
    """Return what an agent is told of its sensors: first those it has, then what is estimated from their readings."""
    kinds = [(sensor, kind_in(scenario, sensor.model)) for sensor in agent.sensors]
    sensors = tuple(
        SensorDescription(
            name=sensor.name,
            model=sensor.model,
            quantity=kind.quantity,
            unit=kind.unit,
            mount_body_m=sensor.mount_m,
            mount_rpy_rad=sensor.mount_rpy_rad if isinstance(sensor, TurnedSensorSpec) else (0.0, 0.0, 0.0),
            directions_body=_directions(sensor) if isinstance(sensor, RaySensorSpec) else None,
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


def _directions(sensor: RaySensorSpec) -> NumericArray:
    return NumericArray.from_array(directions_body(sensor).astype(np.float32))
