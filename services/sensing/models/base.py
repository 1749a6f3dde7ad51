"""Interface of sensor models, and measurement errors of real instruments."""

import math
from collections import deque
from collections.abc import Callable, MutableSequence, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, Protocol, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import GslCosimError, ModelError, ScenarioError
from gslcosim.base.frames import world_from_body_rotation
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import next_normal, scalar_kernel
from gslcosim.base.ticks import NS_PER_S, exact_ticks_from_seconds
from gslcosim.contract.messages import BodyState, CameraImage, MountSample, Reading
from gslcosim.contract.record import build_unchecked_constructor
from gslcosim.scenario.models.gas import GasDefinition
from gslcosim.scenario.models.sensors import (
    IDEAL_SUFFIX,
    SENSOR_BLOCKS,
    MeasuringSensorSpec,
    NoisySensorSpec,
    OnBoardSensorSpec,
    SensorSpec,
)
from gslcosim_services.sensing.ray_scene import RayScene

new_reading = build_unchecked_constructor(Reading)
"""Makes a `Reading` of values with known types; for models that are read at every tick."""

Estimator = Callable[[Reading], Reading]
ESTIMATE_SUFFIX = "_ppm"
_MAX_NAME_LENGTH = 40

Floats = MutableSequence[float]
"""A row of numbers of a kernel: a list in a run, an array in a batch."""

# Indices in the state of a memory of some length of time: number of ticks seen, their sum, and the ring of its ticks.
N_SEEN, _SUM, RING = range(3)


