"""An agent made of building blocks: short legs where there is gas, long ones where there is none."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import waypoint
from gslcosim_search.motion.legs import LegSpace, next_leg, random_headings
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.senses.instruments import find_noses


class Wanderer(Agent):
    """Wanders at random within the room, and stays longer where it smells something."""

    def __init__(self, briefing: Briefing) -> None:
        self.nose = find_noses(briefing)[0]
        self.room = LegSpace.of(briefing, 0.5)
        self.draws = RandomStream(briefing.seed)
        self.height_m = briefing.search_height_m

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        length_m = 0.4 if self.nose.ppm(observation) > 1.0 else 1.5
        here_m = observation.position_world_m
        leg = next_leg(here_m, random_headings(self.draws), length_m, self.room, self.draws)
        x_m, y_m = leg.end_m
        return waypoint(observation, x_m, y_m, self.height_m)


if __name__ == "__main__":
    run(Wanderer)
