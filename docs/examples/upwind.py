"""The smallest agent in Python: flies up the wind."""

import math

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run


class Upwind(Agent):
    """Flies half a metre up the wind, again and again."""

    def __init__(self, briefing: Briefing) -> None:
        self.height_m = briefing.search_height_m

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        x_m, y_m, _ = observation.position_world_m
        _, upwind_rad = observation.reading("wind").values
        target = (x_m + 0.5 * math.cos(upwind_rad), y_m + 0.5 * math.sin(upwind_rad), self.height_m)
        return Command(tick=observation.tick, kind="waypoint", position_world_m=target)


if __name__ == "__main__":
    run(Upwind)
