"""Metal-oxide gas sensors of Figaro's TGS26xx family: resistance falls with gas; quick rise, slow decay."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from gslcosim.base import elementary
from gslcosim.base.quantities import ESTIMATE_QUANTITY, GAS_QUANTITIES
from gslcosim.base.scalar_kernels import next_normal, scalar_kernel
from gslcosim.scenario.models.gas import GasDefinition, list_gases
from gslcosim.scenario.models.sensors import MoxSensorSpec
from gslcosim_services.sensing.models.base import Floats, KernelEstimator, KernelSensorKind, SensorKernel, make_kind

MIN_RATIO = 0.01
QUANTITY = "resistance"
ESTIMATE_UNIT = "ppm"

# Model, R0 [ohm], Rs/R0 in clean air, rise and decay [s], as in GADEN; the gases' power laws are in `GASES`.
# TGS2602: Figaro's sheet "TGS 2602 - for the detection of Air Contaminants" has 10 to 100 kilo-ohms in
# clean air (their geometric mean, rounded), no times (TGS2600's are taken), and curves of toluene, ammonia, hydrogen
# sulfide and hydrogen that are not digitised here.
_TABLE = (
    ("tgs2600", 50000.0, 1.0, 4.8, 18.75),
    ("tgs2602", 30000.0, 1.0, 4.8, 18.75),
    ("tgs2610", 3740.0, 10.3, 3.44, 6.35),
    ("tgs2611", 3740.0, 8.8, 3.44, 6.35),
    ("tgs2612", 4500.0, 19.5, 3.44, 6.35),
    ("tgs2620", 3000.0, 21.0, 2.96, 15.71),
)

# Indices among the parameters of a sensor's kernel; A and B of each gas follow, 0 and 0 for a gas without effect.
_R0_OHM, _AIR_RATIO, _RISE_FRAC, _DECAY_FRAC, _NOISE, _WALK_STEP, _LAWS = range(7)
# Resistances closer than this to clean air are not taken for gas: ten standard deviations of the default noise.
CLEAN_BAND_FRAC = 0.03


@dataclass(frozen=True, kw_only=True)
class MoxParameters:
    """Figures of one MOX sensor.

    `r0_ohm` is the reference resistance R0, `air_ratio` is Rs/R0 in clean air, `rise_s` and `decay_s` are the time
    constants for more and for less gas, `power_law` gives (A, B) of Rs/R0 = A c^B for each gas, c in ppm.
    """

    model: str
    r0_ohm: float
    air_ratio: float
    rise_s: float
    decay_s: float
    power_law: dict[str, tuple[float, float]] = field(default_factory=dict)

    def floor_ppm(self, gas: str) -> float:
        """Return the mixing ratio below which a gas has no effect, (air / A)^(1 / B); infinite if it never has."""
        if gas not in self.power_law or self.power_law[gas][1] == 0.0:
            return math.inf
        a, b = self.power_law[gas]
        return elementary.pow(self.air_ratio / a, 1.0 / b)


def build_mox_parameters(definitions: tuple[GasDefinition, ...] = ()) -> dict[str, MoxParameters]:
    """Return the figures of all sensors by model, with power laws of all gases, also those that a scenario defines."""
    gases = list_gases(definitions)
    return {
        model: MoxParameters(
            model=model,
            r0_ohm=r0_ohm,
            air_ratio=air_ratio,
            rise_s=rise_s,
            decay_s=decay_s,
            power_law={name: gas.mox[model] for name, gas in gases.items() if model in gas.mox},
        )
        for model, r0_ohm, air_ratio, rise_s, decay_s in _TABLE
    }


MOX_PARAMETERS = build_mox_parameters()


def build_mox_kernel(
    parameters: MoxParameters,
    gases: tuple[str, ...],
    tick_s: float,
    *,
    noise_frac: float = 0.0,
    baseline_walk: float = 0.0,
) -> SensorKernel:
    """Return the kernel of a sensor.

    Args:
        gases: Names of the gases, in the order in which it gets their mixing ratios.
        tick_s: Length of a tick [s].
        noise_frac: White noise of ln R, its standard deviation.
        baseline_walk: Random walk of ln R [1/sqrt(s)].
    """
    rise_frac, decay_frac = (-elementary.expm1(-tick_s / lag_s) for lag_s in (parameters.rise_s, parameters.decay_s))
    laws = [number for gas in gases for number in parameters.power_law.get(gas, (0.0, 0.0))]
    walk_step = baseline_walk * math.sqrt(tick_s)
    numbers = (parameters.r0_ohm, parameters.air_ratio, rise_frac, decay_frac, noise_frac, walk_step, *laws)
    return SensorKernel(advance=advance_mox, parameters=numbers, state=(0.0, 0.0))


@scalar_kernel
def steady_ratio(parameters: Sequence[float], ppm: Sequence[float]) -> float:
    """Return Rs/R0 that a sensor settles to in a mixture.

    Rs/R0 = air - sum over gases of max(0, air - A c^B), at least 0.01      c in ppm, A and B of that gas

    Gases without figures have no effect.

    Args:
        parameters: Of `build_mox_kernel`.
        ppm: (n_gases,) mixing ratios [ppm by volume].

    Source:
        GADEN, simulated_gas_sensor/src/fake_gas_sensor.cpp; figures from Figaro's data sheets.
    Held by:
        tests/unit/services/sensing/test_mox.py (floors and steady resistances)
    """
    air = ratio = parameters[_AIR_RATIO]
    k = _LAWS
    for c in ppm:
        a = parameters[k]
        if a != 0.0 and c > 0.0:
            fall = air - a * elementary.pow(c, parameters[k + 1])
            if fall > 0.0:
                ratio -= fall
        k += 2
    return ratio if ratio > MIN_RATIO else MIN_RATIO


@scalar_kernel
def advance_mox(
    parameters: Floats, state: Floats, ppm: Floats, wind_m_s: Floats, velocity_m_s: Floats, stream: Any, values: Floats
) -> bool:
    """Advance a bare MOX element after its warm-up by a tick.

    y' = (target - y) / tau      tau = rise time where the target is below y (more gas), else decay time
    A tick of length dt takes y to y + (1 - exp(-dt / tau)) (target - y).

    R = R0 y e^(b + n)        b baseline, a random walk with N(0, walk^2 dt) in each tick; n ~ N(0, noise^2)

    State: y = Rs/R0, which is never 0 but before the first reading; b, 0 at first. The first reading (tick 0) is that
    of clean air. The sample is the true mixing ratio; a diffusion-fed element feels no wind and not its own motion. The
    reading is R [ohm]; it is saturated when y is at its least value of 0.01 (to a thousandth of it, since it only ever
    comes close). Draws b's step, then n, where there are any. See `SensorKernel` for the arguments.

    Left out:
        Humidity and temperature, which move the baseline of a real one by tens of per cent between days; the walk
        represents their changes within a run.

    Source:
        First-order response with figures as in GADEN (see `steady_ratio`).
    Deviation:
        GADEN takes dt / (tau + dt) in place of 1 - exp(-dt / tau), which depends on the length of the tick.
    Held by:
        tests/unit/services/sensing/test_mox.py, tests/analytic/test_gas_sensor_step.py (63.2 % at tau, any tick length)
    """
    y = state[0]
    if y == 0.0:
        y = parameters[_AIR_RATIO]
    else:
        target = steady_ratio(parameters, ppm)
        frac = parameters[_RISE_FRAC] if target < y else parameters[_DECAY_FRAC]
        y += frac * (target - y)
    state[0] = y
    ohm = parameters[_R0_OHM] * y
    if parameters[_WALK_STEP] != 0.0:
        state[1] += parameters[_WALK_STEP] * next_normal(stream)
        ohm *= elementary.exp(state[1])
    if parameters[_NOISE] != 0.0:
        ohm *= elementary.exp(parameters[_NOISE] * next_normal(stream))
    values[0] = ohm
    return y <= 1.001 * MIN_RATIO


@scalar_kernel
def estimate_ppm(parameters: Sequence[float], values: Sequence[float]) -> float:
    """Return the mixing ratio of one gas alone at which a sensor settles to a resistance [ppm by volume].

    c = (Rs/R0 / A)^(1 / B) where Rs/R0 is more than `CLEAN_BAND_FRAC` below clean air, else 0; infinity becomes the
    largest double.

    The inverse of the maker's sheet with the R0 of this unit: the sensor's lag, its other gases, its noise and
    baseline are in it, and just below clean air it jumps to the floor, below which the gas has no effect.

    Args:
        parameters: Of `build_mox_kernel` for this gas alone, of which it must have figures.
        values: (1,) the sensor's resistance [ohm].

    Held by:
        tests/unit/services/sensing/test_mox.py (inverts the steady response)
    """
    ratio = max(values[0] / parameters[_R0_OHM], 1e-12)
    if ratio >= parameters[_AIR_RATIO] * (1.0 - CLEAN_BAND_FRAC):
        return 0.0
    exponent = elementary.log(ratio / parameters[_LAWS]) / parameters[_LAWS + 1]
    return elementary.exp(min(exponent, 700.0))


def _build_estimator(parameters: MoxParameters, gas: str) -> KernelEstimator | None:
    if parameters.power_law.get(gas, (1.0, 0.0))[1] == 0.0:
        return None
    # Lags and noise do not matter to it, nor need they be computed where a scenario is checked.
    numbers = (parameters.r0_ohm, parameters.air_ratio, *[0.0] * (_LAWS - 2), *parameters.power_law[gas])
    return KernelEstimator(estimate_ppm, numbers, ESTIMATE_QUANTITY, ESTIMATE_UNIT)


def build_mox_kind(parameters: MoxParameters) -> KernelSensorKind:
    """Return the row of the table of sensor models for one MOX sensor."""

    def kernel(spec: MoxSensorSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
        errors = {"noise_frac": spec.noise_frac, "baseline_walk": spec.baseline_walk}
        return build_mox_kernel(parameters, gases, tick_s, **errors)

    return make_kind(
        KernelSensorKind,
        parameters.model,
        QUANTITY,
        GAS_QUANTITIES[QUANTITY],
        f"MOX gas sensor {parameters.model.upper()}: values = (resistance_ohm,), lower in gas; "
        f"{parameters.r0_ohm * parameters.air_ratio:g} ohm in clean air.",
        kernel=kernel,
        least_value=MIN_RATIO * parameters.r0_ohm,
        for_gases=lambda definitions: build_mox_kind(build_mox_parameters(definitions)[parameters.model]),
        estimator=lambda gas: _build_estimator(parameters, gas),
    )
