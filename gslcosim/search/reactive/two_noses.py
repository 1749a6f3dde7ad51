"""Bearing of gas by two noses side by side, without any wind."""

import math
from collections import deque

from gslcosim.contract.messages import Briefing, Observation
from gslcosim.search.senses.hit_detection import BoutDetector
from gslcosim.search.senses.instruments import Nose, find_noses


def bearing_rad(left: float, right: float, gain: float) -> float:
    """Return from which side gas comes by what two noses read, positive to the left [rad].

    phi = asin(min(1, max(-1, g (l - r) / (l + r))))        l, r amounts, g gain; 0 without gas

    Source:
        Ours, in place of the lag between the noses in Chasing Ghosts (arXiv 2602.19577), which needs samples much
        faster than the gas crosses 15 cm.
    Held by:
        tests/unit/search/reactive/test_two_noses.py
    """
    if not (left + right > 0.0 and math.isfinite(left + right)):
        return 0.0
    return math.asin(max(-1.0, min(1.0, gain * (left - right) / (left + right))))


def turn_rad(bearing: float, *, straight_rad: float, half_rad: float) -> float:
    """Return the turn towards gas: none for a small bearing, half a right angle for a medium one, else a right angle.

    |phi| < straight: 0; |phi| <= half: half to its side; above: pi / 2 to its side

    Source:
        Chasing Ghosts (arXiv 2602.19577), read in code: 5 and 45 degrees.
    Held by:
        tests/unit/search/reactive/test_two_noses.py
    """
    if abs(bearing) < straight_rad:
        return 0.0
    return math.copysign(half_rad if abs(bearing) <= half_rad else math.pi / 2.0, bearing)


class TwoNoses:
    """Watches the leftmost and the rightmost gas sensor: bouts of either, and the means of the last `window_s`.

    State: two bout detectors, the amounts of the window, and whether there was a bout since `take` was called.

    Held by:
        tests/unit/search/reactive/test_two_noses.py
    """

    def __init__(self, briefing: Briefing, *, sample_s: float, window_s: float, threshold_ppm: float) -> None:
        """Begin without gas.

        Args:
            briefing: Its gas sensors; the body's y axis points to the left.
            sample_s: Time that one sample of the bout detector's spans stands for [s].
            window_s: Over how long amounts are averaged [s].
            threshold_ppm: Least amount that is gas.
        """
        noses = sorted(find_noses(briefing), key=lambda nose: -nose.mount_body_m[1])
        self._noses: tuple[Nose, Nose] = (noses[0], noses[-1])
        self._bouts = tuple(BoutDetector(sample_s=sample_s) for _ in self._noses)
        self._window_s = window_s
        self._threshold_ppm = threshold_ppm
        self._amounts: deque[tuple[float, float, float]] = deque()
        self._had_bout = False

    def add(self, observation: Observation) -> None:
        """Take note of an observation; a time counts once."""
        if not all(nose.is_ready(observation) for nose in self._noses):
            return
        if self._amounts and observation.time_s <= self._amounts[-1][0]:
            return
        left, right = (min(nose.ppm(observation), 1e9) for nose in self._noses)
        self._amounts.append((observation.time_s, left, right))
        while self._amounts[0][0] < observation.time_s - self._window_s:
            self._amounts.popleft()
        for bouts, ppm in zip(self._bouts, (left, right), strict=True):
            if bouts.add(observation.time_s, ppm) and ppm > self._threshold_ppm:
                self._had_bout = True

    def take(self) -> bool:
        """Return whether either nose had a bout since the last call, and forget it."""
        had_bout, self._had_bout = self._had_bout, False
        return had_bout

    def means(self) -> tuple[float, float]:
        """Return the mean amounts of the window, left and right."""
        n = max(1, len(self._amounts))
        return math.fsum(left for _, left, _ in self._amounts) / n, math.fsum(right for *_, right in self._amounts) / n
