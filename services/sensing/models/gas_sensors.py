"""Gas sensors of the mixing ratio: PID, threshold, binary, hit counter, averaging, second order, TDLAS.

All respond to the sum of all gases, except for the PID, which weighs them.
"""

import math
from collections import deque

import numpy as np

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import MountSample, Reading
from gslcosim.scenario.models.gas import GasDefinition
from gslcosim.scenario.models.sensors import (
    SENSOR_BLOCKS,
    AveragingSensorSpec,
    HitCounterSpec,
    PidSensorSpec,
    SecondOrderSensorSpec,
    TdlasSensorSpec,
    ThresholdSensorSpec,
)
from gslcosim_services.sensing.models.base import SensorKind, SensorModel, new_reading

# Correction factors at 11.7 eV; what is not in the table is not ionised.
PID_CORRECTION = {"ethanol": 10.47, "propanol": 2.7, "chlorine": 1.0, "acetone": 1.4}


def total_ppm(sample: MountSample) -> float:
    """Return the mixing ratio of all gases together [ppm]."""
    return math.fsum(gas.mixing_ratio_ppm for gas in sample.gases)


class PidSensor:
    """A photo-ionisation detector (miniRAE Lite): at once, without noise of its own.

    reading = sum over gases of c / CF [ppm]      CF correction factor of each gas

    State: none. Source: GADEN, simulated_gas_sensor/src/fake_gas_sensor.cpp.
    Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """

    def __init__(self, spec: PidSensorSpec, correction: dict[str, float]) -> None:
        self._sensor = spec.name
        self._correction = correction

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the reading [ppm]; see `SensorModel.read`."""
        del mount_velocity_world_m_s
        correction = self._correction
        seen = (g.mixing_ratio_ppm / correction[g.gas] for g in sample.gases if g.gas in correction)
        return _ppm_reading(self._sensor, math.fsum(seen))


class ThresholdSensor:
    """Reads the mixing ratio where it exceeds a threshold, and 0 elsewhere.

    S = c for c > threshold, else 0; with `noise_std` in the scenario, c + e (thesis eq. 5.2). State: none.
    Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """

    def __init__(self, spec: ThresholdSensorSpec, rng: np.random.Generator) -> None:
        self._spec = spec
        self._rng = rng

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the reading [ppm]; see `SensorModel.read`. Draws one number a tick."""
        del mount_velocity_world_m_s
        noise_ppm = self._spec.noise_std * float(self._rng.standard_normal())
        ppm = total_ppm(sample)
        return _ppm_reading(self._spec.name, max(0.0, ppm + noise_ppm) if ppm > self._spec.threshold_ppm else 0.0)


class BinarySensor:
    """Detector of a mixing ratio, with noise, above a threshold: 1 or 0.

    hit = c + N(0, noise_std) > threshold      noise_std [ppm], so that there are misses and false alarms

    State: none. Draws one number a tick. Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """

    def __init__(self, spec: ThresholdSensorSpec, rng: np.random.Generator) -> None:
        self._spec = spec
        self._rng = rng

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return 1 for gas and 0 for none; see `SensorModel.read`."""
        del mount_velocity_world_m_s
        noise_ppm = self._spec.noise_std * float(self._rng.standard_normal())
        is_hit = total_ppm(sample) + noise_ppm > self._spec.threshold_ppm
        return Reading(sensor=self._spec.name, quantity="gas_detected", unit="1", values=(float(is_hit),))


class HitCounter:
    """Counts hits of gas as infotaxis and its relatives assume: a Poisson number with a mean in proportion to the gas.

    hits in a tick ~ Poisson(r c dt)      r hits per second and ppm, c mixing ratio [ppm], dt length of the tick [s]

    A reading holds the hits of the last `period_s`, so that a slow counter loses none; without a period, of the tick.
    State: the hits of each tick within the period. Draws one number a tick.
    Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """

    def __init__(self, spec: HitCounterSpec, tick_s: float, rng: np.random.Generator) -> None:
        self._sensor = spec.name
        self._hits_per_ppm = spec.hits_per_s_per_ppm * tick_s
        self._hits: deque[int] = deque(maxlen=max(1, round((spec.period_s or tick_s) / tick_s)))
        self._rng = rng

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the hits of the last period; see `SensorModel.read`."""
        del mount_velocity_world_m_s
        self._hits.append(int(self._rng.poisson(self._hits_per_ppm * max(0.0, total_ppm(sample)))))
        return Reading(sensor=self._sensor, quantity="hits", unit="1", values=(float(sum(self._hits)),))


