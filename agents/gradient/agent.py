"""Gradient: a plane fitted to the last readings tells where there is more gas. README.md beside this has the rules."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import LegCommander
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.motion.declaration import MissionDeclarer, ReactiveDeclarer
from gslcosim_search.motion.legs import LegSpace, next_leg
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.taxis import RecentReadings, mount_position_m
from gslcosim_search.senses.hit_detection import GasLevel
from gslcosim_search.senses.instruments import find_noses
from gslcosim_search.senses.stop_and_measure import StopAndMeasure


class Gradient(Agent):
    """Remembers the readings of its last stops, and to which side it went off the gradient last."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.noses = find_noses(briefing)
        self.levels = [GasLevel(nose) for nose in self.noses]
        self.stop = StopAndMeasure(self.noses)
        self.readings = RecentReadings(within_m=self.settings.within_m, within_s=self.settings.within_s)
        self.draws = RandomStream(briefing.seed)
        self.room = LegSpace.of(briefing, self.settings.wall_margin_m)
        self.pacer = LegCommander(briefing, hold_s=self.settings.hold_s)
        self.declarer = ReactiveDeclarer(
            self.noses[0],
            height_m=briefing.search_height_m,
            is_on=self.settings.declares,
            mission_declarer=MissionDeclarer(briefing, self.noses[0], plume_end=self.settings.plume_end),
        )
        self.side = 1
        self.end_m: tuple[float, ...] | None = None

    def observe(self, observation: Observation) -> None:
        """Take note of the gas during the hold, and on the way."""
        self.declarer.observe(observation)
        self.stop.add(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg, or a declaration."""
        self.stop.add(observation)
        measured = self.stop.measured()
        if measured is not None:
            self.note(observation, measured.values)
            declared = self.declarer.command(observation, measured.values[0])
            if declared is not None:
                return declared
        refused_m = self.end_m if observation.notice is not None else None
        here_m = observation.position_world_m
        leg = next_leg(
            here_m, self.headings_rad(observation), self.settings.step_m, self.room, self.draws, refused_m=refused_m
        )
        self.end_m = leg.end_m
        return self.pacer.leg(observation, leg.end_m)

    def note(self, observation: Observation, values: tuple[float, ...]) -> None:
        """Remember what each nose has measured, and where it was."""
        for nose, level, value in zip(self.noses, self.levels, values):
            place_m = mount_position_m(observation.position_world_m, observation.yaw_rad, nose.mount_body_m)
            self.readings.add(observation.time_s, place_m, level.of(value))

    def headings_rad(self, observation: Observation) -> tuple[float, ...]:
        """Return where the gas grows, off to the one side and to the other; nothing where that is not known."""
        fit = self.readings.fit(observation.time_s, observation.position_world_m)
        if fit is None or not fit.is_significant:
            return ()
        self.side = -self.side
        off_rad = self.side * self.settings.off_rad
        return fit.heading_rad + off_rad, fit.heading_rad - off_rad


if __name__ == "__main__":
    run(Gradient)
