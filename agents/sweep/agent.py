"""The sweep: flies lanes over the whole room without a stop, whatever it meets. README.md beside it has the rules."""

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import accumulate, islice, pairwise

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, Waypoint, run
from gslcosim.agent_kit.commands import declaration, waypoint
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.elementary import distance
from gslcosim_search.motion.coverage import lawnmower_path_m
from gslcosim_search.motion.declaration import DeclarationGuard
from gslcosim_search.motion.largest_reading import LargestReading
from gslcosim_search.motion.legs import LegSpace

THERE_M = 0.3
# From rest to 1 m/s within half the acceleration of the slowest vehicle in the air, and a bit [m].
RUN_UP_M = 0.6
# Share of the time limit at which what was met so far is declared, and share of its speed that a sweep keeps up.
LATEST, PACE = 0.9, 0.9


class Sweep(Agent):
    """Remembers the bends that are left, whether it still flies them all in one go, and the largest reading."""

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, __file__)
        self.room = LegSpace.of(briefing, settings.wall_margin_m)
        self.spacing_m = settings.lane_frac * settings.radius_m
        self.speed_m_s = settings.speed_m_s
        self.heights_m = settings.heights_m or (briefing.search_height_m,)
        self.bends_m: deque[tuple[float, float, float]] = deque()
        self.is_one_by_one = False
        self.guess_m = middle_m(briefing) if settings.guesses else None
        reads = settings.declares == "largest_reading"
        self.reading = LargestReading(briefing, smooth_s=settings.smooth_s) if reads else None
        self.declared, self.has_begun = DeclarationGuard(), False
        self.latest_s = LATEST * briefing.time_limit_s
        self.mean_m_s = PACE * (settings.speed_m_s or 0.5)

    def observe(self, observation: Observation) -> None:
        """Cross off the bends that the vehicle comes to, and take note of the gas there."""
        if self.reading is not None:
            self.reading.add(observation)
        if self.bends_m and distance(self.bends_m[0], observation.position_world_m) < THERE_M:
            self.bends_m.popleft()

    def decide(self, observation: Observation) -> Command:
        """Return what is left of the lanes in one mission; after a refusal one bend after the other; a guess first."""
        self.observe(observation)
        if self.guess_m is not None:
            guess_m, self.guess_m = self.guess_m, None
            return declaration(observation, guess_m, 0.0)
        if observation.notice is not None and self.bends_m:
            self.give_in()
        n_bends = self.bends_in_time(observation)
        found = self.reading.estimate() if self.reading is not None and self.has_begun and not n_bends else None
        if (passed := self.declared.passes(found)) is not None:
            return declaration(observation, passed.position_m, passed.confidence)
        if not self.bends_m:
            self.has_begun = True
            self.bends_m.extend(self.new_lanes(observation))
            n_bends = self.bends_in_time(observation)
        if self.is_one_by_one:
            return waypoint(observation, *self.bends_m[0], hold_s=0.0)
        places = tuple(self.places(observation.position_world_m, n_bends or len(self.bends_m)))
        return Command(tick=observation.tick, kind="mission", waypoints=places[:1000])

    def bends_in_time(self, observation: Observation) -> int:
        """Return how many of the bends that are left are reached before the largest reading is to be declared."""
        if self.reading is None:
            return len(self.bends_m)
        left_m = self.mean_m_s * (self.latest_s - observation.time_s)
        ways_m = accumulate(distance(a, b) for a, b in pairwise((observation.position_world_m, *self.bends_m)))
        return sum(way_m <= left_m for way_m in ways_m)

    def places(self, start_m: tuple[float, float, float], n_bends: int) -> Iterator[Waypoint]:
        """Yield what the mission passes: on long ways a place after each bend and one before the next, at speed."""
        for bend_m in islice(self.bends_m, n_bends):
            length_m, run_up_m = distance(start_m, bend_m), RUN_UP_M * self.speed_m_s * self.speed_m_s
            if self.speed_m_s > 0.0 and length_m > 2.5 * run_up_m:
                unit = [(b - a) / length_m for a, b in zip(start_m, bend_m)]
                for along_m in (run_up_m, length_m - run_up_m):
                    yield passed(start_m, unit, along_m, self.speed_m_s)
            yield Waypoint(position_world_m=bend_m)
            start_m = bend_m

    def give_in(self) -> None:
        """After a refusal rest at each bend; after another one fly them one by one, and leave out what is refused."""
        if self.is_one_by_one:
            self.bends_m.popleft()
        self.is_one_by_one = self.speed_m_s == 0.0
        self.mean_m_s = self.mean_m_s / 2.0 if self.speed_m_s else self.mean_m_s
        self.speed_m_s = 0.0

    def new_lanes(self, observation: Observation) -> list[tuple[float, float, float]]:
        """Return the bends of a whole sweep, at one height after the other, each from where the last one ended."""
        bends_m: list[tuple[float, float, float]] = []
        for height_m in self.heights_m:
            start_m = bends_m[-1] if bends_m else observation.position_world_m
            bends_m += [(x_m, y_m, height_m) for x_m, y_m in lawnmower_path_m(self.room, self.spacing_m, start_m)]
        solid = self.room.obstacles
        return [bend_m for bend_m in bends_m if solid is None or not solid.is_solid(bend_m)] or bends_m


def middle_m(briefing: Briefing) -> tuple[float, float, float]:
    """Return the middle of the room at the search height, whose surroundings no wall cuts off."""
    low, high = briefing.bounds.min_m, briefing.bounds.max_m
    return (low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, briefing.search_height_m


def passed(start_m: Sequence[float], unit: Sequence[float], along_m: float, speed_m_s: float) -> Waypoint:
    """Return a place so far along a way, passed along it with a speed."""
    x_m, y_m, z_m = (a + along_m * u for a, u in zip(start_m, unit))
    vx_m_s, vy_m_s, vz_m_s = (speed_m_s * u for u in unit)
    return Waypoint(position_world_m=(x_m, y_m, z_m), velocity_world_m_s=(vx_m_s, vy_m_s, vz_m_s))


if __name__ == "__main__":
    run(Sweep)