class AveragingSensor:
    """The mean of the mixing ratio over the last `averaging_s`, less at the start. State: the samples of that time.

    Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """

    def __init__(self, spec: AveragingSensorSpec, tick_s: float) -> None:
        self._sensor = spec.name
        self._samples_ppm: deque[float] = deque(maxlen=max(1, round(spec.averaging_s / tick_s)))

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the mean [ppm]; see `SensorModel.read`."""
        del mount_velocity_world_m_s
        self._samples_ppm.append(total_ppm(sample))
        return _ppm_reading(self._sensor, math.fsum(self._samples_ppm) / len(self._samples_ppm))


class SecondOrderSensor:
    """A slow gas sensor: two lags in series, one pair for response and one for recovery.

    y(s) / x(s) = 1 / ((1 + A s) (1 + B s))      A, B = `response_s` where the input exceeds y, else `recovery_s`

    Each tick is the exact solution for an input held over it. State: the outputs of both lags [ppm], 0 at first.

    Source:
        GSL-Bench thesis, eqs. 5.3 and 5.4 (after Li et al. and Meng et al.). The default time constants are chosen.
    Deviation:
        There the phase follows the rise or fall of the input; here the input's side of the output, which does not
        flicker with every fluctuation.
    Held by:
        tests/unit/services/sensing/test_ppm_sensors.py
    """

    def __init__(self, spec: SecondOrderSensorSpec, tick_s: float) -> None:
        self._sensor = spec.name
        self._response = two_lag_remainder(*spec.response_s, tick_s)
        self._recovery = two_lag_remainder(*spec.recovery_s, tick_s)
        self._first_ppm = 0.0
        self._second_ppm = 0.0

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the output of the second lag [ppm]; see `SensorModel.read`."""
        del mount_velocity_world_m_s
        x = total_ppm(sample)
        keeps_first, keeps_second, passes = self._response if x > self._second_ppm else self._recovery
        gap_first, gap_second = self._first_ppm - x, self._second_ppm - x
        self._first_ppm = x + keeps_first * gap_first
        self._second_ppm = x + keeps_second * gap_second + passes * gap_first
        return _ppm_reading(self._sensor, max(0.0, self._second_ppm))


def two_lag_remainder(a_s: float, b_s: float, t: float) -> tuple[float, float, float]:
    """Return what is left of two lags' gaps after a time t [s].

    First gap times e^(-t/A); second gap times e^(-t/B) plus first gap times the third factor.
    """
    keeps_first, keeps_second = math.exp(-t / a_s), math.exp(-t / b_s)
    if math.isclose(a_s, b_s, rel_tol=1e-6):
        return keeps_first, keeps_second, t / a_s * keeps_first
    return keeps_first, keeps_second, a_s / (a_s - b_s) * (keeps_first - keeps_second)


def _ppm_reading(sensor: str, ppm: float) -> Reading:
    return new_reading(sensor=sensor, quantity="mixing_ratio", unit="ppm", values=(ppm,))


def _build_pid_kind(definitions: tuple[GasDefinition, ...]) -> SensorKind:
    defined = {gas.name: gas.pid_correction for gas in definitions if gas.pid_correction is not None}
    correction = {**PID_CORRECTION, **defined}

    def build(spec: PidSensorSpec, tick_s: float, rng: np.random.Generator) -> SensorModel:
        del tick_s, rng
        return PidSensor(spec, correction)

    return SensorKind(
        name="pid",
        settings=SENSOR_BLOCKS["pid"],
        quantity="mixing_ratio",
        unit="ppm",
        description="Photo-ionisation detector: values = (ppm,), each gas over its correction factor; no lag.",
        build=build,
        for_gases=_build_pid_kind,
    )


def _build_threshold(spec: ThresholdSensorSpec, tick_s: float, rng: np.random.Generator) -> SensorModel:
    del tick_s
    return ThresholdSensor(spec, rng)


