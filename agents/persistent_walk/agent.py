"""The persistent walk: a blind walk that mostly keeps its direction. README.md beside this file has the rules."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.draws import Draws
from gslcosim.search.method import settings_of
from gslcosim.search.moving.legs import Room
from gslcosim.search.moving.pacing import Pacer
from gslcosim.search.reactive.walks import RunAndTumble


class PersistentWalk(Agent):
    """Keeps the direction of its last leg with a chance, and remembers nothing else."""

    def __init__(self, briefing: Briefing) -> None:
        settings = settings_of(briefing, __file__)
        self.draws = Draws(briefing.seed)
        self.persistence = settings.persistence
        self.walk = RunAndTumble(Room.of(briefing, settings.wall_margin_m), self.draws, leg_m=settings.step_m)
        self.pacer = Pacer(briefing, hold_s=settings.hold_s, leg_s=settings.leg_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg; one that was refused is not flown on."""
        keeps = self.draws.fraction() < self.persistence and observation.notice is None
        return self.pacer.leg(observation, self.walk.next_end_m(observation.position_world_m, keeps=keeps))


if __name__ == "__main__":
    run(PersistentWalk)
