"""The persistent walk: a blind walk that mostly keeps its direction. README.md beside this file has the rules."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import LegCommander
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.random_walks import RunAndTumble


class PersistentWalk(Agent):
    """Keeps the direction of its last leg with a chance, and remembers nothing else."""

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, __file__)
        self.draws = RandomStream(briefing.seed)
        self.persistence = settings.persistence
        self.walk = RunAndTumble(LegSpace.of(briefing, settings.wall_margin_m), self.draws, leg_m=settings.step_m)
        self.pacer = LegCommander(briefing, hold_s=settings.hold_s, leg_s=settings.leg_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg; one that was refused is not flown on."""
        keeps = self.draws.fraction() < self.persistence and observation.notice is None
        return self.pacer.leg(observation, self.walk.next_end_m(observation.position_world_m, keeps=keeps))


if __name__ == "__main__":
    run(PersistentWalk)
