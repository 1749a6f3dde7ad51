"""Silkmoth: after each whiff a surge, three turns, and a loop until the next one; flown by velocity commands.

After Kanzaki, Ishida et al. README.md beside this file has the rules.
"""

import math

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search import elementary
from gslcosim_search.elementary import distance
from gslcosim_search.motion.coverage import CoverageGrid
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.silkmoth import SURGE, Sidestep, TrueWind, heading_after, phase_at
from gslcosim_search.reactive.spirals import random_side
from gslcosim_search.senses.hit_detection import GasHits
from gslcosim_search.senses.instruments import find_noses, find_vane

CLIMBS_PER_S = 1.0
MOST_CLIMB_M_S = 0.5
NEAR_M = 0.5


class Silkmoth(Agent):
    """Remembers when and on which side the last whiff was, its heading, and what it has seen of the room."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.draws = RandomStream(briefing.seed)
        noses = sorted(find_noses(briefing), key=lambda nose: -nose.mount_body_m[1])
        self.left, self.right = (
            GasHits(nose, threshold_ppm=self.settings.threshold_ppm) for nose in (noses[0], noses[-1])
        )
        self.wind = TrueWind(find_vane(briefing), smoothing_s=1.0, threshold_m_s=self.settings.threshold_m_s)
        self.room = LegSpace.within(briefing.bounds, self.settings.margin_m)
        self.height_m = briefing.search_height_m
        self.unseen = CoverageGrid(self.room, edge_m=self.settings.explore_step_m)
        self.goal_m: tuple[float, float] | None = None
        self.goal_since_s = 0.0
        self.heading_rad = 0.0
        self.side = random_side(self.draws)
        self.sidestep = Sidestep(side=self.side, keep_s=self.settings.sidestep_s)
        self.hit_s = -math.inf
        self.last_s: float | None = None

    def observe(self, observation: Observation) -> None:
        """Take note of whiffs and of the wind at every tick."""
        self.wind.add(observation)
        self.unseen.note(observation.position_world_m)
        is_left, is_right = self.left.add(observation), self.right.add(observation)
        if (is_left or is_right) and self.hit_s != observation.time_s:
            self.hit_s = observation.time_s
            self.side = self.side_of_hit(observation, is_left=is_left, is_right=is_right)

    def decide(self, observation: Observation) -> Command:
        """Return the velocity of the phase; without a whiff for long, that towards a place not seen yet."""
        self.observe(observation)
        since_hit_s = observation.time_s - self.hit_s
        if since_hit_s > self.settings.give_up_s:
            return self.explore(observation)
        phase, duration_s = phase_at(since_hit_s), self.duration_s(observation)
        self.goal_m = None
        if phase is SURGE and self.settings.surge_towards == "upwind" and self.wind.upwind_rad is not None:
            self.heading_rad = self.wind.upwind_rad
        self.heading_rad = heading_after(self.heading_rad, self.side, phase, duration_s)
        return self.fly(observation, phase.speed_frac * self.settings.surge_m_s)

    def side_of_hit(self, observation: Observation, *, is_left: bool, is_right: bool) -> int:
        """Return +1 for a whiff on the left, -1 for one on the right; of two the stronger, of equal ones any."""
        if is_left != is_right:
            return 1 if is_left else -1
        left, right = self.left.nose.amount(observation), self.right.nose.amount(observation)
        if left == right:
            return random_side(self.draws)
        return 1 if left > right else -1

    def duration_s(self, observation: Observation) -> float:
        """Return how long the last command has turned the moth; pauses count no longer than a command lasts."""
        last_s, self.last_s = self.last_s, observation.time_s
        return 0.0 if last_s is None else min(observation.time_s - last_s, self.settings.command_s)

    def explore(self, observation: Observation) -> Command:
        """Return the velocity to the nearest place that was not seen; one that it does not reach is left out."""
        here_m = observation.position_world_m
        if self.goal_m is None or distance(self.goal_m, here_m[:2]) < NEAR_M or self.is_late(observation):
            if self.goal_m is not None:
                self.unseen.skip(self.goal_m)
            self.goal_m = self.unseen.next_place_m(here_m, self.wind.upwind_rad)
            self.goal_since_s = observation.time_s
        self.last_s = observation.time_s
        self.heading_rad = elementary.atan2(self.goal_m[1] - here_m[1], self.goal_m[0] - here_m[0])
        return self.fly(observation, self.settings.explore_m_s)

    def is_late(self, observation: Observation) -> bool:
        """Return whether the way to the goal takes so long that something must be in between."""
        return observation.time_s - self.goal_since_s > self.settings.late_s

    def fly(self, observation: Observation, speed_m_s: float) -> Command:
        """Return the velocity along the heading, without what leads out of the margin, and to the search height.

        Where the last one was refused, something is in the way: it turns until it is not.
        """
        here_m = observation.position_world_m
        self.sidestep.note(observation.time_s, is_refused=observation.notice is not None)
        heading_rad = self.heading_rad + self.sidestep.turn_rad
        along = (elementary.cos(heading_rad), elementary.sin(heading_rad))
        x_m_s, y_m_s = (
            0.0 if (x <= low and share < 0.0) or (x >= high and share > 0.0) else speed_m_s * share
            for x, low, high, share in zip(here_m, self.room.min_m, self.room.max_m, along)
        )
        climb_m_s = max(-MOST_CLIMB_M_S, min(MOST_CLIMB_M_S, CLIMBS_PER_S * (self.height_m - here_m[2])))
        return Command(
            tick=observation.tick,
            kind="velocity",
            velocity_world_m_s=(x_m_s, y_m_s, climb_m_s),
            hold_s=self.settings.command_s,
            yaw_rad=math.remainder(heading_rad, math.tau),
        )


if __name__ == "__main__":
    run(Silkmoth)