class SensorModel(Protocol):
    """One instrument on one vehicle, new in every run; it is read once a tick, from tick 0 on."""

    def read(self, sample: Any, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the reading of the instrument at the end of the tick.

        Args:
            sample: True gas and wind at the mount, a `MountSample`; for on-board sensors their `Surroundings`.
            mount_velocity_world_m_s: Velocity of the mount, world frame [m/s].
        """
        ...


@cache  # called in every tick
def estimate_name(sensor: str) -> str:
    """Return the name of the second reading of a sensor, with the mixing ratio that the first one suggests."""
    return sensor[: _MAX_NAME_LENGTH - len(ESTIMATE_SUFFIX)] + ESTIMATE_SUFFIX


@dataclass(frozen=True, kw_only=True)
class SensorKind:
    """One row of the table of sensor models.

    `settings` is a sensor's block in a scenario: its keys beside those of the base are the sensor's own.
    `build(spec, tick_s, rng)` returns a new instrument; `spec` is such a block, `rng` its own random stream. `quantity`
    and `unit` are those of its readings, `description` names the device and the values of a reading.
    `has_own_noise` marks models that apply the scenario's `noise_std` themselves. `n_with_errors` is the number of a
    reading's values, from the first on, with the scenario's bias, drift, noise and limit (absent: all of them),
    `least_value` their lower bound.

    `for_gases(definitions)` returns the row for a scenario that defines gases of its own, where that matters.
    `estimator(gas)` returns the conversion of a reading into a second one, the mixing ratio [ppm] of a gas according
    to the maker's sheet; nothing where the sheet lacks the gas. The second reading is named after the sensor with
    `_ppm` behind.
    """

    name: str
    quantity: str
    unit: str
    description: str
    build: Callable[[Any, float, np.random.Generator], SensorModel]
    settings: type[SensorSpec] = MeasuringSensorSpec
    has_own_noise: bool = False
    n_with_errors: int | None = None
    least_value: float = -math.inf
    for_gases: "Callable[[tuple[GasDefinition, ...]], SensorKind] | None" = None
    estimator: Callable[[str], Estimator | None] | None = None

    @property
    def is_on_board(self) -> bool:
        """True for sensors of the vehicle and its surroundings, false for those of gas and wind."""
        return issubclass(self.settings, OnBoardSensorSpec)


@dataclass(frozen=True, kw_only=True)
class SensorKernel:
    """Instrument of gas or wind in one tick: a scalar kernel, and the numbers that it works with.

    `advance(parameters, state, ppm, wind_m_s, velocity_m_s, stream, values)` reads the true mixing ratio of each gas
    [ppm by volume], which it may overwrite, wind and velocity of the mount, (3,) each in the world frame [m/s]; it
    draws from the stream, advances the state, writes the (n_values,) values of the reading, in the unit of the kind of
    sensor, and returns whether they are saturated. It is called in each tick from tick 0 on. See
    `gslcosim.base.scalar_kernels` for the language of such kernels.

    `parameters` stay as they are, `state` is that of a new instrument.
    """

    advance: Callable[..., bool]
    parameters: tuple[float, ...] = ()
    state: tuple[float, ...] = ()
    n_values: int = 1


Kind = TypeVar("Kind", bound=SensorKind)


def make_kind(kind: type[Kind], name: str, quantity: str, unit: str, description: str, **more: Any) -> Kind:
    """Return the row of a model of gslcosim, whose block is in `SENSOR_BLOCKS`."""
    named = {"name": name, "settings": SENSOR_BLOCKS[name]}
    return kind(**named, quantity=quantity, unit=unit, description=description, **more)


@dataclass(frozen=True, kw_only=True)
class KernelSensorKind(SensorKind):
    """A kind of sensor of gas or wind with a scalar kernel as its instrument, which batches call too.

    `kernel(spec, gases, tick_s)` returns the kernel of an instrument: `spec` is its block, `gases` are the names of the
    gases in the order in which it gets their mixing ratios, `tick_s` is the length of a tick [s].
    """

    kernel: Callable[[Any, tuple[str, ...], float], SensorKernel]
    build: Callable[[Any, float, np.random.Generator], SensorModel] = field(init=False)

    def __post_init__(self) -> None:
        def build(spec: SensorSpec, tick_s: float, rng: np.random.Generator) -> SensorModel:
            return KernelSensor(self, spec, tick_s, rng)

        object.__setattr__(self, "build", build)


def ideal_kind(kind: Kind) -> Kind:
    """Return the row of the same instrument without errors, for a model that has one."""
    name, for_gases = kind.name + IDEAL_SUFFIX, kind.for_gases
    return replace(
        kind,
        name=name,
        settings=SENSOR_BLOCKS[name],
        for_gases=None if for_gases is None else lambda definitions: ideal_kind(for_gases(definitions)),
    )


class KernelSensor:
    """An instrument of gas or wind in a run, which calls its kernel once a tick.

    State: that of the kernel. Draws what the kernel draws.
    """

    def __init__(self, kind: KernelSensorKind, spec: SensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        self._kind = kind
        self._spec = spec
        self._tick_s = tick_s
        self._rng = rng
        self._sensor, self._quantity, self._unit = spec.name, kind.quantity, kind.unit
        self._gases: list[str] = []
        kernel = kind.kernel(spec, (), tick_s)
        self._advance, self._parameters = kernel.advance, kernel.parameters
        self._state = list(kernel.state)
        self._values = [0.0] * kernel.n_values

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the reading at the end of the tick.

        Raises:
            ModelError: a value is not finite.
        """
        gases: list[str] = []
        ppm: list[float] = []
        for amount in sample.gases:
            gases.append(amount.gas)
            ppm.append(amount.mixing_ratio_ppm)
        if gases != self._gases:
            self._gases = gases
            self._parameters = self._kind.kernel(self._spec, tuple(gases), self._tick_s).parameters
        values = self._values
        is_saturated = self._advance(
            self._parameters, self._state, ppm, sample.wind_world_m_s, mount_velocity_world_m_s, self._rng, values
        )
        # Infinity less itself is not a number, which equals nothing.
        if (total := sum(values)) - total != 0.0:
            raise ModelError(f"sensing: expected finite values of sensor {self._sensor}, was {tuple(values)}.")
        return new_reading(
            sensor=self._sensor,
            quantity=self._quantity,
            unit=self._unit,
            values=tuple(values),
            is_saturated=True if is_saturated else False,  # noqa: SIM210 - whatever another package's returns
        )


def new_window(time_s: float, tick_s: float) -> tuple[float, ...]:
    """Return the state, before the first tick, of a memory of the ticks of a time [s], at least one."""
    return (0.0,) * (RING + max(1, round(time_s / tick_s)))


@scalar_kernel
def push_value(window: MutableSequence[float], value: float) -> float:
    """Put the value of a tick into a `new_window` in place of the oldest one, which is returned."""
    i = RING + int(window[N_SEEN]) % (len(window) - RING)
    oldest = window[i]
    window[i] = value
    window[N_SEEN] += 1.0
    return oldest


@scalar_kernel
def push_count(window: MutableSequence[float], count: float) -> float:
    """Put a whole number of a tick into a `new_window`, and return the sum over its time, which is exact."""
    window[_SUM] += count - push_value(window, count)
    return window[_SUM]


@dataclass(frozen=True)
class KernelEstimator:
    """Turns a reading into an estimate of a mixing ratio, by a scalar kernel; see `SensorKind.estimator`.

    `estimate(parameters, values)` returns the mixing ratio [ppm by volume].
    """

    estimate: Callable[..., float]
    parameters: tuple[float, ...]
    quantity: str
    unit: str

    def __call__(self, reading: Reading) -> Reading:
        """Return the second reading."""
        return new_reading(
            sensor=estimate_name(reading.sensor),
            quantity=self.quantity,
            unit=self.unit,
            values=(self.estimate(self.parameters, reading.values),),
            is_saturated=reading.is_saturated,
            is_warming_up=reading.is_warming_up,
        )


@dataclass(frozen=True)
class Surroundings:
    """True surroundings of one vehicle at the end of a tick; on-board sensors get them in place of a gas sample.

    `others` are the other vehicles; `images` are the pictures just taken, by the sensor's name.
    """

    body: BodyState
    scene: RayScene
    others: tuple[BodyState, ...] = ()
    images: dict[str, CameraImage] = field(default_factory=dict)

    @cached_property
    def world_from_body(self) -> NDArray[np.float64]:
        """The (3, 3) matrix that turns body-frame vectors into world-frame vectors."""
        return world_from_body_rotation(self.body.quaternion_wxyz)

    def place_world_m(self, mount_body_m: Vec3) -> Vec3:
        """Return the position of a mount, world frame [m]."""
        x_m, y_m, z_m = self.body.position_world_m
        if not any(mount_body_m):
            return x_m, y_m, z_m
        dx_m, dy_m, dz_m = elementary.product(self.world_from_body, mount_body_m).tolist()
        return x_m + dx_m, y_m + dy_m, z_m + dz_m


@scalar_kernel
def draw_gain(spread: float, stream: Any) -> float:
    """Return the factor of a unit, exp(N(0, spread)); draws a number where units differ.

    Held by: tests/unit/services/sensing/test_measurement_errors.py
    """
    return elementary.exp(spread * next_normal(stream)) if spread != 0.0 else 1.0


@scalar_kernel
def draw_drift(drift_per_s: float, spread_per_s: float, stream: Any) -> float:
    """Return the drift of a unit, drift + N(0, spread); draws a number where units differ.

    Held by: tests/unit/services/sensing/test_measurement_errors.py
    """
    return drift_per_s + spread_per_s * next_normal(stream) if spread_per_s != 0.0 else drift_per_s


@scalar_kernel
def add_errors(
    value: float, gain: float, bias: float, drift_per_s: float, tick: int, tick_s: float, noise_std: float, stream: Any
) -> float:
    """Return a value with the errors of an instrument: gain v + bias + drift_per_s t + N(0, noise_std).

    Draws a number where there is noise. Held by: tests/unit/services/sensing/test_measurement_errors.py
    """
    offset = bias + drift_per_s * tick * tick_s
    if noise_std == 0.0:
        return gain * value + offset
    return gain * value + offset + noise_std * next_normal(stream)


@scalar_kernel
def quantize(value: float, resolution: float) -> float:
    """Return the multiple of the resolution that is nearest to a value; the value where the resolution is 0.

    Held by: tests/unit/services/sensing/test_measurement_errors.py
    """
    return math.floor(value / resolution + 0.5) * resolution if resolution != 0.0 else value


@scalar_kernel
def limit_value(value: float, max_value: float, least_value: float) -> float:
    """Return a value within +- `max_value`, and never below `least_value`.

    Held by: tests/unit/services/sensing/test_measurement_errors.py
    """
    return max(min(max(value, -max_value), max_value), least_value)


@dataclass(frozen=True, kw_only=True)
class MeasurementErrors:
    """The usual errors of an instrument, in the unit of its readings; those that a sensor does not have are off."""

    noise_std: float = 0.0
    bias: float = 0.0
    drift_per_s: float = 0.0
    max_value: float = math.inf
    gain_spread: float = 0.0
    drift_spread_per_s: float = 0.0
    resolution: float = 0.0


def read_errors(kind: SensorKind, spec: SensorSpec) -> MeasurementErrors:
    """Return the errors that a scenario gives an instrument outside of its model."""
    noise_std = spec.noise_std if isinstance(spec, NoisySensorSpec) and not kind.has_own_noise else 0.0
    if not isinstance(spec, MeasuringSensorSpec):
        return MeasurementErrors(noise_std=noise_std)
    return MeasurementErrors(
        noise_std=noise_std,
        bias=spec.bias,
        drift_per_s=spec.drift_per_s,
        max_value=math.inf if spec.max_value is None else spec.max_value,
        gain_spread=spec.gain_spread,
        drift_spread_per_s=spec.drift_spread_per_s,
        resolution=spec.resolution,
    )


def lag_frac(t90_s: float, tick_s: float) -> float:
    """Return the fraction of its gap that an instrument closes in a tick; 1 without a lag.

    f = 1 - exp(-dt ln 10 / t90)        a first-order lag shows nine tenths of a step after t90
    """
    return -elementary.expm1(-tick_s * elementary.log(10.0) / t90_s) if t90_s > 0.0 else 1.0


@scalar_kernel
def follow(shown: float, true: float, frac: float) -> float:
    """Return the output of an instrument that closes a fraction of its gap; the truth itself for 1."""
    return true if frac == 1.0 else shown + frac * (true - shown)


class ImperfectSensor:
    """A model behind a delay, with errors on its values, read at its own rate.

    In this order: the model sees the sample of `delay_s` ago (the first one until then); each value v becomes
    gain v + bias + drift t + N(0, noise_std), t the time since the start, where the unit has a gain of
    exp(N(0, gain_spread)) and a drift of drift_per_s + N(0, drift_spread_per_s); values are kept within +- `max_value`
    (`is_saturated` reports a cut), never fall below the kind's `least_value`, and are rounded to the `resolution`;
    between readings, `period_s` apart, the last one is repeated. Until `warm_up_s` after the start a reading
    `is_warming_up`: its values are those of the first one. Units are the reading's.

    State: samples within the delay, the last reading, the number of the tick. When made it draws the unit's gain and
    drift, where units differ: each run has another unit. Draws one number for each value at each reading, after the
    model's own draws; none where `noise_std` is 0 or is the model's. All from the sensor's own stream.
    Values past the kind's first `n_with_errors`, such as a direction behind a speed, stay as the model has them.
    Held by: tests/unit/services/sensing/test_measurement_errors.py
    """

    def __init__(
        self, model: SensorModel, kind: SensorKind, spec: SensorSpec, tick_ns: int, rng: np.random.Generator
    ) -> None:
        self._model = model
        self._kind = kind
        self._spec = spec
        self._tick_s = tick_ns / NS_PER_S
        self._errors = read_errors(kind, spec)
        self._rng = rng
        self.gain = draw_gain(self._errors.gain_spread, rng)
        self._drift_per_s = draw_drift(self._errors.drift_per_s, self._errors.drift_spread_per_s, rng)
        self._period_ticks = _delay_ticks(spec.period_s, tick_ns, f"sensor {spec.name}: period_s") or 1
        delay_ticks = _delay_ticks(spec.delay_s or None, tick_ns, f"sensor {spec.name}: delay_s")
        self._seen: deque[tuple[Any, Vec3]] = deque(maxlen=delay_ticks + 1)
        self._warm_up_ticks = _delay_ticks(spec.warm_up_s or None, tick_ns, f"sensor {spec.name}: warm_up_s")
        self._tick = -1
        self._last: Reading | None = None
        self._cold: Reading | None = None

    def read(self, sample: Any, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the reading that holds at the end of the tick."""
        self._tick += 1
        self._seen.append((sample, mount_velocity_world_m_s))
        reading = self._model.read(*self._seen[0])
        if self._last is None or self._tick % self._period_ticks == 0:
            self._last = self._with_errors(reading)
        if self._tick >= self._warm_up_ticks:
            return self._last
        self._cold = self._cold or self._last.model_copy(update={"is_warming_up": True})
        return self._cold

    def calibrated(self, reading: Reading) -> Reading:
        """Return a reading as a unit of the model's nominal gain would show it."""
        if self.gain == 1.0:
            return reading
        values = [value / self.gain for value in reading.values[: self._kind.n_with_errors]]
        return msgspec.structs.replace(reading, values=(*values, *reading.values[len(values) :]))

    def _with_errors(self, reading: Reading) -> Reading:
        errors, n, least = self._errors, self._kind.n_with_errors, self._kind.least_value
        size = (self.gain, errors.bias, self._drift_per_s, self._tick, self._tick_s, errors.noise_std)
        values = [add_errors(value, *size, self._rng) for value in reading.values[:n]]
        is_over = errors.max_value < math.inf and max(map(abs, values)) >= errors.max_value
        shown = [quantize(limit_value(value, errors.max_value, least), errors.resolution) for value in values]
        shown += reading.values[len(shown) :]
        is_saturated = reading.is_saturated or is_over
        return msgspec.structs.replace(reading, values=tuple(shown), is_saturated=is_saturated)


def build_sensor(kind: SensorKind, spec: SensorSpec, tick_ns: int, rng: np.random.Generator) -> SensorModel:
    """Return a new instrument as its scenario describes it.

    Raises:
        ScenarioError: its rate or delay is not a whole number of ticks.
    """
    model = kind.build(spec, tick_ns / NS_PER_S, rng)
    return ImperfectSensor(model, kind, spec, tick_ns, rng) if is_imperfect(kind, spec) else model


def is_imperfect(kind: SensorKind, spec: SensorSpec) -> bool:
    """Return whether an instrument is more than its model: late, slow to read, cold at first, or with errors."""
    is_timed = spec.delay_s or spec.warm_up_s or spec.period_s is not None
    return bool(is_timed) or read_errors(kind, spec) != MeasurementErrors()


def _delay_ticks(duration_s: float | None, tick_ns: int, name: str) -> int:
    if duration_s is None:
        return 0
    try:
        return exact_ticks_from_seconds(duration_s, tick_ns, name=name)
    except GslCosimError as error:
        raise ScenarioError(str(error)) from error


class GaussMarkovBias:
    """A first-order Gauss-Markov process in three axes, exact for any length of the step.

    db = -b/T dt + q dW;   over dt: b <- e^(-dt/T) b + N(0, q^2 T/2 (1 - e^(-2 dt/T)))
    [x] = [x s^(-1/2)] [s^(1/2)]

    b starts at 0; the bias is b and a constant of N(0, start_std), which stays. Draws x, y, z at the start and in each
    step.

    Source:
        RotorS and PX4's Gazebo plug-ins for the IMU, which Pegasus follows.
    Held by:
        tests/unit/services/sensing/test_navigation_sensors.py
    """

    def __init__(
        self,
        walk: Sequence[float],
        correlation_s: float,
        dt_s: float,
        rng: np.random.Generator,
        *,
        start_std: float = 0.0,
    ) -> None:
        self._keeps = decay_factor(dt_s, correlation_s)
        self._kick = [increment_std(dt_s, q, correlation_s) for q in walk]
        self._rng = rng
        self._constant: list[float] = (start_std * rng.standard_normal(3)).tolist()
        self._wandering = [0.0, 0.0, 0.0]

    # In plain numbers: for three of them numpy takes longer.
    def step(self) -> list[float]:
        """Advance by one step and return the bias, x, y, z."""
        draws = self._rng.standard_normal(3).tolist()
        kept, steps = self._keeps, zip(self._wandering, self._kick, draws, strict=True)
        self._wandering = [kept * b + kick * draw for b, kick, draw in steps]
        return [constant + b for constant, b in zip(self._constant, self._wandering, strict=True)]


def decay_factor(dt_s: float, correlation_s: float) -> float:
    """Return the fraction of a Gauss-Markov bias that is left after some time: e^(-dt/T)."""
    return elementary.exp(-dt_s / correlation_s)


def increment_std(dt_s: float, walk: float, correlation_s: float) -> float:
    """Return the standard deviation added to a Gauss-Markov bias in a time: q sqrt(T/2 (1 - e^(-2 dt/T)))."""
    return walk * math.sqrt(-correlation_s / 2 * elementary.expm1(-2 * dt_s / correlation_s))
