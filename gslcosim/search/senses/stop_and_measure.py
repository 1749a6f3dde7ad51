"""Stop and measure: the combined readings of a hold, and the wind to trust in calm air."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Observation
from gslcosim.search.senses.hit_detection import is_more_gas
from gslcosim.search.senses.instruments import Nose, Vane

# A vehicle that does one of these stands still: its readings belong together.
_AT_REST = ("holding", "on_ground")
# A vehicle that is this far from where its hold began is on another hold, whatever it did between.
_ELSEWHERE_M = 0.25


@dataclass(frozen=True, kw_only=True)
class MeasuredWind:
    """The wind over a hold: mean speed, mean direction it comes from, and how steady that was, from 0 to 1."""

    speed_m_s: float
    upwind_rad: float
    steadiness_frac: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """Means over a hold. `values`, `amounts` and `ppm` are by nose; `wind` is absent without a vane."""

    position_world_m: Vec3
    values: tuple[float, ...]
    amounts: tuple[float, ...]
    ppm: tuple[float, ...]
    wind: MeasuredWind | None
    n_samples: int


# What one observation adds to a measurement.
@dataclass(frozen=True, kw_only=True)
class _Sample:
    time_s: float
    position_m: Vec3
    values: tuple[float, ...]
    amounts: tuple[float, ...]
    ppm: tuple[float, ...]
    speed_m_s: float = 0.0
    upwind_rad: float = 0.0


class StopAndMeasure:
    """Averages noses and vane over the hold that the vehicle is in, or over its last `window_s`.

    Call `add` with every observation, from `Agent.observe`; calling it again for the same tick does no harm. While the
    vehicle moves there is no hold, and a measurement is that of the last observation. Observations at which an
    instrument warms up are left out.

    State: the samples of this hold, and where it began.

    Source:
        Stop and measure as in the MAPIR group's methods: 2 s, direction = atan2(sum sin, sum cos), the speed
        apart [C].
    Held by:
        tests/unit/search/senses/test_stop_and_measure.py
    """

    def __init__(self, noses: Sequence[Nose], vane: Vane | None = None, *, window_s: float = math.inf) -> None:
        """Begin without samples.

        Args:
            noses: What to average, in this order.
            vane: The anemometer to average, if any.
            window_s: Older samples than this are left out [s].
        """
        self._noses, self._vane, self._window_s = tuple(noses), vane, window_s
        self._samples: list[_Sample] = []
        self._hold_at_m: Vec3 | None = None
        self._last_tick: int | None = None

    def add(self, observation: Observation) -> None:
        """Take note of an observation."""
        if observation.tick == self._last_tick:
            return
        self._last_tick = observation.tick
        if not self._goes_on(observation):
            self._samples.clear()
            self._hold_at_m = observation.position_world_m if observation.status in _AT_REST else None
        if self._are_ready(observation):
            self._samples.append(self._sample(observation))
        while self._samples and self._samples[0].time_s < observation.time_s - self._window_s:
            self._samples.pop(0)

    def measured(self) -> Measurement | None:
        """Return the means of this hold; absent while the instruments warm up."""
        samples = self._samples
        if not samples:
            return None
        return Measurement(
            position_world_m=_mean3([sample.position_m for sample in samples]),
            values=_means([sample.values for sample in samples]),
            amounts=_means([sample.amounts for sample in samples]),
            ppm=_means([sample.ppm for sample in samples]),
            wind=None if self._vane is None else mean_wind([(s.speed_m_s, s.upwind_rad) for s in samples]),
            n_samples=len(samples),
        )

    # Whether the hold that was before this observation goes on with it.
    def _goes_on(self, observation: Observation) -> bool:
        if self._hold_at_m is None or observation.status not in _AT_REST:
            return False
        return math.dist(self._hold_at_m, observation.position_world_m) <= _ELSEWHERE_M

    def _are_ready(self, observation: Observation) -> bool:
        instruments: tuple[Nose | Vane, ...] = (*self._noses, *([self._vane] if self._vane else []))
        return all(instrument.is_ready(observation) for instrument in instruments)

    def _sample(self, observation: Observation) -> _Sample:
        return _Sample(
            time_s=observation.time_s,
            position_m=observation.position_world_m,
            values=tuple(nose.value(observation) for nose in self._noses),
            amounts=tuple(nose.amount(observation) for nose in self._noses),
            ppm=tuple(nose.ppm(observation) for nose in self._noses),
            speed_m_s=self._vane.speed_m_s(observation) if self._vane else 0.0,
            upwind_rad=self._vane.upwind_rad(observation) if self._vane else 0.0,
        )


class GasIncrease:
    """Compares the gas of each decision with that of the one before.

    State: the readings of this hold, and the reading of the last decision.

    Held by:
        tests/unit/search/senses/test_stop_and_measure.py
    """

    def __init__(self, nose: Nose, *, eps: float, is_mean: bool) -> None:
        """Begin without a reading to compare with.

        Args:
            nose: Whose readings.
            eps: Dead band, see `is_more_gas`.
            is_mean: Whether a reading is the mean over the hold, or the last one of it.
        """
        self.value: float | None = None
        self._nose, self._eps, self._is_mean = nose, eps, is_mean
        self._stop = StopAndMeasure([nose])
        self._before: float | None = None

    def add(self, observation: Observation) -> None:
        """Take note of an observation, from `Agent.observe`."""
        if self._is_mean:
            self._stop.add(observation)

    def has_more(self, observation: Observation) -> bool:
        """Return whether there is more gas than at the last decision; the first time there is not.

        `value` is then the reading in the sensor's unit, absent while the sensor warms up.
        """
        amount, self.value = self._read(observation)
        if amount is None:
            return False
        before, self._before = self._before, amount
        return before is not None and is_more_gas(amount, before, eps=self._eps)

    def _read(self, observation: Observation) -> tuple[float | None, float | None]:
        if self._is_mean:
            self._stop.add(observation)
            measured = self._stop.measured()
            return (None, None) if measured is None else (measured.amounts[0], measured.values[0])
        if not self._nose.is_ready(observation):
            return None, None
        return self._nose.amount(observation), self._nose.value(observation)


class TrustedWind:
    """Remembers the direction of the last wind that was strong enough to have one: calm air gives noise.

    State: that direction, and whether the air is calm now.

    Held by:
        tests/unit/search/senses/test_stop_and_measure.py
    """

    def __init__(self, *, threshold_m_s: float = 0.1, least_steadiness_frac: float = 0.0) -> None:
        """Begin without a wind.

        Args:
            threshold_m_s: A wind no faster than this has no direction [m/s].
            least_steadiness_frac: Nor has one whose directions agree less than this.
        """
        self.upwind_rad: float | None = None
        self.is_calm = True
        self._threshold_m_s, self._least_steadiness_frac = threshold_m_s, least_steadiness_frac

    def add(self, wind: MeasuredWind) -> float | None:
        """Take note of a wind; return the direction to trust [rad], absent as long as there was none."""
        is_steady = wind.steadiness_frac >= self._least_steadiness_frac
        self.is_calm = not (wind.speed_m_s > self._threshold_m_s and is_steady)
        if not self.is_calm:
            self.upwind_rad = wind.upwind_rad
        return self.upwind_rad


def circular_mean_rad(angles_rad: Sequence[float]) -> tuple[float, float]:
    """Return the mean direction of angles, in [-pi, pi] [rad], and how well they agree.

    mean = atan2(sum sin a, sum cos a);  agreement = sqrt((sum sin a)^2 + (sum cos a)^2) / n
    The agreement is 1 where all are equal and 0 where they cancel each other (the mean then has no meaning).

    Source:
        Mardia and Jupp 2000, Directional Statistics, section 2.2 (textbook definition).
    Held by:
        tests/unit/search/senses/test_stop_and_measure.py
    """
    n = max(1, len(angles_rad))
    sine = math.fsum(math.sin(angle) for angle in angles_rad) / n
    cosine = math.fsum(math.cos(angle) for angle in angles_rad) / n
    return math.atan2(sine, cosine), math.hypot(sine, cosine)


def mean_wind(winds: Sequence[tuple[float, float]]) -> MeasuredWind:
    """Return the mean of readings (speed_m_s, upwind_rad): the mean of the speeds, and the circular mean direction.

    The speed is not that of the mean vector: gusts from two sides do not cancel.
    """
    upwind_rad, steadiness_frac = circular_mean_rad([upwind for _, upwind in winds])
    speed_m_s = math.fsum(speed for speed, _ in winds) / max(1, len(winds))
    return MeasuredWind(speed_m_s=speed_m_s, upwind_rad=upwind_rad, steadiness_frac=steadiness_frac)


def _means(rows: list[tuple[float, ...]]) -> tuple[float, ...]:
    return tuple(_mean(column) for column in zip(*rows, strict=True))


def _mean3(places_m: list[Vec3]) -> Vec3:
    x_m, y_m, z_m = _means(list(places_m))
    return x_m, y_m, z_m


# Plain sums: a reading without resistance has an infinite amount, which fsum refuses beside others.
def _mean(values: tuple[float, ...]) -> float:
    return sum(values) / len(values)
