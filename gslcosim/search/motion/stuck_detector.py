"""Stuck detector: notices that many legs have led nowhere, as in an eddy.

Where the wind turns in a circle, "upwind" leads a reactive search round the eddy for ever. The stuck detector notices.
"""

import math
from collections import deque
from collections.abc import Sequence


class StuckDetector:
    """The places of the last legs; it is wound up when all of them lie close together.

    wound up: n places noted, and |p_k - mean(p)| <= R for each of the last n        n legs, R radius [m]

    Source:
        Ours, against a known fault of searches that follow the wind.
    Held by:
        tests/unit/search/motion/test_stuck_detector.py
    """

    def __init__(self, *, n_legs: int, radius_m: float) -> None:
        """Begin without places.

        Args:
            n_legs: How many legs must end close together; 0 switches it off.
            radius_m: How close to their mean [m].
        """
        self._places_m: deque[tuple[float, float]] = deque(maxlen=max(n_legs, 1))
        self._n_legs = n_legs
        self._radius_m = radius_m

    def note(self, place_m: Sequence[float]) -> None:
        """Take note of where a leg has ended, world frame [m]; a height is left out."""
        self._places_m.append((float(place_m[0]), float(place_m[1])))

    @property
    def is_stuck(self) -> bool:
        """True if the last legs have led nowhere."""
        if self._n_legs == 0 or len(self._places_m) < self._n_legs:
            return False
        x_m = math.fsum(x for x, _ in self._places_m) / self._n_legs
        y_m = math.fsum(y for _, y in self._places_m) / self._n_legs
        return all(math.hypot(x - x_m, y - y_m) <= self._radius_m for x, y in self._places_m)

    def release(self) -> None:
        """Forget all places: the vehicle leaves, or stays for a reason."""
        self._places_m.clear()
