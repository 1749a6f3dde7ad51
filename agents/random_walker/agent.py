"""The random walker: legs in random directions, blind. README.md beside this file has the rules."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.draws import Draws
from gslcosim.search.method import settings_of
from gslcosim.search.moving.legs import Room
from gslcosim.search.moving.pacing import Pacer
from gslcosim.search.reactive.walks import RunAndTumble


class RandomWalker(Agent):
    """Draws a new direction for each leg and remembers nothing."""

    def __init__(self, briefing: Briefing) -> None:
        settings = settings_of(briefing, __file__)
        room = Room.of(briefing, settings.wall_margin_m)
        self.walk = RunAndTumble(room, Draws(briefing.seed), leg_m=settings.step_m)
        self.pacer = Pacer(briefing, hold_s=settings.hold_s, leg_s=settings.leg_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        return self.pacer.leg(observation, self.walk.next_end_m(observation.position_world_m, keeps=False))


if __name__ == "__main__":
    run(RandomWalker)
