"""Largest reading: the place where a vehicle met the most gas on its way, whatever its gas sensor.

Held by:
    extensions/search/tests/unit/motion/test_largest_reading.py
"""

import math
from collections import deque

from gslcosim.base.quantities import BEAM_QUANTITY, Vec3
from gslcosim.contract.messages import Briefing, Observation
from gslcosim_search.motion.declaration import Estimate
from gslcosim_search.senses.hit_detection import GasLevel
from gslcosim_search.senses.instruments import Nose, find_noses

# Least mean that counts as gas by the unit of the readings. `1`: a hit or detection in half of the readings. ppm m:
# above the noise of 3 ppm m that a laser has at each reading, whose mean over 3 s has 0.5. Of ohms the level above
# clean air: half a minute's walk of a MOX sensor's baseline is 0.002, that of 1,500 s 0.015.
_THRESHOLDS = {"ppm": 0.1, "ohm": 0.1, "1": 0.5, "ppm m": 3.0}
# Time constants of a first-order lag by which readings are late: T90 / ln 10 of a PID of 3 s and a laser of 0.1 s, and
# of a TGS2600 as it rises [s].
_LAGS_S = {"ppm": 1.3, "ohm": 4.8, "1": 0.0, "ppm m": 0.05}
# Shares of a tick decide nothing.
_ROUNDING_S = 1e-6


class LargestReading:
    """Place of the largest mean of readings over a few seconds, where the sensor was when the gas met it.

    c = mean over the last `smooth_s` of the level above clean air; the largest c was met `smooth_s` / 2 + lag earlier

    A first-order lag delays what it shows by its time constant on average, and a mean over a span by half of it. A
    laser is taken before a nose, as the fastest; a reading of its beam is laid to where the vehicle is, so it should
    point up or down. Without a sensor for gas there is never an estimate.

    State: the readings and places of the last seconds, the largest mean and its place.

    Source:
        Ours: the simplest use of a nose there is, as a null for methods that do more with one.
    """

    def __init__(self, briefing: Briefing, *, smooth_s: float = 3.0, lag_s: float | None = None) -> None:
        """Begin without readings.

        Args:
            briefing: Its first laser, else its first nose, is read.
            smooth_s: Span of the mean [s].
            lag_s: By how much readings are late [s]; absent: by the sensor's unit.
        """
        self._nose = next(iter((*find_lasers(briefing), *find_noses(briefing))), None)
        self._smooth_s = smooth_s
        unit = "" if self._nose is None else self._nose.unit
        self._lag_s = _LAGS_S.get(unit, 0.0) if lag_s is None else lag_s
        self._threshold = _THRESHOLDS.get(unit, math.inf)
        self._level = None if self._nose is None else GasLevel(self._nose)
        self._levels: deque[tuple[float, float]] = deque()
        self._track: deque[tuple[float, Vec3]] = deque()
        self._most, self._most_m = -math.inf, (0.0, 0.0, 0.0)
        self._last_tick: int | None = None

    def add(self, observation: Observation) -> None:
        """Take note of an observation; a tick counts once, broken readings and those of a cold sensor do not."""
        if self._nose is None or self._level is None or observation.tick == self._last_tick:
            return
        self._last_tick = observation.tick
        time_s = observation.time_s
        self._track.append((time_s, observation.position_world_m))
        late_s = self._lag_s + self._smooth_s / 2.0
        while len(self._track) > 1 and self._track[1][0] <= time_s - late_s + _ROUNDING_S:
            self._track.popleft()
        value = self._nose.value(observation)
        if not (self._nose.is_ready(observation) and math.isfinite(value)):
            return
        self._levels.append((time_s, self._level.of(value)))
        while self._levels[0][0] < time_s - self._smooth_s - _ROUNDING_S:
            self._levels.popleft()
        mean = math.fsum(level for _, level in self._levels) / len(self._levels)
        if mean > self._most:
            self._most, self._most_m = mean, self._track[0][1]

    def estimate(self) -> Estimate | None:
        """Return the place of the largest mean; None where no gas was met.

        The confidence is what the largest mean has above the threshold, as a share of itself.
        """
        if not self._most > self._threshold:
            return None
        return Estimate(position_m=self._most_m, confidence=1.0 - self._threshold / self._most)


def find_lasers(briefing: Briefing) -> tuple[Nose, ...]:
    """Return the open-path lasers, in the briefing's order: their readings are columns [ppm m]."""
    return tuple(
        Nose(name=sensor.name, unit=sensor.unit, mount_body_m=sensor.mount_body_m)
        for sensor in briefing.sensors
        if sensor.quantity == BEAM_QUANTITY
    )
