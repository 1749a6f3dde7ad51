"""Stop and measure: combined readings of a hold, proximity to the source, and contact with the plume.

Held by:
    extensions/search/tests/unit/senses/test_stop_and_measure.py
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Briefing, Observation
from gslcosim_search import elementary
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.senses.hit_detection import GasHits, is_more_gas
from gslcosim_search.senses.instruments import Nose, Vane, find_noses, find_vanes

# A vehicle that does one of these stands still: its readings belong together.
_AT_REST = ("holding", "on_ground")
# A vehicle that is this far from where its hold began is on another hold, whatever it did between.
_ELSEWHERE_M = 0.25
# A MOX sensor's hits come late: its onset is smoothed over about this long.
MOX_LAG_S = 1.0


def local_maxima(samples: Sequence[float]) -> list[float]:
    """Return the peaks of a series: samples above the one before and not below the one after; the ends are none.

    A plateau counts once.
    """
    return [b for a, b, c in zip(samples, samples[1:], samples[2:]) if b > a and b >= c]


def proximity_index(
    samples: Sequence[float], interval_s: float, *, mean_weight: float = 0.5, peak_weight: float = 1.0
) -> float:
    """Return the proximity index of a source: it grows with the mean reading and with the number and height of peaks.

    PI = K_mu mean(c) + K_p dt sum of local maxima of c        c samples of one stop, dt time between them [s]
    [ppm] = [1] [ppm] + [1/s] [s] [ppm]

    Peaks matter because in still air a plume is a train of bursts that blur with the distance.

    Args:
        samples: Gas of one stop, in any unit that grows with it; without samples the index is 0.
        interval_s: Time between them [s].
        mean_weight: K_mu.
        peak_weight: K_p [1/s].

    Source:
        Ferri, Caselli, Mattoli, Mondini, Mazzolai, Dario 2009, Robotics and Autonomous Systems 57, 393-402; weights
        as read in the MAPIR group's code.
    """
    if not samples:
        return 0.0
    mean = sum(samples) / len(samples)
    return mean_weight * mean + peak_weight * interval_s * sum(local_maxima(samples))


class BestProximity:
    """The best index so far, which is halved when nothing comes near to it for too long.

    better: PI > best, which makes it the best; after more than `n_misses` that are not better, best <- best / 2

    Source:
        Ferri et al. 2009; 3 misses as read in the MAPIR group's code.
    """

    def __init__(self, *, n_misses: int = 3) -> None:
        """Begin with a best of 0."""
        self.best = 0.0
        self._n_allowed = n_misses
        self._n_misses = 0

    def is_better(self, index: float) -> bool:
        """Take note of the index of a stop; return whether it is better than the best before."""
        if index > self.best:
            self.best, self._n_misses = index, 0
            return True
        self._n_misses += 1
        if self._n_misses > self._n_allowed:
            self.best, self._n_misses = self.best / 2.0, 0
        return False


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
        return distance(self._hold_at_m, observation.position_world_m) <= _ELSEWHERE_M

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
    """

    def __init__(self, nose: Nose, *, eps: float, is_mean: bool) -> None:
        """Begin without a reading to compare with.

        Args:
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
        """Return True if there is more gas than at the last decision; the first time there is not.

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
    """
    n = max(1, len(angles_rad))
    sine = math.fsum(elementary.sin(angle) for angle in angles_rad) / n
    cosine = math.fsum(elementary.cos(angle) for angle in angles_rad) / n
    return elementary.atan2(sine, cosine), norm2(sine, cosine)


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


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Contact with the plume, as known at a question.

    `has_gas`: whether there was a hit since the question before, and `gas_m` the mean place of these hits, `last_m`
    that of the last hit ever, world frame [m]. `since_hit_s` is how long ago that was. `upwind_rad` is the last
    direction of a wind that was strong enough to have one, absent until there was one; `is_calm` says that there is no
    such wind now. `gas_ppm` is the mean of the hold, in the nose's unit where that is no mixing ratio.
    """

    has_gas: bool
    gas_m: Vec3 | None
    last_m: Vec3 | None
    since_hit_s: float
    upwind_rad: float | None
    is_calm: bool
    gas_ppm: float

    def remaining_m(self, here_m: Sequence[float], lost_m: float) -> float:
        """Return the remaining distance without gas before the plume counts as lost [m].

        Infinite with gas on the last leg, negative where there never was any; else `lost_m` less the distance to where
        gas was met last.
        """
        if self.has_gas:
            return math.inf
        return -math.inf if self.last_m is None else lost_m - distance(self.last_m, here_m)


