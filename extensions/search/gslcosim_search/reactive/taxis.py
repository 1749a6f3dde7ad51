"""Chemotaxis: gradients fitted to readings, wheels that two noses slow down, and bearing by two noses.

Held by:
    extensions/search/tests/unit/reactive/test_taxis.py
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import MethodError
from gslcosim.contract.messages import Briefing, Observation
from gslcosim_search import elementary
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.senses.hit_detection import BoutDetector
from gslcosim_search.senses.instruments import Nose, find_noses

# Two noses nearer to each other than this tell no side [m].
_LEAST_BASE_M = 0.05
# Directions in which the places spread less than this, of the most, count as not explored.
_LEAST_SPREAD_FRAC = 1e-3


class RecentReadings:
    """Readings of the last seconds near the vehicle, to which a plane is fitted.

    State: time, place and value of each reading that is not too old.
    """

    def __init__(self, *, within_m: float, within_s: float) -> None:
        """Begin without readings; older and farther ones than this are left out."""
        self._within_m, self._within_s = within_m, within_s
        self._readings: deque[tuple[float, tuple[float, float], float]] = deque()

    def add(self, time_s: float, place_m: Sequence[float], value: float) -> None:
        """Take note of a reading of what grows with the gas; broken ones are ignored."""
        if math.isfinite(value):
            self._readings.append((time_s, (place_m[0], place_m[1]), value))
        while self._readings and self._readings[0][0] < time_s - self._within_s:
            self._readings.popleft()

    def fit(self, time_s: float, place_m: Sequence[float]) -> "GradientFit | None":
        """Return the gradient here and now; see `fit_gradient`.

        w = (1 - age / within_s) (1 - distance / within_m), 0 outside
        """
        near = [reading for reading in self._readings if self._weight(reading, time_s, place_m) > 0.0]
        weights = np.array([self._weight(reading, time_s, place_m) for reading in near])
        places_m = np.array([reading[1] for reading in near]).reshape(-1, 2)
        return fit_gradient(places_m, np.array([reading[2] for reading in near]), weights)

    def _weight(
        self, reading: tuple[float, tuple[float, float], float], time_s: float, place_m: Sequence[float]
    ) -> float:
        age, away = (time_s - reading[0]) / self._within_s, distance(reading[1], place_m[:2]) / self._within_m
        return max(0.0, 1.0 - age) * max(0.0, 1.0 - away)


@dataclass(frozen=True, kw_only=True)
class GradientFit:
    """A plane fitted to readings: its gradient [unit/m], and the standard error of its length [unit/m]."""

    gradient_per_m: tuple[float, float]
    standard_error_per_m: float

    @property
    def heading_rad(self) -> float:
        """Heading along which the gas grows, world frame [rad]."""
        return elementary.atan2(self.gradient_per_m[1], self.gradient_per_m[0])

    @property
    def is_significant(self) -> bool:
        """True if the gradient is longer than its standard error."""
        length_per_m = norm2(*self.gradient_per_m)
        return length_per_m > 0.0 and length_per_m > self.standard_error_per_m


def fit_gradient(
    positions_m: NDArray[np.float64], values: NDArray[np.float64], weights: NDArray[np.float64]
) -> GradientFit | None:
    """Return the plane that fits readings best; absent with fewer than four, or all at one place.

    c_i ~ c0 + g . (p_i - mean p), minimising sum w_i (c_i - fit_i)^2
    Cov g = s^2 (sum w (p - mean p)(p - mean p)^T)^+, s^2 = sum w r^2 / (n - 1 - rank)        means weighted by w
    [unit/m] = [unit] / [m]; the standard error is sqrt(e . Cov g e) with e along g.

    Where all places lie on a line, g is along it: what lies to its sides is not known.

    Args:
        positions_m: (n_readings, xy) places [m].
        values: (n_readings,) what grows with the gas.
        weights: (n_readings,) none negative, some positive.

    Source:
        Weighted least squares, textbook.
    """
    n = len(values)
    total = float(weights.sum())
    if n < 4 or not total > 0.0:
        return None
    share = weights * (n / total)
    offsets_m = positions_m - elementary.product(share, positions_m) / n
    rises = values - float((share * values).sum()) / n
    weighted_m = (offsets_m * share[:, None]).T
    (xx, xy), (_, yy) = elementary.product(weighted_m, offsets_m).tolist()
    inverse, rank = _invert_spread(xx, xy, yy)
    if rank == 0:
        return None
    gradient = elementary.product(inverse, elementary.product(weighted_m, rises))
    residuals = rises - elementary.product(offsets_m, gradient)
    n_free = max(1, n - 1 - rank)
    variance = float((share * np.square(residuals)).sum()) / n_free
    error = _error_along(gradient, variance * inverse)
    return GradientFit(gradient_per_m=(float(gradient[0]), float(gradient[1])), standard_error_per_m=error)


# The pseudo-inverse of ((xx, xy), (xy, yy)) and its rank; the spread is 0 on an axis on which it is small.
def _invert_spread(xx: float, xy: float, yy: float) -> tuple[NDArray[np.float64], int]:
    middle, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    away = norm2(half, xy)
    if not middle + away > 1e-9:
        return np.zeros((2, 2)), 0
    if middle - away > _LEAST_SPREAD_FRAC * _LEAST_SPREAD_FRAC * (middle + away):
        return np.array([[yy, -xy], [-xy, xx]]) / (xx * yy - xy * xy), 2
    x, y = (half + away, xy) if half >= 0.0 else (xy, away - half)
    return np.array([[x * x, x * y], [x * y, y * y]]) / ((x * x + y * y) * (middle + away)), 1


def _error_along(gradient: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    length = float(np.linalg.norm(gradient, axis=0))
    if length == 0.0:
        return math.inf
    unit = gradient / length
    return math.sqrt(max(0.0, float((unit * elementary.product(covariance, unit)).sum())))


def mount_position_m(position_m: Sequence[float], yaw_rad: float, mount_body_m: Sequence[float]) -> tuple[float, float]:
    """Return the position of a mount on a level vehicle, x and y, world frame [m].

    p + R(yaw) m        p position of the vehicle, m mount in the body frame (x forward, y left)
    """
    x_m, y_m = mount_body_m[0], mount_body_m[1]
    cosine, sine = elementary.cos(yaw_rad), elementary.sin(yaw_rad)
    return position_m[0] + cosine * x_m - sine * y_m, position_m[1] + sine * x_m + cosine * y_m


def lateral_pair(noses: Sequence[Nose]) -> tuple[Nose, Nose]:
    """Return the noses farthest to the left and to the right.

    Raises:
        MethodError: none are 0.05 m apart across the vehicle.
    """
    left = max(noses, key=lambda nose: nose.mount_body_m[1])
    right = min(noses, key=lambda nose: nose.mount_body_m[1])
    apart_m = left.mount_body_m[1] - right.mount_body_m[1]
    if apart_m < _LEAST_BASE_M:
        raise MethodError(
            f"sensors: expected two gas sensors {_LEAST_BASE_M:g} m apart across the vehicle, were {apart_m:g} m. "
            "Mount one to the left and one to the right, as in mount_m: [0, 0.2, 0] and mount_m: [0, -0.2, 0]."
        )
    return left, right


def wheel_speeds_m_s(
    left_frac: float, right_frac: float, *, most_m_s: float, gain: float, is_crossed: bool
) -> tuple[float, float]:
    """Return the speeds of the left and the right wheel of a Braitenberg vehicle with inhibition [m/s].

    v_L = v_max (1 - k x_L), v_R = v_max (1 - k x_R);  crossed: x_L and x_R change places
    [m/s] = [m/s]

    Uncrossed, it turns to the side with more gas and slows down there; crossed, it turns away and explores.

    Args:
        left_frac: x_L, the left nose, 0 to 1.
        right_frac: x_R.
        most_m_s: v_max [m/s].
        gain: k, 0 to 1.
        is_crossed: Which of the two.

    Source:
        Lilienthal and Duckett 2004, Advanced Robotics 18; k 0.9 remembered, unverified [M].
    """
    if is_crossed:
        left_frac, right_frac = right_frac, left_frac
    return most_m_s * (1.0 - gain * left_frac), most_m_s * (1.0 - gain * right_frac)


def speed_and_turn(left_m_s: float, right_m_s: float, half_base_m: float) -> tuple[float, float]:
    """Return forward speed [m/s] and rate of turn to the left [rad/s] of two wheels.

    v = (v_L + v_R) / 2, omega = (v_R - v_L) / (2 b)        b half of the distance between the wheels
    [m/s]; [rad/s] = [m/s] / [m]
    """
    return (left_m_s + right_m_s) / 2.0, (right_m_s - left_m_s) / (2.0 * half_base_m)


def bearing_rad(left: float, right: float, gain: float) -> float:
    """Return from which side gas comes by what two noses read, positive to the left [rad].

    phi = asin(min(1, max(-1, g (l - r) / (l + r))))        l, r amounts, g gain; 0 without gas

    Source:
        Ours, in place of the lag between the noses in Chasing Ghosts (arXiv 2602.19577), which needs samples much
        faster than the gas crosses 15 cm.
    """
    if not (left + right > 0.0 and math.isfinite(left + right)):
        return 0.0
    sine = max(-1.0, min(1.0, gain * (left - right) / (left + right)))
    return elementary.atan2(sine, math.sqrt((1.0 - sine) * (1.0 + sine)))


def turn_rad(bearing: float, *, straight_rad: float, half_rad: float) -> float:
    """Return the turn towards gas: none for a small bearing, half a right angle for a medium one, else a right angle.

    |phi| < straight: 0; |phi| <= half: half to its side; above: pi / 2 to its side

    Source:
        Chasing Ghosts (arXiv 2602.19577), read in code: 5 and 45 degrees.
    """
    if abs(bearing) < straight_rad:
        return 0.0
    return math.copysign(half_rad if abs(bearing) <= half_rad else math.pi / 2.0, bearing)


class TwoNoses:
    """Watches the leftmost and the rightmost gas sensor: bouts of either, and the means of the last `window_s`.

    State: two bout detectors, the amounts of the window, and whether there was a bout since `take` was called.
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
        """Return True if either nose had a bout since the last call, and forget it."""
        had_bout, self._had_bout = self._had_bout, False
        return had_bout

    def means(self) -> tuple[float, float]:
        """Return the mean amounts of the window, left and right."""
        n = max(1, len(self._amounts))
        return math.fsum(left for _, left, _ in self._amounts) / n, math.fsum(right for *_, right in self._amounts) / n
