"""The Lévy walk: many short legs and a few very long ones, blind. README.md beside this file has the rules."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.draws import Draws
from gslcosim.search.method import settings_of
from gslcosim.search.moving.legs import Room
from gslcosim.search.moving.pacing import Pacer
from gslcosim.search.reactive.walks import LevyWalk


class LevyWalker(Agent):
    """Draws a direction and a length for each leg and remembers nothing."""

    def __init__(self, briefing: Briefing) -> None:
        settings = settings_of(briefing, __file__)
        room = Room.of(briefing, settings.wall_margin_m)
        self.walk = LevyWalk(room, Draws(briefing.seed), exponent=settings.exponent, least_m=settings.least_step_m)
        self.pacer = Pacer(briefing, hold_s=settings.hold_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        return self.pacer.leg(observation, self.walk.next_end_m(observation.position_world_m))


if __name__ == "__main__":
    run(LevyWalker)