class PlumeContactDetector:
    """Takes note of hits and wind at every observation, so that a leg through a plume is not flown in vain.

    The rule for a hit is that of `GasHits`: a MOX sensor has one while its resistance falls or stays low, one in ppm
    while it shows more than the threshold, one that counts while it shows more than half a hit. A hit belongs to the
    place where the vehicle was `lag_s` before: 1 s for MOX sensors, none for others. The wind is the mean over the
    hold before the question, when the vehicle is at rest; without an anemometer there is none.

    State: the hits since the last question, the last one ever, the wind that was trusted last, places of the last
    second.
    """

    def __init__(self, briefing: Briefing, *, threshold_ppm: float, threshold_m_s: float) -> None:
        """Begin without gas and wind; it uses the first gas sensor and the first anemometer of the briefing."""
        nose = find_noses(briefing)[0]
        vanes = find_vanes(briefing)
        self._hits = GasHits(nose, threshold_ppm=threshold_ppm)
        self._hold = StopAndMeasure([nose], vanes[0] if vanes else None)
        self._wind = TrustedWind(threshold_m_s=threshold_m_s)
        self._lag_s = MOX_LAG_S if nose.unit == "ohm" else 0.0
        self._track: deque[tuple[float, Vec3]] = deque()
        self._hits_m: list[Vec3] = []
        self._last_m: Vec3 | None = None
        self._last_tick: int | None = None

    @property
    def is_hit(self) -> bool:
        """True if there is a hit at the last observation."""
        return self._hits.is_hit

    def add(self, observation: Observation) -> None:
        """Take note of an observation; a tick counts once."""
        if observation.tick == self._last_tick:
            return
        self._last_tick = observation.tick
        self._hold.add(observation)
        self._track.append((observation.time_s, observation.position_world_m))
        while len(self._track) > 1 and self._track[1][0] <= observation.time_s - self._lag_s:
            self._track.popleft()
        if self._hits.add(observation):
            self._last_m = self._track[0][1]
            self._hits_m.append(self._last_m)

    def contact(self, observation: Observation) -> Contact:
        """Return the current contact with the plume, and start to collect hits again."""
        self.add(observation)
        measured = self._hold.measured()
        if measured is not None and measured.wind is not None:
            self._wind.add(measured.wind)
        hits_m, self._hits_m = self._hits_m, []
        return Contact(
            has_gas=bool(hits_m),
            gas_m=_mean_place(hits_m),
            last_m=self._last_m,
            since_hit_s=self._hits.since_hit_s(observation.time_s),
            upwind_rad=self._wind.upwind_rad,
            is_calm=self._wind.is_calm,
            gas_ppm=_finite_gas(measured),
        )


def _mean_place(places_m: list[Vec3]) -> Vec3 | None:
    if not places_m:
        return None
    x_m, y_m, z_m = (math.fsum(column) / len(places_m) for column in zip(*places_m, strict=True))
    return x_m, y_m, z_m


# A broken sensor must not turn sums into infinities.
def _finite_gas(measured: Measurement | None) -> float:
    gas_ppm = 0.0 if measured is None else measured.ppm[0]
    return gas_ppm if math.isfinite(gas_ppm) else 0.0
