"""Metal-oxide gas sensors of Figaro's TGS26xx family: resistance falls with gas; quick rise, slow decay."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import GasAmount, MountSample, Reading
from gslcosim.scenario.models.gas import GasDefinition
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, SensorSpec
from gslcosim_services.sensing.models.base import Estimator, SensorKind, estimate_name, new_reading

MIN_RATIO = 0.01
QUANTITY = "resistance"
UNIT = "ohm"
ESTIMATE_QUANTITY = "estimated_mixing_ratio"
ESTIMATE_UNIT = "ppm"


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
        return (self.air_ratio / a) ** (1.0 / b)


# GADEN gives these four methane's figures and marks them as still to review.
_AS_METHANE = ("propanol", "chlorine", "fluorine", "acetone")


def _build_parameters(
    model: str,
    r0_ohm: float,
    air_ratio: float,
    times_s: tuple[float, float],
    *,
    ethanol: tuple[float, float],
    methane: tuple[float, float],
    hydrogen: tuple[float, float],
) -> MoxParameters:
    power_law = {"ethanol": ethanol, "methane": methane, "hydrogen": hydrogen, **dict.fromkeys(_AS_METHANE, methane)}
    rise_s, decay_s = times_s
    return MoxParameters(
        model=model, r0_ohm=r0_ohm, air_ratio=air_ratio, rise_s=rise_s, decay_s=decay_s, power_law=power_law
    )


# Not in GADEN. From Figaro's sheet "TGS 2602 - for the detection of Air Contaminants": 10 to 100 kilo-ohms in clean air
# (their geometric mean, rounded), and the ethanol curve through about 0.75 at 1 ppm, 0.3 at 10 ppm and 0.17 at 30 ppm,
# the sheet's range, where one sensor may differ from another by a factor of two. Uncertain: the sheet gives no times
# (TGS2600's are taken), and its curves of toluene, ammonia, hydrogen sulfide and hydrogen are not digitised here; a
# scenario may `define` such gases with a power law of its own.
_TGS2602 = MoxParameters(
    model="tgs2602",
    r0_ohm=30000.0,
    air_ratio=1.0,
    rise_s=4.8,
    decay_s=18.75,
    power_law={"ethanol": (0.77, -0.43)},
)

_TABLE = (
    _build_parameters(
        "tgs2600", 50000.0, 1.0, (4.8, 18.75), ethanol=(0.6796, -0.3196), methane=(1.018, -0.07284),
        hydrogen=(0.6821, -0.3532),
    ),
    _TGS2602,
    _build_parameters(
        "tgs2610", 3740.0, 10.3, (3.44, 6.35), ethanol=(106.1, -0.5008), methane=(63.91, -0.5372),
        hydrogen=(66.78, -0.4888),
    ),
    _build_parameters(
        "tgs2611", 3740.0, 8.8, (3.44, 6.35), ethanol=(51.11, -0.3658), methane=(38.46, -0.4289),
        hydrogen=(41.3, -0.3614),
    ),
    _build_parameters(
        "tgs2612", 4500.0, 19.5, (3.44, 6.35), ethanol=(31.35, -0.09115), methane=(146.2, -0.5916),
        hydrogen=(19.5, 0.0),
    ),
    _build_parameters(
        "tgs2620", 3000.0, 21.0, (2.96, 15.71), ethanol=(62.32, -0.7155), methane=(120.6, -0.4877),
        hydrogen=(24.45, -0.5546),
    ),
)  # fmt: skip

MOX_PARAMETERS = {parameters.model: parameters for parameters in _TABLE}


def steady_ratio(parameters: MoxParameters, gases: tuple[GasAmount, ...]) -> float:
    """Return Rs/R0 that a sensor settles to in a mixture.

    Rs/R0 = air - sum over gases of max(0, air - A c^B), at least 0.01      c in ppm, A and B of that gas

    Gases without figures have no effect.

    Source:
        GADEN, simulated_gas_sensor/src/fake_gas_sensor.cpp; figures from Figaro's data sheets.
    Held by:
        tests/unit/services/sensing/test_mox.py (floors and steady resistances)
    """
    air = parameters.air_ratio
    ratio = air
    for gas in gases:
        law = parameters.power_law.get(gas.gas)
        if law is not None and gas.mixing_ratio_ppm > 0.0:
            ratio -= max(0.0, air - law[0] * gas.mixing_ratio_ppm ** law[1])
    return max(ratio, MIN_RATIO)


class MoxSensor:
    """A bare MOX element after its warm-up, without noise, temperature or humidity effects.

    y' = (target - y) / tau      tau = rise time where the target is below y (more gas), else decay time
    A tick of length dt takes y to y + (1 - exp(-dt / tau)) (target - y).

    State: y = Rs/R0, clean air at first. The first reading (tick 0) is that of clean air. The sample is the true
    mixing ratio. The reading is R0 y [ohm]; `is_saturated` when y is at its least value of 0.01
    (to a thousandth of it, since it only ever comes close).

    Source:
        First-order response with figures as in GADEN (see `steady_ratio`).
    Deviation:
        GADEN takes dt / (tau + dt) in place of 1 - exp(-dt / tau), which depends on the length of the tick.
    Held by:
        tests/unit/services/sensing/test_mox.py, tests/analytic/test_gas_sensor_step.py (63.2 % at tau, any tick length)
    """

    def __init__(self, parameters: MoxParameters, sensor: str, tick_s: float) -> None:
        self._parameters = parameters
        self._sensor = sensor
        self._rise_frac = -math.expm1(-tick_s / parameters.rise_s)
        self._decay_frac = -math.expm1(-tick_s / parameters.decay_s)
        self._ratio: float | None = None

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the resistance at the end of the tick; see `SensorModel.read`."""
        del mount_velocity_world_m_s  # a diffusion-fed element does not feel its own motion
        if self._ratio is None:
            self._ratio = self._parameters.air_ratio
        else:
            target = steady_ratio(self._parameters, sample.gases)
            frac = self._rise_frac if target < self._ratio else self._decay_frac
            self._ratio += frac * (target - self._ratio)
        return new_reading(
            sensor=self._sensor,
            quantity=QUANTITY,
            unit=UNIT,
            values=(self._parameters.r0_ohm * self._ratio,),
            is_saturated=self._ratio <= 1.001 * MIN_RATIO,
        )


