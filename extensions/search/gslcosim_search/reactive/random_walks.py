"""Random walks that are blind, or nearly so: run and tumble, Levy walks, and the agents that do nothing else.

Held by:
    extensions/search/tests/analytic/test_blind_walks.py
    extensions/search/tests/unit/reactive/test_random_walks.py
"""

from collections.abc import Sequence
from typing import ClassVar

from gslcosim.agent_kit import Agent, Briefing, Command, Observation
from gslcosim.agent_kit.commands import LegCommander
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search import elementary
from gslcosim_search.elementary import distance
from gslcosim_search.motion.legs import N_TRIES, LegSpace, Point, leg_end
from gslcosim_search.random_stream import RandomStream


class RunAndTumble:
    """Legs of one length: a leg keeps the direction of the one before (run) or draws a new one (tumble).

    heading ~ U[0, 2 pi), climb ~ U[-most_climb_m, most_climb_m); a leg that may not be flown draws again, also where it
    was to keep its direction. After 100 draws without success it leads to the nearest place inside the margin.

    With runs never kept it is the random walk, with a chance p of keeping them the persistent walk, with runs kept
    while there is more gas the search of E. coli.

    State: the direction of the last leg. Draws for each try: heading, then, in space, climb.

    Source:
        The walker and the E. coli of GSL-Bench [C].
    Held by:
        extensions/search/tests/unit/reactive/test_random_walks.py; extensions/search/tests/analytic/test_blind_walks.py
        (success without gas)
    """

    def __init__(self, room: LegSpace, draws: RandomStream, *, leg_m: float, most_climb_m: float | None = None) -> None:
        """Begin without a direction.

        Args:
            room: Where legs may end.
            most_climb_m: How much higher or lower a leg may end [m]; absent: legs stay in the plane.
        """
        self._room, self._draws = room, draws
        self._leg_m, self._most_climb_m = leg_m, most_climb_m
        self._direction: tuple[float, float | None] | None = None

    def next_end_m(self, start_m: Sequence[float], *, keeps: bool, turn_rad: float = 0.0) -> Point:
        """Return the end of the next leg, world frame [m]: x and y, and z for a walk in 3-D.

        Args:
            keeps: Whether to keep the direction, if that is possible.
            turn_rad: By how much to turn where it is kept [rad].
        """
        if keeps and self._direction is not None:
            self._direction = (self._direction[0] + turn_rad, self._direction[1])
            end_m = self._end_m(start_m, self._direction)
            if end_m is not None:
                return end_m
        for _ in range(N_TRIES):
            self._direction = self._drawn()
            end_m = self._end_m(start_m, self._direction)
            if end_m is not None:
                return end_m
        self._direction = None
        return self._room.nearest(start_m[: 2 if self._most_climb_m is None else 3])

    def _end_m(self, start_m: Sequence[float], direction: tuple[float, float | None]) -> Point | None:
        heading_rad, climb_m = direction
        return leg_end(start_m, heading_rad, self._leg_m, self._room, climb_m=climb_m)

    def _drawn(self) -> tuple[float, float | None]:
        heading_rad = self._draws.angle_rad()
        if self._most_climb_m is None:
            return heading_rad, None
        return heading_rad, self._draws.uniform(-self._most_climb_m, self._most_climb_m)


def power_law_length_m(fraction: float, *, exponent: float, least_m: float, most_m: float) -> float:
    """Return a length of a truncated power law, from a number uniform in [0, 1).

    p(l) ~ l^-mu for a <= l <= b;  l = (a^q + u (b^q - a^q))^(1/q), q = 1 - mu;  for mu = 1: l = a (b / a)^u
    [m] = ([m]^q)^(1/q)

    Args:
        fraction: u.
        exponent: mu; 2 is the best for blind search of rare targets, remembered, unverified [M].
        least_m: a [m], > 0.
        most_m: b [m], >= a.

    Source:
        Inverse of the distribution function; Levy walks after Viswanathan et al. 1999, doi:10.1038/44831.
    """
    q = 1.0 - exponent
    if abs(q) < 1e-9:
        return least_m * elementary.pow(most_m / least_m, fraction)
    least, most = elementary.pow(least_m, q), elementary.pow(most_m, q)
    return elementary.pow(least + fraction * (most - least), 1.0 / q)


class LevyWalk:
    """Legs in random directions whose lengths follow a truncated power law; walls and obstacles cut them short.

    The longest length is the diagonal of the room. A leg that meets the margin ends there; where what is left is less
    than half of the least length, another direction is drawn.

    State: none but the draws. Draws for each leg: length, then headings until one leads anywhere.

    Source:
        Levy walk with exponent 2, truncated at the room's size, remembered, unverified [M].
    """

    def __init__(self, room: LegSpace, draws: RandomStream, *, exponent: float, least_m: float) -> None:
        """Begin a walk with lengths from `least_m`, with the power law's exponent."""
        self._room, self._draws, self._exponent, self._least_m = room, draws, exponent, least_m
        self._most_m = max(least_m, distance(room.min_m[:2], room.max_m[:2]))

    def next_end_m(self, start_m: Sequence[float]) -> Point:
        """Return the end of the next leg, x and y, world frame [m]."""
        length_m = power_law_length_m(
            self._draws.fraction(), exponent=self._exponent, least_m=self._least_m, most_m=self._most_m
        )
        for _ in range(N_TRIES):
            end_m = self._room.farthest(start_m[:2], self._draws.angle_rad(), length_m)
            if distance(start_m[:2], end_m) >= self._least_m / 2.0:
                return end_m
        return self._room.nearest(start_m[:2])


class PersistentWalk(Agent):
    """Keeps the direction of its last leg with a chance, and remembers nothing else.

    Its settings: wall_margin_m, step_m, hold_s, leg_s, persistence.
    """

    program: ClassVar[str]

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, self.program)
        self.draws = RandomStream(briefing.seed)
        self.persistence = settings.persistence
        self.walk = RunAndTumble(LegSpace.of(briefing, settings.wall_margin_m), self.draws, leg_m=settings.step_m)
        self.pacer = LegCommander(briefing, hold_s=settings.hold_s, leg_s=settings.leg_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg, in a new direction after a refused one."""
        keeps = self.draws.fraction() < self.persistence and observation.notice is None
        return self.pacer.leg(observation, self.walk.next_end_m(observation.position_world_m, keeps=keeps))


class RandomWalker(Agent):
    """Draws a new direction for each leg and remembers nothing.

    Its settings: wall_margin_m, step_m, hold_s, leg_s.
    """

    program: ClassVar[str]

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, self.program)
        room = LegSpace.of(briefing, settings.wall_margin_m)
        self.walk = RunAndTumble(room, RandomStream(briefing.seed), leg_m=settings.step_m)
        self.pacer = LegCommander(briefing, hold_s=settings.hold_s, leg_s=settings.leg_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        return self.pacer.leg(observation, self.walk.next_end_m(observation.position_world_m, keeps=False))


class LevyWalker(Agent):
    """Draws a direction and a length for each leg and remembers nothing.

    Its settings: wall_margin_m, exponent, least_step_m, hold_s.
    """

    program: ClassVar[str]

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, self.program)
        room = LegSpace.of(briefing, settings.wall_margin_m)
        self.walk = LevyWalk(
            room, RandomStream(briefing.seed), exponent=settings.exponent, least_m=settings.least_step_m
        )
        self.pacer = LegCommander(briefing, hold_s=settings.hold_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        return self.pacer.leg(observation, self.walk.next_end_m(observation.position_world_m))
