"""Plume contact between two questions: gas since the last one, its position, and the wind there."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Briefing, Observation
from gslcosim.search.senses.hit_detection import GasHits
from gslcosim.search.senses.instruments import find_noses, find_vanes
from gslcosim.search.senses.stop_and_measure import Measurement, StopAndMeasure, TrustedWind

# A MOX sensor's hits come late: its onset is smoothed over about this long.
MOX_LAG_S = 1.0


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
        """Return how far to fly on without gas before the plume counts as lost [m].

        Infinite with gas on the last leg, negative where there never was any; else `lost_m` less the distance to where
        gas was met last.
        """
        if self.has_gas:
            return math.inf
        return -math.inf if self.last_m is None else lost_m - math.dist(self.last_m, here_m)


class PlumeContactDetector:
    """Takes note of hits and wind at every observation, so that a leg through a plume is not flown in vain.

    The rule for a hit is that of `hits.GasHits`: a MOX sensor has one while its resistance falls, one in ppm while it
    shows more than the threshold, one that counts while it shows more than half a hit. A hit belongs to the place where
    the vehicle was `lag_s` before: 1 s for MOX sensors, none for others. The wind is the mean over the hold before the
    question, when the vehicle is at rest; without an anemometer there is none.

    State: the hits since the last question, the last one ever, the wind that was trusted last, places of the last
    second.

    Held by:
        tests/unit/search/senses/test_plume_contact.py
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
        """Return what is known now, and begin to collect hits again."""
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
