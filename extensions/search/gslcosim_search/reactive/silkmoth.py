"""Silkmoth programme after each whiff: a surge, three turns, then a loop; and its sidestep around obstacles.

Held by:
    extensions/search/tests/unit/reactive/test_silkmoth.py
"""

import math
from dataclasses import dataclass

from gslcosim.base.scalar_kernels import norm2
from gslcosim.contract.messages import Observation
from gslcosim_search import elementary
from gslcosim_search.senses.instruments import Vane

# A moth's surge [m/s], its turns while it surges and while it zigzags [rad/s].
MOTH_SURGE_M_S = 0.019
MOTH_CRAWL_M_S = 0.0008
SURGE_TURN_RAD_S = 0.062
TURN_RAD_S = 1.3
# End of each phase after the whiff [s], and whether it turns to the side of the whiff (+1) or away from it (-1).
_TURNS = ((0.5, 1), (1.2, 1), (1.9, -1), (2.1, 1))
_CRAWL_FRAC = MOTH_CRAWL_M_S / MOTH_SURGE_M_S


class Sidestep:
    """Turns a heading by eighths of a circle, to one side, as long as its velocity is refused; then keeps the turn.

    turn = side n pi/4        n refusals since it last went straight on, side +1 to the left

    A turn is kept for some seconds after the last refusal: along a wall this is a path beside it, with a look back
    every so often whether the old heading is free again.

    State: the number of refusals, and until when the turn is kept.
    """

    def __init__(self, *, side: int, keep_s: float) -> None:
        """Begin straight on.

        Args:
            side: +1 turns to the left, -1 to the right.
            keep_s: How long a turn is kept after the last refusal [s].
        """
        self._side = side
        self._keep_s = keep_s
        self._n = 0
        self._until_s = -math.inf

    @property
    def turn_rad(self) -> float:
        """By how much the heading is turned now [rad]."""
        return self._side * self._n * 0.25 * math.pi

    def note(self, time_s: float, *, is_refused: bool) -> None:
        """Take note of whether the last velocity was refused.

        Args:
            is_refused: Whether the vehicle did not do as it was asked.
        """
        if is_refused:
            self._n = (self._n + 1) % 8
            self._until_s = time_s + self._keep_s
        elif time_s > self._until_s:
            self._n = 0


@dataclass(frozen=True, kw_only=True)
class Phase:
    """Phase of the moth: `speed_frac` of its surge, `turn_rad_s` positive towards the side of the whiff [rad/s]."""

    name: str
    speed_frac: float
    turn_rad_s: float


SURGE = Phase(name="surge", speed_frac=1.0, turn_rad_s=SURGE_TURN_RAD_S)


def phase_at(since_hit_s: float) -> Phase:
    """Return the phase at a time after the last whiff.

    time [s]    0-0.5      0.5-1.2         1.2-1.9       1.9-2.1         from 2.1 on
    phase       surge      turn 1          turn 2        turn 3          loop
    turn        0.062      1.3 towards     1.3 away      1.3 towards     1.3 away       [rad/s]
    speed       19         0.8             0.8           0.8             0.8            [mm/s]

    A phase begins at the first of its times and ends before the last.

    Args:
        since_hit_s: How long ago the last whiff was [s]; infinite without one.

    Source:
        Kanzaki et al. 1992 and Ishida et al. 1995; figures as in a public silkmoth simulator, read in code.
    """
    if since_hit_s < _TURNS[0][0] - 1e-9:
        return SURGE
    for i, (end_s, sign) in enumerate(_TURNS[1:], start=1):
        if since_hit_s < end_s - 1e-9:
            return Phase(name=f"turn {i}", speed_frac=_CRAWL_FRAC, turn_rad_s=sign * TURN_RAD_S)
    return Phase(name="loop", speed_frac=_CRAWL_FRAC, turn_rad_s=-TURN_RAD_S)


def heading_after(heading_rad: float, side: int, phase: Phase, duration_s: float) -> float:
    """Return the heading after a time in a phase [rad].

    theta <- theta + s w dt        s side of the whiff (+1 left), w the phase's rate towards it [rad/s]
    """
    return heading_rad + side * phase.turn_rad_s * duration_s


class TrueWind:
    """The wind over the ground, measured by a vehicle that moves: a vane on it feels its own motion too.

    w <- w + (1 - exp(-dt / tau)) (a + v - w)        a apparent wind, v velocity of the vehicle [m/s]

    State: the smoothed wind, and the time of the last sample.
    """

    def __init__(self, vane: Vane, *, smoothing_s: float, threshold_m_s: float) -> None:
        """Begin without a wind.

        Args:
            smoothing_s: Time constant tau [s].
            threshold_m_s: A wind no faster than this has no direction [m/s].
        """
        self._vane = vane
        self._smoothing_s = smoothing_s
        self._threshold_m_s = threshold_m_s
        self._wind_m_s: tuple[float, float] | None = None
        self._last_s = 0.0
        self.upwind_rad: float | None = None

    def add(self, observation: Observation) -> None:
        """Take note of an observation; a time counts once. The direction of the last wind is kept in calm air."""
        if not self._vane.is_ready(observation):
            return
        apparent_m_s, velocity_m_s = self._vane.wind_world_m_s(observation), observation.velocity_world_m_s
        x_m_s, y_m_s = apparent_m_s[0] + velocity_m_s[0], apparent_m_s[1] + velocity_m_s[1]
        if self._wind_m_s is None:
            self._wind_m_s = (x_m_s, y_m_s)
        elif observation.time_s > self._last_s:
            weight = -elementary.expm1(-(observation.time_s - self._last_s) / self._smoothing_s)
            old_x, old_y = self._wind_m_s
            self._wind_m_s = (old_x + weight * (x_m_s - old_x), old_y + weight * (y_m_s - old_y))
        self._last_s = observation.time_s
        if norm2(*self._wind_m_s) > self._threshold_m_s:
            self.upwind_rad = elementary.atan2(0.0 - self._wind_m_s[1], 0.0 - self._wind_m_s[0])
