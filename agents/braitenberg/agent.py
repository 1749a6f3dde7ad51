"""Braitenberg: two noses that slow down two wheels. README.md beside this file has the rules."""

import math

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search import elementary
from gslcosim_search.motion.declaration import MissionDeclarer, ReactiveDeclarer
from gslcosim_search.motion.legs import LegSpace, next_leg
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.taxis import lateral_pair, speed_and_turn, wheel_speeds_m_s
from gslcosim_search.senses.hit_detection import GasLevel, RunningRange
from gslcosim_search.senses.instruments import Nose, find_noses

# A range of gas smaller than so many thresholds counts as one of so many: noise is not to be spread over it.
LEAST_RANGE = 5.0
CLIMBS_PER_S = 0.5
# How much room it leaves to turn round [m].
LOOKS_AHEAD_M = 0.5


class Braitenberg(Agent):
    """Remembers where it wants to go, and the range of what its noses have shown."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.sides = [(nose, GasLevel(nose), RunningRange()) for nose in lateral_pair(find_noses(briefing))]
        left, right = (nose for nose, _, _ in self.sides)
        if self.settings.ranges == "shared" and left.unit == right.unit:
            self.sides = [(nose, level, self.sides[0][2]) for nose, level, _ in self.sides]
        for _, level, seen in self.sides:
            seen.add(0.0)
            seen.add(LEAST_RANGE * level.threshold)
        self.half_base_m = (left.mount_body_m[1] - right.mount_body_m[1]) / 2.0
        self.room = LegSpace.of(briefing, self.settings.wall_margin_m)
        self.height_m = briefing.search_height_m
        self.draws = RandomStream(briefing.seed)
        self.heading_rad: float | None = None
        self.declarer = ReactiveDeclarer(
            left,
            height_m=self.height_m,
            is_on=self.settings.declares,
            apart_m=0.5,
            mission_declarer=MissionDeclarer(briefing, left, plume_end=self.settings.plume_end),
        )

    def observe(self, observation: Observation) -> None:
        """Take note of gas on the way."""
        self.declarer.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return how to go on for the next moment, or a declaration."""
        nose = self.sides[0][0]
        value = nose.value(observation) if nose.is_ready(observation) else None
        declared = self.declarer.command(observation, value)
        if declared is not None:
            return declared
        speed_m_s, turn_rad_s = self.speed_and_turn(observation)
        heading_rad = observation.yaw_rad if self.heading_rad is None else self.heading_rad
        self.heading_rad = self.free_heading_rad(
            observation, heading_rad + turn_rad_s * self.settings.period_s, speed_m_s
        )
        climb_m_s = CLIMBS_PER_S * (self.height_m - observation.position_world_m[2])
        velocity_m_s = (
            speed_m_s * elementary.cos(self.heading_rad),
            speed_m_s * elementary.sin(self.heading_rad),
            climb_m_s,
        )
        return Command(
            tick=observation.tick,
            kind="velocity",
            velocity_world_m_s=velocity_m_s,
            hold_s=self.settings.period_s,
            yaw_rad=math.remainder(self.heading_rad, math.tau),
        )

    def speed_and_turn(self, observation: Observation) -> tuple[float, float]:
        """Return speed [m/s] and rate of turn [rad/s] that the two noses make."""
        levels = [self.level(observation, *side) for side in self.sides]
        left_frac, right_frac = (seen.fraction(now) for now, (_, _, seen) in zip(levels, self.sides))
        wheels_m_s = wheel_speeds_m_s(
            left_frac,
            right_frac,
            most_m_s=self.settings.speed_m_s,
            gain=self.settings.gain,
            is_crossed=self.settings.wiring == "crossed",
        )
        speed_m_s, turn_rad_s = speed_and_turn(*wheels_m_s, self.half_base_m)
        most_rad_s = self.settings.most_turn_rad_s
        return speed_m_s, max(-most_rad_s, min(most_rad_s, turn_rad_s))

    def level(self, observation: Observation, nose: Nose, level: GasLevel, seen: RunningRange) -> float:
        """Return what a nose shows above clean air, and remember the range of that."""
        now = level.of(nose.value(observation)) if nose.is_ready(observation) else 0.0
        seen.add(now)
        return now

    def free_heading_rad(self, observation: Observation, heading_rad: float, speed_m_s: float) -> float:
        """Return the heading if there is room ahead, else one drawn at random along which there is."""
        ahead_m = LOOKS_AHEAD_M + speed_m_s * self.settings.period_s
        wanted = () if observation.notice is not None else (heading_rad,)
        leg = next_leg(observation.position_world_m, wanted, ahead_m, self.room, self.draws)
        if leg.heading_rad is not None:
            return leg.heading_rad
        x_m, y_m, _ = observation.position_world_m
        return elementary.atan2(leg.end_m[1] - y_m, leg.end_m[0] - x_m)


if __name__ == "__main__":
    run(Braitenberg)
