"""E. coli: on with more gas, otherwise anywhere. README.md beside this file has the rules and the exact arithmetic."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import LegCommander
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.motion.declaration import MissionDeclarer, ReactiveDeclarer
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.random_walks import RunAndTumble
from gslcosim_search.senses.instruments import find_noses
from gslcosim_search.senses.stop_and_measure import GasIncrease


class EColi(Agent):
    """Remembers the gas of its last stop and its last heading."""

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, __file__)
        nose = find_noses(briefing)[0]
        self.draws = RandomStream(briefing.seed)
        self.gas = GasIncrease(nose, eps=settings.eps, is_mean=settings.measure == "mean")
        self.walk = RunAndTumble(LegSpace.of(briefing, settings.wall_margin_m), self.draws, leg_m=settings.step_m)
        self.most_turn_rad = settings.surge_turn_rad
        self.pacer = LegCommander(briefing, hold_s=settings.hold_s, leg_s=settings.leg_s)
        self.declarer = ReactiveDeclarer(
            nose,
            height_m=briefing.search_height_m,
            is_on=settings.declares,
            mission_declarer=MissionDeclarer(briefing, nose, plume_end=settings.plume_end),
        )

    def observe(self, observation: Observation) -> None:
        """Take note of the gas during the hold, and on the way."""
        self.declarer.observe(observation)
        self.gas.add(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg, or a declaration."""
        keeps = self.gas.has_more(observation) and observation.notice is None
        declared = self.declarer.command(observation, self.gas.value)
        if declared is not None:
            return declared
        turn_rad = self.draws.uniform(-self.most_turn_rad, self.most_turn_rad) if keeps and self.most_turn_rad else 0.0
        end_m = self.walk.next_end_m(observation.position_world_m, keeps=keeps, turn_rad=turn_rad)
        return self.pacer.leg(observation, end_m)


if __name__ == "__main__":
    run(EColi)
