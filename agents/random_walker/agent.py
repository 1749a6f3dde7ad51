"""The random walker: legs in random directions, blind. README.md beside this file has the rules."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import LegCommander
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.random_walks import RunAndTumble


class RandomWalker(Agent):
    """Draws a new direction for each leg and remembers nothing."""

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, __file__)
        room = LegSpace.of(briefing, settings.wall_margin_m)
        self.walk = RunAndTumble(room, RandomStream(briefing.seed), leg_m=settings.step_m)
        self.pacer = LegCommander(briefing, hold_s=settings.hold_s, leg_s=settings.leg_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        return self.pacer.leg(observation, self.walk.next_end_m(observation.position_world_m, keeps=False))


if __name__ == "__main__":
    run(RandomWalker)
