"""A robot that moves as a glowworm: it glows by the gas it meets, sees others glow, and follows or circles them."""

import math
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Briefing
from gslcosim.search.swarms.glowworms import (
    OdourGlow,
    SpiralSearch,
    attraction,
    brighter_neighbours,
    chosen,
    circling_m,
    next_luciferin,
    next_radius_m,
)
from gslcosim.search.swarms.particle_swarm import limited, of_length
from gslcosim.search.swarms.swarming import LOST_AFTER_S, SwarmRobot

Vector = NDArray[np.float64]


class Glowworm(SwarmRobot):
    """A robot of a swarm whose reports begin their numbers with how much it glows.

    Its settings: those of a robot, `sight_m`, `wanted`, `radius_gain_m`, `memory_s`, `avoid_m`, `circle_m`,
    `spiral_gap_m` and `wind_floor_m_s`.

    State: that of a robot, its luciferin, how far it sees, its spiral, and the side to which it circles.

    Held by:
        tests/unit/agents/test_gso.py, test_modified_gso.py
    """

    def __init__(self, briefing: Briefing, settings: SimpleNamespace) -> None:
        """Begin dark."""
        super().__init__(briefing, settings)
        self.luciferin = 0.0
        self.glow = OdourGlow(memory_s=settings.memory_s, threshold=settings.gas_floor)
        self.radius_m = settings.sight_m
        self.spiral = SpiralSearch(
            self.pilot.room, self.draws, gap_m=settings.spiral_gap_m, leg_m=settings.leg_m,
            is_left_out=lambda place_m: self.is_ignored(place_m),
        )  # fmt: skip
        self.side = 1 if self.team.index % 2 else -1

    def give_up(self) -> None:
        """Begin anew from rest, and with another spiral."""
        super().give_up()
        self.spiral.forget()

    def glow_by_odour(self) -> None:
        """Glow by the most gas of the last seconds."""
        self.luciferin = self.glow.add(self.now_s, self.amount)

    def glow_by_decay(self, *, decay: float, gain: float) -> None:
        """Glow by the basic rule."""
        self.luciferin = next_luciferin(self.luciferin, self.amount, decay=decay, gain=gain)

    def others_glow(self) -> Vector:
        """Return how much each of those glows whose places `others_m` has."""
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
            return limited(goal_m - self.place_m, leg_m)
        if not len(brighter):
            return None
        probabilities = attraction(self.luciferin, self.others_glow()[brighter])
        goal_m = self.others_m()[brighter[chosen(probabilities, self.draws.fraction())]]
        # Never past the other one, as a step of fixed length would be.
        return limited(goal_m - self.place_m, self.settings.leg_m)

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
        if math.hypot(*self.wind_m_s) <= self.settings.wind_floor_m_s:
            return None
        return of_length(-self.wind_m_s, self.settings.leg_m)

    def _too_near_m(self) -> Vector | None:
        places_m = self.others_m()
        distances_m = np.linalg.norm(places_m - self.place_m, axis=1)
        if not len(distances_m) or distances_m.min() >= self.settings.avoid_m:
            return None
        return places_m[int(distances_m.argmin())]