def _build_binary(spec: ThresholdSensorSpec, tick_s: float, rng: np.random.Generator) -> SensorModel:
    del tick_s
    return BinarySensor(spec, rng)


def _build_averaging(spec: AveragingSensorSpec, tick_s: float, rng: np.random.Generator) -> SensorModel:
    del rng
    return AveragingSensor(spec, tick_s)


def _build_second_order(spec: SecondOrderSensorSpec, tick_s: float, rng: np.random.Generator) -> SensorModel:
    del rng
    return SecondOrderSensor(spec, tick_s)


PPM_KINDS = (
    _build_pid_kind(()),
    SensorKind(
        name="threshold",
        settings=SENSOR_BLOCKS["threshold"],
        quantity="mixing_ratio",
        unit="ppm",
        description="Threshold sensor: values = (ppm,) with noise above threshold_ppm, 0 below.",
        build=_build_threshold,
        has_own_noise=True,
    ),
    SensorKind(
        name="binary",
        settings=SENSOR_BLOCKS["binary"],
        quantity="gas_detected",
        unit="1",
        description="Binary detector: values = (1 or 0,), whether the mixing ratio, with noise, exceeds threshold_ppm.",
        build=_build_binary,
        has_own_noise=True,
    ),
    SensorKind(
        name="hit_counter",
        settings=SENSOR_BLOCKS["hit_counter"],
        quantity="hits",
        unit="1",
        description="Hit counter of infotaxis: values = (hits,) in the last period_s, or tick; Poisson with "
        "hits_per_s_per_ppm.",
        build=HitCounter,
    ),
    SensorKind(
        name="averaging",
        settings=SENSOR_BLOCKS["averaging"],
        quantity="mixing_ratio",
        unit="ppm",
        description="Averaging sensor: values = (mean ppm of the last averaging_s,).",
        build=_build_averaging,
    ),
    SensorKind(
        name="second_order",
        settings=SENSOR_BLOCKS["second_order"],
        quantity="mixing_ratio",
        unit="ppm",
        description="Slow gas sensor: values = (ppm,) behind two lags, response_s up and recovery_s down.",
        build=_build_second_order,
    ),
)


TDLAS_QUANTITY = "path_integrated_mixing_ratio"
TDLAS_UNIT = "ppm m"


class TdlasSensor:
    """A tunable diode laser that looks along a beam to the first wall and back, tuned to the gas that is searched for.

    reading = mean of the mixing ratio along the beam times its length      [ppm m] = [ppm] [m]

    The beam starts at the mount and points in the direction `beam_body`. Where no wall reflects it within
    `max_range_m`, the reading is 0 and `is_saturated`: nothing came back. State: none. No noise of its own, no lag.

    Source:
        GADEN's simulated TDLAS marches along a ray and sums ppm times metres of methane.
    Deviation:
        Any gas can be chosen; the sum takes the beam to the wall exactly.
    Left out:
        The wall's reflectivity and the fall of the signal with distance.
    Held by:
        tests/unit/services/sensing/test_tdlas.py, tests/unit/services/fields/test_sample_points.py
    """

    def __init__(self, spec: TdlasSensorSpec) -> None:
        self._sensor = spec.name

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the reading [ppm m]; see `SensorModel.read`. The first gas is the one that is searched for."""
        del mount_velocity_world_m_s
        beam_m = sample.beam_m or 0.0
        ppm = sample.gases[0].mixing_ratio_ppm if sample.gases else 0.0
        return Reading(
            sensor=self._sensor,
            quantity=TDLAS_QUANTITY,
            unit=TDLAS_UNIT,
            values=(ppm * beam_m,),
            is_saturated=beam_m == 0.0,
        )


def _build_tdlas(spec: TdlasSensorSpec, tick_s: float, rng: np.random.Generator) -> TdlasSensor:
    del tick_s, rng
    return TdlasSensor(spec)


TDLAS = SensorKind(
    name="tdlas",
    settings=SENSOR_BLOCKS["tdlas"],
    quantity=TDLAS_QUANTITY,
    unit=TDLAS_UNIT,
    description="Open-path laser: values = (ppm m,), the gas that is searched for summed along the beam to the wall.",
    build=_build_tdlas,
)
