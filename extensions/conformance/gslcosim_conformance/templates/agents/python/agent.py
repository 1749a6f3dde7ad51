"""NAME: flies up the wind while it smells gas, and across the wind while it does not.

Begun from a template of gslcosim: it flies and keeps every rule of the contract. Now make it find the source.
"""

import math
import random

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run

LEG_M = 0.8
WALL_MARGIN_M = 1.0


class Searcher(Agent):
    """One search. It is made with the briefing and asked for a command whenever its vehicle has arrived."""

    def __init__(self, briefing: Briefing) -> None:
        self.nose = next(sensor.name for sensor in briefing.sensors if sensor.unit == "ohm")
        self.vane = next(sensor.name for sensor in briefing.sensors if sensor.model.startswith("anemometer"))
        self.bounds = briefing.bounds
        self.height_m = briefing.search_height_m
        # All chance comes from the briefing's seed, or a run could not be run again.
        self.random = random.Random(briefing.seed)
        self.last_ohm = math.inf

    def observe(self, observation: Observation) -> None:
        """Take note of what the sensors say at every tick; here nothing is remembered."""

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        ohm = observation.reading(self.nose).values[0]
        upwind_rad = observation.reading(self.vane).values[1]
        smells_more = ohm < self.last_ohm  # a metal-oxide sensor has fewer ohms in more gas
        self.last_ohm = ohm
        turn_rad = 0.0 if smells_more else self.random.choice((-0.5, 0.5)) * math.pi
        return self.leg(observation, upwind_rad + turn_rad)

    def leg(self, observation: Observation, heading_rad: float) -> Command:
        """Return the command that flies one leg, shortened where a wall is near."""
        x_m, y_m, _ = observation.position_world_m
        x_m = self.clear_of_walls(0, x_m + LEG_M * math.cos(heading_rad))
        y_m = self.clear_of_walls(1, y_m + LEG_M * math.sin(heading_rad))
        return Command(tick=observation.tick, kind="waypoint", position_world_m=(x_m, y_m, self.height_m))

    def clear_of_walls(self, axis: int, place_m: float) -> float:
        """Return the nearest place that keeps the margin from the room's walls."""
        low_m, high_m = self.bounds.min_m[axis] + WALL_MARGIN_M, self.bounds.max_m[axis] - WALL_MARGIN_M
        return max(low_m, min(high_m, place_m))


if __name__ == "__main__":
    run(Searcher)
