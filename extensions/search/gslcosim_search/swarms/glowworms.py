"""Glowworm swarm optimisation: brighter robots attract those who see them; rules for gas and several sources.

Functions are pure; places are (d,) or (n, d) float64 arrays in the world frame [m].

Held by:
    extensions/search/tests/agents/test_gso.py
    extensions/search/tests/agents/test_gso.py
    extensions/search/tests/unit/swarms/test_glowworms.py
"""

from collections import deque
from collections.abc import Callable, Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Briefing
from gslcosim_search import elementary
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.spirals import ArchimedeanSpiral, random_side
from gslcosim_search.swarms.particle_swarm import limit_length, scale_to_length
from gslcosim_search.swarms.swarm_robot import LOST_AFTER_S, SwarmRobot

Vector = NDArray[np.float64]
N_DRAWS = 10


def next_luciferin(luciferin: float, amount: float, *, decay: float, gain: float) -> float:
    """Return the luciferin of a glowworm after an iteration.

    l' = (1 - rho) l + gamma f        l, f in the unit of the gas; with f constant l tends to gamma f / rho

    Args:
        luciferin: l, before.
        amount: f, how much gas there is here.
        decay: rho, in [0, 1].
        gain: gamma.

    Source:
        Krishnanand and Ghose 2009, doi:10.1007/s11721-008-0021-5; rho 0.4 and gamma 0.6 remembered, unverified.
    """
    return (1.0 - decay) * luciferin + gain * amount


def brighter_neighbours(
    place_m: Vector, luciferin: float, others_m: Vector, others_luciferin: Vector, radius_m: float
) -> NDArray[np.int64]:
    """Return the indices of those who are seen and glow more.

    N = {j: |x_j - x| < r_d and l_j > l}

    Args:
        place_m: (d,) x [m].
        luciferin: l, the glowworm's own.
        others_m: (n, d) x_j [m].
        others_luciferin: (n,) l_j.
        radius_m: r_d, how far it sees now [m].
    """
    distances_m = np.linalg.norm(others_m.reshape(-1, len(place_m)) - place_m, axis=1)
    return np.flatnonzero((distances_m < radius_m) & (others_luciferin > luciferin))


def attraction(luciferin: float, brighter_luciferin: Vector) -> Vector:
    """Return the probability with which each brighter neighbour is followed.

    p_j = (l_j - l) / sum over k of (l_k - l)        dimensionless, sums to 1; (n,), empty without neighbours

    Args:
        luciferin: l, the glowworm's own.
        brighter_luciferin: (n,) l_j of those that glow more, finite.
    """
    excess = brighter_luciferin - luciferin
    # The largest one first is 1, so that neither tiny nor huge differences lose the sum.
    scaled = excess / excess.max() if len(excess) else excess
    return scaled / scaled.sum()


def choose_by_probability(probabilities: Vector, draw: float) -> int:
    """Return the index that a random number in [0, 1) falls on, each with its probability."""
    return min(int(np.searchsorted(np.cumsum(probabilities), draw, side="right")), len(probabilities) - 1)


def next_radius_m(radius_m: float, n_neighbours: int, *, wanted: int, gain_m: float, sight_m: float) -> float:
    """Return the next sight radius of a glowworm: larger with too few brighter neighbours, smaller with too many.

    r' = min(r_s, max(0, r + beta (n_t - |N|)))        [m] = [m] + [m] [1]

    Args:
        radius_m: r, before [m].
        n_neighbours: |N|, brighter ones within it.
        wanted: n_t, how many it wants.
        gain_m: beta, change for each one too few [m].
        sight_m: r_s, the farthest that it can see [m].

    Source:
        Krishnanand and Ghose 2009; beta 0.08 and n_t 5 remembered, unverified.
    Held by:
        extensions/search/tests/unit/swarms/test_glowworms.py (stays in [0, r_s])
    """
    return min(sight_m, max(0.0, radius_m + gain_m * (wanted - n_neighbours)))


