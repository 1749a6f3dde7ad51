"""An agent that looks for the source's position in the memory of its own process, and flies there."""

import gc

from gslcosim.agent_kit import Agent, run
from gslcosim.contract.messages import Briefing, Command, Observation


class Thief(Agent):
    """Flies to what it has found, or stays where it is."""

    def __init__(self, briefing: Briefing) -> None:
        named = [each for each in gc.get_objects() if type(each).__name__ == "SourceSpec"]
        self.source_m = named[0].position_m if named else None

    def decide(self, observation: Observation) -> Command:
        """Return the path to the source, or a hold."""
        if self.source_m is None:
            return Command(tick=observation.tick, kind="hold")
        x_m, y_m, _ = self.source_m
        place_m = (x_m, y_m, observation.position_world_m[2])
        return Command(tick=observation.tick, kind="waypoint", position_world_m=place_m)


if __name__ == "__main__":
    run(Thief)
