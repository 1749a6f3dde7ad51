"""E. coli in space: on with more gas, up or down too, otherwise anywhere. README.md beside this file has the rules."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import LegCommander
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.motion.declaration import MissionDeclarer, ReactiveDeclarer
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.random_walks import RunAndTumble
from gslcosim_search.senses.instruments import find_noses
from gslcosim_search.senses.stop_and_measure import GasIncrease


class EColi3d(Agent):
    """Remembers the gas of its last stop and the direction of its last leg."""

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, __file__)
        nose = find_noses(briefing)[0]
        self.gas = GasIncrease(nose, eps=settings.eps, is_mean=settings.measure == "mean")
        room = LegSpace.of(briefing, settings.wall_margin_m, is_planar=False)
        draws = RandomStream(briefing.seed)
        self.walk = RunAndTumble(room, draws, leg_m=settings.step_m, most_climb_m=settings.climb_m)
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
        declared = self.declarer.command(observation, self.gas.value, is_planar=False)
        if declared is not None:
            return declared
        end_m = self.walk.next_end_m(observation.position_world_m, keeps=keeps)
        return self.pacer.leg(observation, end_m)


if __name__ == "__main__":
    run(EColi3d)
