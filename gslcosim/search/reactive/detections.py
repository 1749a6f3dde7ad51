"""Where a plume was lost, again and again: near its source these places draw together."""

import math
from collections.abc import Sequence

from gslcosim.quantities import Vec3
from gslcosim.search.moving.declaring import Estimate


class LastDetections:
    """The places farthest up the wind at which gas was met last before it was lost.

    u(p) = (p - o) . (cos w, sin w)        along the wind, w where it comes from; o any place
    declares: n places, and max u - min u < spread over the n of greatest u; the source is at their greatest u

    A search that goes up a plume loses it here and there, and always just behind its source: there the places farthest
    up the wind lie close together. The confidence is the share of them within `spread_m` of the estimate in the plane.

    State: the n places. The wind of the moment sorts them.

    Source:
        Li, Farrell, Pang, Arrieta 2006, doi:10.1109/TRO.2006.870627: six places, 4 m at sea (remembered, unverified).
    Deviation:
        The spread is scaled to rooms.
    Held by:
        tests/unit/search/reactive/test_detections.py
    """

    def __init__(self, *, n: int, spread_m: float) -> None:
        """Begin without places.

        Args:
            n: How many places must agree.
            spread_m: Within which length along the wind [m].
        """
        self._n = n
        self._spread_m = spread_m
        self.places_m: list[Vec3] = []

    def add(self, place_m: Vec3, upwind_rad: float) -> None:
        """Take note of the last place with gas before it was lost, world frame [m]; the farthest downwind goes."""
        self.places_m.append(place_m)
        self.places_m.sort(key=lambda place: -_along_m(place, upwind_rad))
        del self.places_m[self._n :]

    def estimate(self, upwind_rad: float) -> Estimate | None:
        """Return where the source is, once the places have drawn together."""
        if len(self.places_m) < self._n:
            return None
        ordered = sorted(self.places_m, key=lambda place: -_along_m(place, upwind_rad))
        if _along_m(ordered[0], upwind_rad) - _along_m(ordered[-1], upwind_rad) >= self._spread_m:
            return None
        n_near = sum(math.dist(place[:2], ordered[0][:2]) <= self._spread_m for place in ordered)
        return Estimate(position_m=ordered[0], confidence=n_near / self._n)


def _along_m(place_m: Sequence[float], upwind_rad: float) -> float:
    return place_m[0] * math.cos(upwind_rad) + place_m[1] * math.sin(upwind_rad)
