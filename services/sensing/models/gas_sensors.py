"""Gas sensors of the mixing ratio: PID, threshold, binary, hit counter, averaging, second order, TDLAS.

All respond to the sum of all gases, except for the PID, which weighs them.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from gslcosim.base import elementary
from gslcosim.base.quantities import BEAM_QUANTITY, GAS_QUANTITIES, Vec3
from gslcosim.base.scalar_kernels import exact_sum, next_normal, next_poisson, scalar_kernel
from gslcosim.contract.messages import MountSample, Reading
from gslcosim.scenario.models.gas import GasDefinition, list_gases
from gslcosim.scenario.models.sensors import (
    AveragingSensorSpec,
    HitCounterSpec,
    PidSensorSpec,
    SecondOrderSensorSpec,
    TdlasSensorSpec,
    ThresholdSensorSpec,
)
from gslcosim_services.sensing.models.base import (
    N_SEEN,
    RING,
    Floats,
    KernelSensorKind,
    SensorKernel,
    SensorKind,
    follow,
    lag_frac,
    make_kind,
    new_reading,
    new_window,
    push_count,
    push_value,
)


@scalar_kernel
def total_ppm(ppm: Sequence[float]) -> float:
    """Return the mixing ratio of all gases together [ppm]."""
    return ppm[0] if len(ppm) == 1 else exact_sum(ppm, 0, len(ppm))


@scalar_kernel
def measure_pid(
    parameters: Floats, state: Floats, ppm: Floats, wind_m_s: Floats, velocity_m_s: Floats, stream: Any, values: Floats
) -> bool:
    """Measure with a photo-ionisation detector behind its lag, without noise.

    y follows the sum over gases of c / CF [ppm] by `lag_frac` of the gap in each tick, from 0 at the start;
    parameters = (lag_frac, CF correction factor of each gas, 0 of those not seen)

    State: y. See `SensorKernel` for the arguments. Source: RAE Systems, Technical Note TN-106; see `GASES`.
    Deviation: GADEN has 10.47 for ethanol, which is its ionisation energy [eV] and not a factor.
    Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """
    for i in range(len(ppm)):
        ppm[i] = ppm[i] / parameters[1 + i] if parameters[1 + i] != 0.0 else 0.0
    values[0] = state[0] = follow(state[0], total_ppm(ppm), parameters[0])
    return False


@scalar_kernel
def measure_above_threshold(
    parameters: Floats, state: Floats, ppm: Floats, wind_m_s: Floats, velocity_m_s: Floats, stream: Any, values: Floats
) -> bool:
    """Read the mixing ratio where it exceeds a threshold, and 0 elsewhere.

    S = c for c > threshold, else 0; with `noise_std` in the scenario, c + e (thesis eq. 5.2);
    parameters = (threshold, noise_std) [ppm]

    State: none. Draws one number a tick. See `SensorKernel` for the arguments.
    Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """
    noise_ppm = parameters[1] * next_normal(stream)
    c_ppm = total_ppm(ppm)
    values[0] = max(0.0, c_ppm + noise_ppm) if c_ppm > parameters[0] else 0.0
    return False


@scalar_kernel
def detect_gas(
    parameters: Floats, state: Floats, ppm: Floats, wind_m_s: Floats, velocity_m_s: Floats, stream: Any, values: Floats
) -> bool:
    """Detect a mixing ratio, with noise, above a threshold: 1 or 0.

    hit = c + N(0, noise_std) > threshold      parameters = (threshold, noise_std) [ppm], so that there are misses and
                                               false alarms

    State: none. Draws one number a tick. See `SensorKernel` for the arguments.
    Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """
    noise_ppm = parameters[1] * next_normal(stream)
    values[0] = 1.0 if total_ppm(ppm) + noise_ppm > parameters[0] else 0.0
    return False


@scalar_kernel
def count_hits(
    parameters: Floats, state: Floats, ppm: Floats, wind_m_s: Floats, velocity_m_s: Floats, stream: Any, values: Floats
) -> bool:
    """Count hits of gas as infotaxis and its relatives assume: a Poisson number with a mean in proportion to the gas.

    hits in a tick ~ Poisson(r c dt)      r hits per second and ppm, c mixing ratio [ppm], dt length of the tick [s];
                                          parameters = (r dt,)

    A reading holds the hits of the last `period_s`, so that a slow counter loses none; without a period, of the tick.
    State: the hits of each tick within the period. Draws one number a tick. See `SensorKernel` for the arguments.
    Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """
    hits = next_poisson(stream, parameters[0] * max(0.0, total_ppm(ppm)))
    values[0] = push_count(state, hits)
    return False


@scalar_kernel
def average_gas(
    parameters: Floats, state: Floats, ppm: Floats, wind_m_s: Floats, velocity_m_s: Floats, stream: Any, values: Floats
) -> bool:
    """Read the mean of the mixing ratio over the last `averaging_s`, less at the start.

    State: the samples of that time. See `SensorKernel` for the arguments.
    Held by: tests/unit/services/sensing/test_ppm_sensors.py
    """
    push_value(state, total_ppm(ppm))
    n = min(int(state[N_SEEN]), len(state) - RING)
    values[0] = exact_sum(state, RING, n) / n
    return False


@scalar_kernel
def advance_two_lags(
    parameters: Floats, state: Floats, ppm: Floats, wind_m_s: Floats, velocity_m_s: Floats, stream: Any, values: Floats
) -> bool:
    """Advance a slow gas sensor by a tick: two lags in series, one pair for response and one for recovery.

    y(s) / x(s) = 1 / ((1 + A s) (1 + B s))      A, B = `response_s` where the input exceeds y, else `recovery_s`

    Each tick is the exact solution for an input held over it. State: the outputs of both lags [ppm], 0 at first;
    parameters = `two_lag_remainder` of response, then of recovery. See `SensorKernel` for the arguments.

    Source:
        GSL-Bench thesis, eqs. 5.3 and 5.4 (after Li et al. and Meng et al.). The default time constants are chosen.
    Deviation:
        There the phase follows the rise or fall of the input; here the input's side of the output, which does not
        flicker with every fluctuation.
    Held by:
        tests/unit/services/sensing/test_ppm_sensors.py
    """
    x = total_ppm(ppm)
    i = 0 if x > state[1] else 3
    gap_first, gap_second = state[0] - x, state[1] - x
    state[0] = x + parameters[i] * gap_first
    state[1] = x + parameters[i + 1] * gap_second + parameters[i + 2] * gap_first
    values[0] = max(0.0, state[1])
    return False


def two_lag_remainder(a_s: float, b_s: float, t: float) -> tuple[float, float, float]:
    """Return the rest of two lags' gaps after a time t [s].

    First gap times e^(-t/A); second gap times e^(-t/B) plus first gap times the third factor.
    """
    keeps_first, keeps_second = elementary.exp(-t / a_s), elementary.exp(-t / b_s)
    if math.isclose(a_s, b_s, rel_tol=1e-6):
        return keeps_first, keeps_second, t / a_s * keeps_first
    return keeps_first, keeps_second, a_s / (a_s - b_s) * (keeps_first - keeps_second)


def _build_pid_kind(definitions: tuple[GasDefinition, ...]) -> KernelSensorKind:
    known = list_gases(definitions)

    def kernel(spec: PidSensorSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
        corrections = (known[gas].pid.get(spec.lamp_ev, 0.0) for gas in gases)
        numbers = (lag_frac(spec.t90_s, tick_s), *corrections)
        return SensorKernel(advance=measure_pid, parameters=numbers, state=(0.0,))

    description = "Photo-ionisation detector: values = (ppm,), each gas over its correction factor."
    return _gas_kind("pid", "mixing_ratio", description, kernel, least_value=0.0, for_gases=_build_pid_kind)


def _gas_kind(name: str, quantity: str, description: str, kernel: Any, **more: Any) -> KernelSensorKind:
    return make_kind(KernelSensorKind, name, quantity, GAS_QUANTITIES[quantity], description, kernel=kernel, **more)


def _threshold_kernel(spec: ThresholdSensorSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
    del gases, tick_s
    return SensorKernel(advance=measure_above_threshold, parameters=(spec.threshold_ppm, spec.noise_std))


def _binary_kernel(spec: ThresholdSensorSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
    del gases, tick_s
    return SensorKernel(advance=detect_gas, parameters=(spec.threshold_ppm, spec.noise_std))


def _hit_counter_kernel(spec: HitCounterSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
    del gases
    ring = new_window(spec.period_s or tick_s, tick_s)
    return SensorKernel(advance=count_hits, parameters=(spec.hits_per_s_per_ppm * tick_s,), state=ring)


def _averaging_kernel(spec: AveragingSensorSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
    del gases
    return SensorKernel(advance=average_gas, state=new_window(spec.averaging_s, tick_s))


def _second_order_kernel(spec: SecondOrderSensorSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
    del gases
    lags = (*two_lag_remainder(*spec.response_s, tick_s), *two_lag_remainder(*spec.recovery_s, tick_s))
    return SensorKernel(advance=advance_two_lags, parameters=lags, state=(0.0, 0.0))


PID = _build_pid_kind(())
PPM_KINDS = (
    PID,
    _gas_kind(
        "threshold", "mixing_ratio", "Threshold sensor: values = (ppm,) with noise above threshold_ppm, 0 below.",
        _threshold_kernel, has_own_noise=True,
    ),
    _gas_kind(
        "binary", "gas_detected",
        "Binary detector: values = (1 or 0,), 1 where the mixing ratio, with noise, exceeds threshold_ppm.",
        _binary_kernel, has_own_noise=True,
    ),
    _gas_kind(
        "hit_counter", "hits", "Hit counter of infotaxis: values = (hits,) in the last period_s, or tick; Poisson with "
        "hits_per_s_per_ppm.", _hit_counter_kernel,
    ),
    _gas_kind(
        "averaging", "mixing_ratio", "Averaging sensor: values = (mean ppm of the last averaging_s,).",
        _averaging_kernel,
    ),
    _gas_kind(
        "second_order", "mixing_ratio",
        "Slow gas sensor: values = (ppm,) behind two lags, response_s up and recovery_s down.", _second_order_kernel,
    ),
)  # fmt: skip


class TdlasSensor:
    """A tunable diode laser along a beam to the first wall and back, tuned to the gas searched for.

    reading = mean of the mixing ratio along the beam times its length      [ppm m] = [ppm] [m]

    The beam starts at the mount and points in the direction `beam_body`. Where no wall reflects it within
    `max_range_m`, no light returns: the reading falls to 0 and `is_saturated`. It follows by `lag_frac` of the gap in
    each tick. State: its reading, 0 at first. No noise of its own.

    Source:
        GADEN's simulated TDLAS marches along a ray and sums ppm times metres of methane.
    Deviation:
        Any gas can be chosen; the sum takes the beam to the wall exactly.
    Left out:
        The wall's reflectivity and the fall of the signal with distance.
    Held by:
        tests/unit/services/sensing/test_tdlas.py, tests/unit/services/fields/test_sample_points.py
    """

    def __init__(self, spec: TdlasSensorSpec, tick_s: float) -> None:
        self._sensor = spec.name
        self._frac = lag_frac(spec.t90_s, tick_s)
        self._shown_ppm_m = 0.0

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the reading [ppm m]; the first gas is the one searched for."""
        del mount_velocity_world_m_s
        beam_m = sample.beam_m or 0.0
        ppm = sample.gases[0].mixing_ratio_ppm if sample.gases else 0.0
        self._shown_ppm_m = follow(self._shown_ppm_m, ppm * beam_m, self._frac)
        return new_reading(
            sensor=self._sensor,
            quantity=BEAM_QUANTITY,
            unit=GAS_QUANTITIES[BEAM_QUANTITY],
            values=(self._shown_ppm_m,),
            is_saturated=beam_m == 0.0,
        )


def _build_tdlas(spec: TdlasSensorSpec, tick_s: float, rng: np.random.Generator) -> TdlasSensor:
    del rng
    return TdlasSensor(spec, tick_s)


TDLAS = make_kind(
    SensorKind,
    "tdlas",
    BEAM_QUANTITY,
    GAS_QUANTITIES[BEAM_QUANTITY],
    "Open-path laser: values = (ppm m,), the target gas integrated along the beam to the wall.",
    build=_build_tdlas,
)
