"""What real instruments add to any model: delay, noise, bias, drift, saturation and a rate of their own."""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from gslcosim.contract.messages import Reading
from gslcosim.errors import GslCosimError, ScenarioError
from gslcosim.quantities import Vec3
from gslcosim.scenario.models.sensor_base import MeasuringSensorSpec, NoisySensorSpec, SensorSpec
from gslcosim.sensing.models.base import SensorKind, SensorModel
from gslcosim.ticks import NS_PER_S, exact_ticks_from_seconds


@dataclass(frozen=True, kw_only=True)
class _Errors:
    """The usual errors of an instrument, in the unit of its readings; those that a sensor does not have are off."""

    noise_std: float = 0.0
    bias: float = 0.0
    drift_per_s: float = 0.0
    max_value: float | None = None


def _errors_of(kind: SensorKind, spec: SensorSpec) -> _Errors:
    noise_std = spec.noise_std if isinstance(spec, NoisySensorSpec) and not kind.has_own_noise else 0.0
    if not isinstance(spec, MeasuringSensorSpec):
        return _Errors(noise_std=noise_std)
    return _Errors(noise_std=noise_std, bias=spec.bias, drift_per_s=spec.drift_per_s, max_value=spec.max_value)


class ImperfectSensor:
    """A model behind a delay, with errors on its values, read at its own rate.

    In this order: the model sees the sample of `delay_s` ago (the first one until then); each value v becomes
    v + bias + drift_per_s t + N(0, noise_std), t the time since the start; values are kept within +- `max_value`, and
    `is_saturated` says so, and never fall below the kind's `least_value`; between readings, `period_s` apart, the last
    one is repeated. Until `warm_up_s` after the start a reading `is_warming_up`: its values are those of the first one.
    Units are the reading's.

    State: samples within the delay, the last reading, the number of the tick. Draws one number for each value at each
    reading, from the sensor's own stream, after the model's own draws; none where `noise_std` is 0 or is the model's.
    Values past the kind's first `n_with_errors`, such as a direction behind a speed, stay as the model has them.
    Held by: tests/unit/sensing/test_imperfect.py
    """

    def __init__(
        self, model: SensorModel, kind: SensorKind, spec: SensorSpec, tick_ns: int, rng: np.random.Generator
    ) -> None:
        self._model = model
        self._kind = kind
        self._spec = spec
        self._tick_s = tick_ns / NS_PER_S
        self._errors = _errors_of(kind, spec)
        self._rng = rng
        self._period_ticks = _ticks(spec.period_s, tick_ns, f"sensor {spec.name}: period_s") or 1
        delay_ticks = _ticks(spec.delay_s or None, tick_ns, f"sensor {spec.name}: delay_s")
        self._seen: deque[tuple[Any, Vec3]] = deque(maxlen=delay_ticks + 1)
        self._warm_up_ticks = _ticks(spec.warm_up_s or None, tick_ns, f"sensor {spec.name}: warm_up_s")
        self._tick = -1
        self._last: Reading | None = None
        self._cold: Reading | None = None

    def read(self, sample: Any, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the reading that holds at the end of the tick; see `SensorModel.read`."""
        self._tick += 1
        self._seen.append((sample, mount_velocity_world_m_s))
        reading = self._model.read(*self._seen[0])
        if self._last is None or self._tick % self._period_ticks == 0:
            self._last = self._with_errors(reading)
        if self._tick >= self._warm_up_ticks:
            return self._last
        self._cold = self._cold or self._last.model_copy(update={"is_warming_up": True})
        return self._cold

    def _with_errors(self, reading: Reading) -> Reading:
        n, limit = self._kind.n_with_errors, self._errors.max_value
        values = [self._disturbed(value) for value in reading.values[:n]]
        is_over = limit is not None and max(map(abs, values)) >= limit
        if limit is not None:
            values = [min(max(value, -limit), limit) for value in values]
        values = [max(value, self._kind.least_value) for value in values]
        return reading.model_copy(
            update={
                "values": (*values, *reading.values[len(values) :]),
                "is_saturated": reading.is_saturated or is_over,
            }
        )

    def _disturbed(self, value: float) -> float:
        errors = self._errors
        offset = errors.bias + errors.drift_per_s * self._tick * self._tick_s
        if errors.noise_std == 0.0:
            return value + offset
        return value + offset + errors.noise_std * float(self._rng.standard_normal())


def build_sensor(kind: SensorKind, spec: SensorSpec, tick_ns: int, rng: np.random.Generator) -> SensorModel:
    """Return a new instrument as its scenario describes it.

    Raises:
        ScenarioError: its rate or delay is not a whole number of ticks.
    """
    model = kind.build(spec, tick_ns / NS_PER_S, rng)
    is_timed = spec.delay_s or spec.warm_up_s or spec.period_s is not None
    if not is_timed and _errors_of(kind, spec) == _Errors():
        return model
    return ImperfectSensor(model, kind, spec, tick_ns, rng)


def _ticks(duration_s: float | None, tick_ns: int, name: str) -> int:
    if duration_s is None:
        return 0
    try:
        return exact_ticks_from_seconds(duration_s, tick_ns, name=name)
    except GslCosimError as error:
        raise ScenarioError(str(error)) from error