def estimated_ppm(parameters: MoxParameters, gas: str, resistance_ohm: float) -> float:
    """Return the mixing ratio of one gas alone at which a sensor settles to a resistance [ppm by volume].

    c = (Rs/R0 / A)^(1 / B) below the ratio of clean air, and 0 from there on; infinity becomes the largest double.

    What somebody with the maker's sheet would conclude: the sensor's lag, its other gases and its errors are in it, and
    just below clean air it jumps to the floor, below which the gas has no effect.

    Args:
        parameters: The sensor's; it must have figures of the gas.
        gas: Which gas.
        resistance_ohm: The sensor's resistance [ohm].

    Held by:
        tests/unit/services/sensing/test_mox.py (inverts the steady response)
    """
    a, b = parameters.power_law[gas]
    ratio = max(resistance_ohm / parameters.r0_ohm, 1e-12)
    if ratio >= parameters.air_ratio * (1.0 - 1e-9):
        return 0.0
    exponent = math.log(ratio / a) / b
    return math.exp(min(exponent, 700.0))


def _build_estimator(parameters: MoxParameters, gas: str) -> Estimator | None:
    if parameters.power_law.get(gas, (1.0, 0.0))[1] == 0.0:
        return None

    def estimate(reading: Reading) -> Reading:
        return new_reading(
            sensor=estimate_name(reading.sensor),
            quantity=ESTIMATE_QUANTITY,
            unit=ESTIMATE_UNIT,
            values=(estimated_ppm(parameters, gas, reading.values[0]),),
            is_saturated=reading.is_saturated,
            is_warming_up=reading.is_warming_up,
        )

    return estimate


def add_gases(parameters: MoxParameters, definitions: tuple[GasDefinition, ...]) -> MoxParameters:
    """Return a sensor's figures with those that a scenario gives for gases of its own."""
    laws = {gas.name: (law.a, law.b) for gas in definitions for law in gas.mox if law.sensor == parameters.model}
    return replace(parameters, power_law={**parameters.power_law, **laws})


def build_mox_kind(parameters: MoxParameters) -> SensorKind:
    """Return the row of the table of sensor models for one MOX sensor."""

    def build(spec: SensorSpec, tick_s: float, rng: np.random.Generator) -> MoxSensor:
        del rng  # no noise
        return MoxSensor(parameters, spec.name, tick_s)

    return SensorKind(
        name=parameters.model,
        settings=SENSOR_BLOCKS[parameters.model],
        quantity=QUANTITY,
        unit=UNIT,
        description=f"MOX gas sensor {parameters.model.upper()}: values = (resistance_ohm,), lower in gas; "
        f"{parameters.r0_ohm * parameters.air_ratio:g} ohm in clean air.",
        build=build,
        least_value=MIN_RATIO * parameters.r0_ohm,
        for_gases=lambda definitions: build_mox_kind(add_gases(parameters, definitions)),
        estimator=lambda gas: _build_estimator(parameters, gas),
    )