class OdourGlow:
    """Glow of a glowworm in a plume: the most gas of the last seconds, without decay; below a threshold nothing.

    l(t) = max of c over (t - T, t] where that exceeds the threshold, else 0        [ppm]

    State: the samples that may still be the most. Samples come in the order of time.

    Source:
        The odour version by the authors' group (abstracts only): decay makes it worse, threshold 1 ppm.
    """

    def __init__(self, *, memory_s: float, threshold: float) -> None:
        """Begin dark; `memory_s` is T, `threshold` in the unit of the samples."""
        self._memory_s, self._threshold = memory_s, threshold
        self._peaks: deque[tuple[float, float]] = deque()

    def add(self, time_s: float, amount: float) -> float:
        """Take note of a sample; return the luciferin."""
        while self._peaks and self._peaks[-1][1] <= amount:
            self._peaks.pop()
        self._peaks.append((time_s, amount))
        while self._peaks[0][0] <= time_s - self._memory_s and len(self._peaks) > 1:
            self._peaks.popleft()
        return self.luciferin

    @property
    def luciferin(self) -> float:
        """Luciferin: the brightness of the glow."""
        most = self._peaks[0][1] if self._peaks else 0.0
        return most if most > self._threshold else 0.0

    def darken(self) -> None:
        """Forget all: the gas belongs to a source that has been declared."""
        self._peaks.clear()


def circling_m(place_m: Vector, other_m: Vector, *, radius_m: float, step_m: float, side: int) -> Vector:
    """Return the next place on a circle about another robot, which avoids it and explores.

    x' = x_j + r R(side s / r) (x - x_j) / |x - x_j|        s step along the circle [m], r its radius [m]

    Exactly at the other one it leaves along x.

    Args:
        place_m: (2,) x [m].
        other_m: (2,) x_j [m].
        radius_m: r [m].
        step_m: s [m].
        side: +1 counter-clockwise, -1 clockwise.
    """
    away_m = place_m - other_m
    angle_rad = elementary.atan2(away_m[1], away_m[0]) + side * step_m / radius_m
    return other_m + radius_m * np.array([elementary.cos(angle_rad), elementary.sin(angle_rad)])


def is_in_excluded_region(place_m: Sequence[float], declared_m: Sequence[Sequence[float]], radius_m: float) -> bool:
    """Return True if a place is in the region about a declared source, where no other is looked for.

    |x - s| < R for any declared s        [m]

    Source:
        Zhang et al. 2011 (CCC), modified GSO as described in the thesis on GSL-Bench; R 2 m remembered, unverified.
    """
    return any(distance(place_m, centre_m) < radius_m for centre_m in declared_m)


class SpiralSearch:
    """Search of a glowworm for gas: along a spiral about its position, and when that has left the room, elsewhere.

    Places of the spiral outside the room are left out, and those that are not worth to be searched. Draws where the
    next spiral is, its direction and side.

    State: the spiral, its centre, and the place that is flown to.

    Source:
        Spiral as the first mode of the odour version (abstract only); what it does at walls is ours.
    """

    def __init__(
        self,
        room: LegSpace,
        draws: RandomStream,
        *,
        gap_m: float,
        leg_m: float,
        is_left_out: Callable[[Sequence[float]], bool] = lambda place_m: False,
    ) -> None:
        """Begin without a spiral.

        Args:
            gap_m: Distance between its turns [m].
            is_left_out: Which places (x, y) are not worth to be searched.
        """
        self._room, self._draws, self._is_left_out = room, draws, is_left_out
        self._gap_m, self._leg_m = gap_m, leg_m
        self._spiral: ArchimedeanSpiral | None = None
        self._centre_m = self._target_m = np.zeros(2)

    def forget(self) -> None:
        """Leave the spiral: gas, or a place that cannot be reached."""
        self._spiral = None

    def move_on(self) -> None:
        """Begin another spiral elsewhere, with the way there."""
        self._begin(self._elsewhere_m())

    def is_on_its_way(self, place_m: Vector) -> bool:
        """Return True if it has not come to the centre of its spiral yet."""
        is_at_centre = distance(place_m, self._centre_m) < 0.5 * self._leg_m
        return self._spiral is not None and self._spiral.n_steps == 0 and not is_at_centre

    def step(self, place_m: Vector) -> Vector:
        """Return the next step [m]."""
        if self._spiral is None:
            self._begin(place_m)
        if distance(place_m, self._target_m) < 0.5 * self._leg_m:
            self._target_m = self._next_place_m()
        return limit_length(self._target_m - place_m, self._leg_m)

    def _begin(self, centre_m: Vector) -> ArchimedeanSpiral:
        self._spiral = ArchimedeanSpiral(
            gap_m=self._gap_m, arc_m=self._leg_m, start_rad=self._draws.angle_rad(), side=random_side(self._draws)
        )
        self._centre_m, self._target_m = centre_m.copy(), centre_m.copy()
        return self._spiral

    def _next_place_m(self) -> Vector:
        sides = list(zip(self._room.min_m[:2], self._room.max_m[:2]))
        spiral = self._spiral or self._begin(self._centre_m)
        while spiral.radius_m < norm2(*(high - low for low, high in sides)):
            place_m = self._centre_m + np.array(spiral.next_offset_m())
            if self._is_good(place_m):
                return place_m
        self._begin(self._elsewhere_m())
        return self._centre_m

    def _elsewhere_m(self) -> Vector:
        place_m = self._centre_m
        for _ in range(N_DRAWS):
            sides = zip(self._room.min_m[:2], self._room.max_m[:2])
            place_m = np.array([self._draws.uniform(low, high) for low, high in sides])
            if self._is_good(place_m):
                break
        return place_m

    def _is_good(self, place_m: Vector) -> bool:
        place = (float(place_m[0]), float(place_m[1]))
        return self._room.contains(place) and not self._is_left_out(place)


