"""The Lévy walk: many short legs and a few very long ones, blind. README.md beside this file has the rules."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import LegCommander
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.random_walks import LevyWalk


class LevyWalker(Agent):
    """Draws a direction and a length for each leg and remembers nothing."""

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, __file__)
        room = LegSpace.of(briefing, settings.wall_margin_m)
        self.walk = LevyWalk(
            room, RandomStream(briefing.seed), exponent=settings.exponent, least_m=settings.least_step_m
        )
        self.pacer = LegCommander(briefing, hold_s=settings.hold_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        return self.pacer.leg(observation, self.walk.next_end_m(observation.position_world_m))


if __name__ == "__main__":
    run(LevyWalker)
