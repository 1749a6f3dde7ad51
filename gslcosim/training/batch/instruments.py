"""Instruments of a case as records for the kernels."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import NS_PER_S, ticks_from_seconds
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas_sensors import (
    Anemometer3dSpec,
    AnemometerSpec,
    AveragingSensorSpec,
    HitCounterSpec,
    PidSensorSpec,
    SecondOrderSensorSpec,
    ThresholdSensorSpec,
)
from gslcosim.scenario.models.onboard_sensors import BumpSensorSpec, FourRangeFindersSpec, RangeFinderSpec
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.sensor_base import MeasuringSensorSpec, NoisySensorSpec, SensorSpec
from gslcosim.training.batch import batch_records as records
from gslcosim_services.sensing.models.base import SensorKind, estimate_name
from gslcosim_services.sensing.models.gas_sensors import PID_CORRECTION, two_lag_remainder
from gslcosim_services.sensing.models.mox import MOX_PARAMETERS, MoxParameters, add_gases
from gslcosim_services.sensing.models.range_finders import ray_directions_body
from gslcosim_services.sensing.sensor_descriptions import find_sensor_kind

ELSE = "Change it, or fly single environments of gslcosim/Search-v0."


class BatchInstruments:
    """The sensors of one agent as records of `INSTRUMENT`, the places where they are, and their streams' names.

    `n_memory` is how many numbers a search keeps of their samples of late.

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
        self._tick_s = scenario.tick_ns / NS_PER_S
        self.n_memory = 0
        self.rows = np.zeros(len(agent.sensors), records.INSTRUMENT)
        self.names = b""
        places: dict[Vec3, int] = {}
        for row, sensor in zip(self.rows, agent.sensors, strict=True):
            name = f"sensing.{agent.name}.{sensor.name}".encode()
            row["first_name"], row["n_name"] = first_name + len(self.names), len(name)
            self.names += name
            row["place"] = places.setdefault(sensor.mount_m, len(places))
            self._fill(row, sensor, find_sensor_kind(scenario, sensor.model))
        self.places_m: NDArray[np.float64] = np.array(list(places), np.float64).reshape(-1, 3)

    def _fill(self, row: Any, sensor: SensorSpec, kind: SensorKind) -> None:
        self._fill_errors(row, sensor, kind)
        row["mount_m"] = sensor.mount_m
        if sensor.model in MOX_PARAMETERS:
            self._as(row, sensor, records.MOX, records.LOG_RESISTANCE, "log_resistance")
            parameters = add_gases(MOX_PARAMETERS[sensor.model], self._scenario.gas.define)
            self._fill_mox(row, sensor, kind, parameters)
        elif isinstance(sensor, AnemometerSpec):
            self._as(row, sensor, records.ANEMOMETER, records.PLANAR_WIND, "speed", (2, 3))
            row["speed_noise"], row["direction_noise"] = sensor.speed_noise_std_m_s, sensor.direction_noise_std_rad
        elif isinstance(sensor, Anemometer3dSpec):
            self._as(row, sensor, records.ANEMOMETER_3D, records.SPEEDS, "x", (3, 3))
            row["speed_noise"] = sensor.speed_noise_std_m_s
        elif isinstance(sensor, RangeFinderSpec | FourRangeFindersSpec):
            self._fill_ranges(row, sensor)
        elif isinstance(sensor, BumpSensorSpec):
            self._as(row, sensor, records.BUMP, records.PLAIN, "contact")
            self._keep(row, sensor.period_s or self._tick_s)
        else:
            self._fill_ppm(row, sensor, kind)
        row["n_with_errors"] = row["n_values"] if kind.n_with_errors is None else kind.n_with_errors
        if sensor.delay_s:
            self._delay(row, sensor, kind)

    # `n`: how many values, and numbers that they become.
    def _as(
        self, row: Any, sensor: SensorSpec, kind: int, numbers: int, first: str, n: tuple[int, int] = (1, 1)
    ) -> None:
        row["kind"], row["numbers"], row["n_values"], row["n_numbers"] = kind, numbers, *n
        row["first_number"] = self._numbers.index(f"{sensor.name}.{first}")
        row["first_memory"] = self.n_memory

    def _keep(self, row: Any, kept_s: float) -> None:
        row["n_kept"] = max(1, round(kept_s / self._tick_s))
        self.n_memory += int(row["n_kept"])

    def _delay(self, row: Any, sensor: SensorSpec, kind: SensorKind) -> None:
        if kind.is_on_board:
            raise UsageError(
                f"agents[0].sensors: delay_s: expected 0 in a batch for a {sensor.model}, was {sensor.delay_s:g}. "
                f"{ELSE}"
            )
        row["delay_ticks"] = ticks_from_seconds(sensor.delay_s, self._scenario.tick_ns)
        self.n_memory += (int(row["delay_ticks"]) + 1) * records.SAMPLE_LENGTH

    def _fill_ranges(self, row: Any, sensor: RangeFinderSpec | FourRangeFindersSpec) -> None:
        directions = ray_directions_body(sensor)
        n = len(directions)
        self._as(row, sensor, records.RANGES, records.CLOSENESS, "closeness_0", (n, n))
        row["directions"][:n] = directions
        row["max_range_m"], row["own_noise"] = sensor.max_range_m, sensor.noise_std

    def _fill_ppm(self, row: Any, sensor: SensorSpec, kind: SensorKind) -> None:
        match sensor:
            case PidSensorSpec():
                self._as(row, sensor, records.PID, records.AMOUNT, "amount")
                given = {g.name: g.pid_correction for g in self._scenario.gas.define if g.pid_correction is not None}
                correction = {**PID_CORRECTION, **given}
                row["weight"][: len(self._gases)] = [correction.get(gas, 0.0) for gas in self._gases]
            case ThresholdSensorSpec():
                is_binary = sensor.model == "binary"
                numbers, first = (records.PLAIN, "gas") if is_binary else (records.AMOUNT, "amount")
                self._as(row, sensor, records.BINARY if is_binary else records.THRESHOLD, numbers, first)
                row["threshold_ppm"], row["own_noise"] = sensor.threshold_ppm, sensor.noise_std
            case HitCounterSpec():
                self._as(row, sensor, records.HITS, records.COUNT, "hits")
                row["hits_per_ppm"] = sensor.hits_per_s_per_ppm * self._tick_s
                self._keep(row, sensor.period_s or self._tick_s)
            case AveragingSensorSpec():
                self._as(row, sensor, records.AVERAGING, records.AMOUNT, "amount")
                self._keep(row, sensor.averaging_s)
            case SecondOrderSensorSpec():
                self._as(row, sensor, records.SECOND_ORDER, records.AMOUNT, "amount")
                row["response"] = two_lag_remainder(*sensor.response_s, self._tick_s)
                row["recovery"] = two_lag_remainder(*sensor.recovery_s, self._tick_s)
            case _:
                raise UsageError(
                    f"agents[0].sensors: model: expected a sensor of gas, wind or ranges in a batch, was {kind.name}. "
                    f"{ELSE}"
                )

    def _fill_mox(self, row: Any, sensor: SensorSpec, kind: SensorKind, parameters: MoxParameters) -> None:
        row["r0_ohm"], row["air_ratio"] = parameters.r0_ohm, parameters.air_ratio
        row["rise_frac"] = -math.expm1(-self._tick_s / parameters.rise_s)
        row["decay_frac"] = -math.expm1(-self._tick_s / parameters.decay_s)
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