class Glowworm(SwarmRobot):
    """A robot of a swarm whose reports begin their numbers with how much it glows.

    Its settings: those of a robot, `sight_m`, `wanted`, `radius_gain_m`, `memory_s`, `avoid_m`, `circle_m`,
    `spiral_gap_m` and `wind_floor_m_s`.

    State: that of a robot, its luciferin, how far it sees, its spiral, and the side to which it circles.
    """

    def __init__(self, briefing: Briefing, settings: SimpleNamespace | None = None) -> None:
        """Begin dark."""
        super().__init__(briefing, settings)
        settings = self.settings
        self.luciferin = 0.0
        self.glow = OdourGlow(memory_s=settings.memory_s, threshold=settings.gas_floor)
        self.radius_m = settings.sight_m
        self.spiral = SpiralSearch(
            self.pilot.room, self.draws, gap_m=settings.spiral_gap_m, leg_m=settings.leg_m,
            is_left_out=lambda place_m: self.is_ignored(place_m),
        )  # fmt: skip
        self.side = 1 if self.team.index % 2 else -1

    def give_up(self) -> None:
        """Begin again from rest, and with another spiral."""
        super().give_up()
        self.spiral.forget()

    def glow_by_odour(self) -> None:
        """Glow by the most gas of the last seconds."""
        self.luciferin = self.glow.add(self.now_s, self.amount)

    def glow_by_decay(self, *, decay: float, gain: float) -> None:
        """Glow by the basic rule."""
        self.luciferin = next_luciferin(self.luciferin, self.amount, decay=decay, gain=gain)

    def others_glow(self) -> Vector:
        """Return the luciferin of each robot in `others_m`."""
        reports = self.team.recent(self.now_s, LOST_AFTER_S).values()
        glows = [report.numbers[0] if report.numbers else report.amount for report in reports]
        return np.array(glows, dtype=np.float64)

    def social_step(self) -> Vector | None:
        """Return the step about one who is too near, or to one who glows more; None where there is neither."""
        brighter = self.brighter()
        near_m = self._too_near_m()
        if near_m is not None:
            circle_m, leg_m = self.settings.circle_m, self.settings.leg_m
            goal_m = circling_m(self.place_m, near_m, radius_m=circle_m, step_m=leg_m, side=self.side)
            return limit_length(goal_m - self.place_m, leg_m)
        if not len(brighter):
            return None
        probabilities = attraction(self.luciferin, self.others_glow()[brighter])
        goal_m = self.others_m()[brighter[choose_by_probability(probabilities, self.draws.fraction())]]
        # Never past the other one, as a step of fixed length would be.
        return limit_length(goal_m - self.place_m, self.settings.leg_m)

    def brighter(self) -> NDArray[np.int64]:
        """Return the indices of those that are seen to glow more, and adapt how far it sees."""
        settings = self.settings
        found = brighter_neighbours(self.place_m, self.luciferin, self.others_m(), self.others_glow(), self.radius_m)
        self.radius_m = next_radius_m(
            self.radius_m, len(found), wanted=settings.wanted, gain_m=settings.radius_gain_m, sight_m=settings.sight_m
        )
        return found

    def upwind_step(self) -> Vector | None:
        """Return a leg straight up the wind; None in calm air."""
        if norm2(*self.wind_m_s) <= self.settings.wind_floor_m_s:
            return None
        return scale_to_length(-self.wind_m_s, self.settings.leg_m)

    def _too_near_m(self) -> Vector | None:
        places_m = self.others_m()
        distances_m = np.linalg.norm(places_m - self.place_m, axis=1)
        if not len(distances_m) or distances_m.min() >= self.settings.avoid_m:
            return None
        return places_m[int(distances_m.argmin())]
