"""The sensors of a case as records for the kernels."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import UsageError
from gslcosim.quantities import Vec3
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas_sensors import AnemometerSpec
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.sensor_base import MeasuringSensorSpec, NoisySensorSpec, SensorSpec
from gslcosim.sensing.models.base import SensorKind, estimate_name
from gslcosim.sensing.models.mox import MOX_PARAMETERS, MoxParameters, with_gases
from gslcosim.sensing.table import kind_in
from gslcosim.ticks import NS_PER_S, ticks_from_seconds
from gslcosim.training.batch import batch_records as records


class BatchInstruments:
    """The sensors of one agent as records of `INSTRUMENT`, the places where they are, and their streams' names.

    Args:
        agent: The agent.
        scenario: Its scenario.
        gases: Names of the gases, in the order of the field's columns.
        numbers: Names of the numbers of an observation, in order.
        first_name: Where the names of its streams begin among those of all cases.
    """

    def __init__(
        self, agent: AgentSpec, scenario: Scenario, gases: tuple[str, ...], numbers: tuple[str, ...], first_name: int
    ) -> None:
        self._scenario = scenario
        self._gases = gases
        self._numbers = numbers
        self.rows = np.zeros(len(agent.sensors), records.INSTRUMENT)
        self.names = b""
        places: dict[Vec3, int] = {}
        for row, sensor in zip(self.rows, agent.sensors, strict=True):
            name = f"sensing.{agent.name}.{sensor.name}".encode()
            row["first_name"], row["n_name"] = first_name + len(self.names), len(name)
            self.names += name
            row["place"] = places.setdefault(sensor.mount_m, len(places))
            self._fill(row, sensor, kind_in(scenario, sensor.model))
        self.places_m: NDArray[np.float64] = np.array(list(places), np.float64).reshape(-1, 3)

    def _fill(self, row: Any, sensor: SensorSpec, kind: SensorKind) -> None:
        tick_ns = self._scenario.tick_ns
        self._fill_errors(row, sensor, kind)
        if sensor.model in MOX_PARAMETERS:
            row["kind"], row["numbers"], row["n_values"] = records.MOX, records.LOG_RESISTANCE, 1
            row["first_number"] = self._numbers.index(f"{sensor.name}.log_resistance")
            parameters = with_gases(MOX_PARAMETERS[sensor.model], self._scenario.gas.define)
            self._fill_mox(row, sensor, kind, parameters, tick_ns / NS_PER_S)
        elif isinstance(sensor, AnemometerSpec):
            row["kind"], row["numbers"], row["n_values"] = records.ANEMOMETER, records.PLANAR_WIND, 2
            row["first_number"] = self._numbers.index(f"{sensor.name}.speed")
            row["speed_noise"] = sensor.speed_noise_std_m_s
            row["direction_noise"] = sensor.direction_noise_std_rad
        else:
            raise UsageError(
                f"agents[].sensors[].model: expected sensors that can be batched (tgs2600, anemometer …), was "
                f"{sensor.model}. Take another, or fly single environments of gslcosim/Search-v0."
            )
        row["n_with_errors"] = row["n_values"] if kind.n_with_errors is None else kind.n_with_errors

    def _fill_mox(
        self, row: Any, sensor: SensorSpec, kind: SensorKind, parameters: MoxParameters, tick_s: float
    ) -> None:
        row["r0_ohm"], row["air_ratio"] = parameters.r0_ohm, parameters.air_ratio
        row["rise_frac"] = -math.expm1(-tick_s / parameters.rise_s)
        row["decay_frac"] = -math.expm1(-tick_s / parameters.decay_s)
        for g, gas in enumerate(self._gases):
            row["law_a"][g], row["law_b"][g] = parameters.power_law.get(gas, (0.0, 0.0))
        gas = self._scenario.gas.gas
        if kind.estimator is not None and kind.estimator(gas) is not None:
            row["has_estimate"] = 1
            row["estimate_a"], row["estimate_b"] = parameters.power_law[gas]
            row["estimate_number"] = self._numbers.index(f"{estimate_name(sensor.name)}.amount")

    def _fill_errors(self, row: Any, sensor: SensorSpec, kind: SensorKind) -> None:
        tick_ns = self._scenario.tick_ns
        row["max_value"], row["least_value"] = math.inf, kind.least_value
        row["period_ticks"] = ticks_from_seconds(sensor.period_s, tick_ns) if sensor.period_s else 1
        row["warm_up_ticks"] = ticks_from_seconds(sensor.warm_up_s, tick_ns)
        if isinstance(sensor, NoisySensorSpec) and not kind.has_own_noise:
            row["noise_std"] = sensor.noise_std
        if isinstance(sensor, MeasuringSensorSpec):
            row["bias"], row["drift_per_s"] = sensor.bias, sensor.drift_per_s
            row["max_value"] = math.inf if sensor.max_value is None else sensor.max_value
        is_off = sensor.period_s is None and not (sensor.delay_s or sensor.warm_up_s)
        is_exact = not (row["noise_std"] or row["bias"] or row["drift_per_s"]) and math.isinf(row["max_value"])
        row["has_errors"] = not (is_off and is_exact)
