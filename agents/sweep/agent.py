"""The sweep: flies lanes over the whole room, blind, without a stop. README.md beside this file has the rules."""

import math
from collections import deque

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, Waypoint, run
from gslcosim.search.flying import waypoint
from gslcosim.search.lanes import lanes_m
from gslcosim.search.legs import Room
from gslcosim.search.method import settings_of

THERE_M = 0.3


class Sweep(Agent):
    """Remembers the bends that it has not been to, and whether it still flies them all in one go."""

    def __init__(self, briefing: Briefing) -> None:
        settings = settings_of(briefing, __file__)
        self.room = Room.of(briefing, settings.wall_margin_m)
        self.spacing_m = settings.lane_frac * settings.radius_m
        self.heights_m = settings.heights_m or (briefing.search_height_m,)
        self.bends_m: deque[tuple[float, float, float]] = deque()
        self.is_one_by_one = False

    def observe(self, observation: Observation) -> None:
        """Cross off the bends that the vehicle comes to."""
        if self.bends_m and math.dist(self.bends_m[0], observation.position_world_m) < THERE_M:
            self.bends_m.popleft()

    def decide(self, observation: Observation) -> Command:
        """Return what is left of the lanes in one mission; after a refusal one bend after the other."""
        self.observe(observation)
        if observation.notice is not None and self.bends_m:
            if self.is_one_by_one:
                self.bends_m.popleft()
            self.is_one_by_one = True
        if not self.bends_m:
            self.bends_m.extend(self.new_lanes(observation))
        if self.is_one_by_one:
            return waypoint(observation, *self.bends_m[0], hold_s=0.0)
        places = tuple(Waypoint(position_world_m=bend_m) for bend_m in self.bends_m)
        return Command(tick=observation.tick, kind="mission", waypoints=places[:1000])

    def new_lanes(self, observation: Observation) -> list[tuple[float, float, float]]:
        """Return the bends of a whole sweep, at one height after the other, each from where the last one ended."""
        bends_m: list[tuple[float, float, float]] = []
        for height_m in self.heights_m:
            start_m = bends_m[-1] if bends_m else observation.position_world_m
            bends_m += [(x_m, y_m, height_m) for x_m, y_m in lanes_m(self.room, self.spacing_m, start_m)]
        solid = self.room.obstacles
        return [bend_m for bend_m in bends_m if solid is None or not solid.is_solid(bend_m)] or bends_m


if __name__ == "__main__":
    run(Sweep)
