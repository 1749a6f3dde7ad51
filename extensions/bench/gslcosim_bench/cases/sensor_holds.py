"""Holds of vehicles after a leg that follow from how quickly their gas sensors respond."""

import math
from collections.abc import Iterable
from typing import Any

from pydantic import TypeAdapter

from gslcosim.scenario import Scenario
from gslcosim.scenario.models.sensors import (
    IDEAL_SUFFIX,
    AveragingSensorSpec,
    MoxSensorSpec,
    PidSensorSpec,
    SecondOrderSensorSpec,
    Sensor,
    SensorSpec,
    TdlasSensorSpec,
)
from gslcosim_services.sensing.models.mox import MOX_PARAMETERS

# A first-order lag shows nine tenths of a step after so many time constants.
_T90_LAGS = math.log(10.0)
_STEP_S = 0.1
_SENSOR: TypeAdapter[SensorSpec] = TypeAdapter(Sensor)


def derive_hold_s(sensors: Iterable[Any]) -> float:
    """Return the hold after which the slowest gas sensor shows nine tenths of a step, in steps of 0.1 s [s].

    Args:
        sensors: Blocks of a scenario's sensors, as it has them or as plain values.

    Held by:
        extensions/bench/tests/unit/cases/test_sensor_holds.py
    """
    specs = [sensor if isinstance(sensor, SensorSpec) else _SENSOR.validate_python(sensor) for sensor in sensors]
    slowest_s = max((response_time_s(spec) for spec in specs), default=0.0)
    return round(math.ceil(slowest_s / _STEP_S - 1e-9) * _STEP_S, 1)


def with_sensor_holds(scenario: Scenario) -> Scenario:
    """Return a scenario whose vehicles hold as long as their own gas sensors take to respond."""
    agents = (
        agent.model_copy(update={"vehicle": agent.vehicle.model_copy(update={"hold_s": derive_hold_s(agent.sensors)})})
        for agent in scenario.agents
    )
    return scenario.model_copy(update={"agents": tuple(agents)})


def response_time_s(sensor: SensorSpec) -> float:
    """Return the time until a gas sensor shows nine tenths of a step up (T90) [s]; 0 of any other sensor.

    A MOX sensor has the lag of its rise, ln 10 times its time constant. Of two lags in series this is the sum of both,
    which is an upper bound. What a reading is late by counts too.
    """
    match sensor:
        case MoxSensorSpec():
            lag_s = _T90_LAGS * MOX_PARAMETERS[sensor.model.removesuffix(IDEAL_SUFFIX)].rise_s
        case PidSensorSpec() | TdlasSensorSpec():
            lag_s = sensor.t90_s
        case AveragingSensorSpec():
            lag_s = 0.9 * sensor.averaging_s
        case SecondOrderSensorSpec():
            lag_s = _T90_LAGS * sum(sensor.response_s)
        case _:
            return 0.0
    return lag_s + sensor.delay_s
