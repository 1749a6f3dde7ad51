"""Detections and their absence for methods that learn from both: at most one finding in a span of time, or none."""

import math
from collections import deque
from dataclasses import dataclass

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Observation
from gslcosim.search.senses.hit_detection import GasHits, OnsetDetector
from gslcosim.search.senses.instruments import Nose

# A MOX sensor's onset is smoothed over about this long: the gas was met where the vehicle was then.
MOX_LAG_S = 1.0
# Spans are whole ticks: a share of a tick decides nothing.
_ROUNDING_S = 1e-6


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Gas was detected in a span of time, or the air was clean all through it; at `sensor_m`, world frame [m]."""

    is_hit: bool
    sensor_m: Vec3


class GasEvidence:
    """Turns the readings of one nose into findings, one for each `every_s`: call `add` with every observation.

    hit: there was one by the rule of `hits.GasHits` within the span
    clean: there was none, and the sensor could have told: a MOX sensor that recovers, or whose ln R lies more than
    `level` below the highest that was seen, still shows gas of before, and is no evidence for clean air
    Otherwise, and while the sensor warms up, there is no finding.

    State: the rule of the hits, the highest ln R, the last second's places, and what was found in this span so far.

    Source:
        Ours: a MOX sensor that lags knows a third state between gas and none.
    Held by:
        tests/unit/search/senses/test_gas_evidence.py
    """

    def __init__(self, nose: Nose, *, every_s: float = 1.0, threshold_ppm: float = 0.1, level: float = 0.1) -> None:
        """Begin without findings.

        Args:
            nose: The gas sensor.
            every_s: How long a span is [s]; findings closer together are hardly independent.
            threshold_ppm: What counts as gas, for sensors in ppm.
            level: Fall of ln R that counts as gas still shown, for sensors in ohms.
        """
        self.nose = nose
        self._onset = OnsetDetector()
        self._hits = GasHits(nose, threshold_ppm=threshold_ppm, onset=self._onset)
        self._every_s, self._level = every_s, level
        self._lag_s = MOX_LAG_S if nose.unit == "ohm" else 0.0
        self._highest_log_ohm = -math.inf
        self._track: deque[tuple[float, Vec3]] = deque()
        self._span_ends_s: float | None = None
        self._is_unclear = False
        self._last_tick: int | None = None

    @property
    def is_hit(self) -> bool:
        """True if there is a hit at the last observation."""
        return self._hits.is_hit

    def since_hit_s(self, time_s: float) -> float:
        """Return how long ago the last hit was [s], infinite without one."""
        return self._hits.since_hit_s(time_s)

    def add(self, observation: Observation) -> Finding | None:
        """Take note of an observation; return the finding of the span that ends with it, if there is one."""
        if observation.tick == self._last_tick:
            return None
        self._last_tick = observation.tick
        self._follow(observation)
        self._hits.add(observation)
        self._is_unclear |= not self.nose.is_ready(observation) or self._still_shows_gas(observation)
        if self._span_ends_s is None:
            self._span_ends_s = observation.time_s + self._every_s
        if observation.time_s < self._span_ends_s - _ROUNDING_S:
            return None
        self._span_ends_s = observation.time_s + self._every_s
        was_hit, was_unclear = self._hits.take(), self._is_unclear
        self._is_unclear = False
        return Finding(is_hit=was_hit, sensor_m=self._track[0][1]) if was_hit or not was_unclear else None

    # Keeps where the vehicle was as long ago as the sensor lags.
    def _follow(self, observation: Observation) -> None:
        self._track.append((observation.time_s, observation.position_world_m))
        while len(self._track) > 1 and self._track[1][0] <= observation.time_s - self._lag_s + _ROUNDING_S:
            self._track.popleft()

    def _still_shows_gas(self, observation: Observation) -> bool:
        if self.nose.unit != "ohm":
            return False
        ohm = self.nose.value(observation)
        if ohm <= 0.0:
            return True
        if self.nose.is_ready(observation):
            self._highest_log_ohm = max(self._highest_log_ohm, math.log(ohm))
        return self._onset.is_offset or math.log(ohm) < self._highest_log_ohm - self._level
