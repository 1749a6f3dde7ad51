"""A Python agent that says everything that is wrong, turns its vehicle over, and at last answers what nobody asked."""

import random

from gslcosim.agent_kit import Agent, AttitudeSetpoint, Briefing, Command, Observation, Waypoint
from gslcosim.contract.record import build_unchecked_constructor

NAN = float("nan")


# The validator sees what a program in another language could send: nothing is checked here.
def without_checks(kind, **fields):
    return {"kind": kind, "_is_checked": False, **fields}


def far(n_places):
    draw = random.Random(1)
    return tuple(Waypoint(position_world_m=(draw.uniform(0.6, 7), draw.uniform(0.6, 5), 1.0)) for _ in range(n_places))


ANSWERS = {
    "nan": without_checks("waypoint", position_world_m=(NAN, 1.0, 1.0)),
    "nan velocity": without_checks("velocity", velocity_world_m_s=(0.1, NAN, 0.0)),
    "no such kind": without_checks("teleport", position_world_m=(1.0, 1.0, 1.0)),
    "without its part": without_checks("mission"),
    "kilometre": {"kind": "waypoint", "position_world_m": (1000.0, 1.0, 1.0)},
    "under the floor": {"kind": "mission", "waypoints": (Waypoint(position_world_m=(2.0, 2.0, -1.0)),)},
    "in the wall": {"kind": "waypoint", "position_world_m": (4.0, 2.0, 1.0)},
    "too fast": {"kind": "velocity", "velocity_world_m_s": (300.0, 0.0, 0.0)},
    "too strong": {"kind": "attitude", "attitude": AttitudeSetpoint(thrust_n=1e6)},
    "take off twice": {"kind": "take_off"},
    "a thousand places": {"kind": "mission", "waypoints": far(1000)},
    "stop": {"kind": "hold"},
    "over": {"kind": "attitude", "attitude": AttitudeSetpoint(roll_rad=3.1)},
    "up again": {"kind": "take_off"},
    "another tick": {"kind": "hold", "_tick_off": -1},
}


NEW_COMMAND = build_unchecked_constructor(Command)
FIRST_TICK, TICKS_EACH, TICKS_TO_FALL = 40, 4, 50


class Hostile(Agent):
    # What the vehicle said to each answer; for the test, which runs in the same process.
    notices: dict = {}  # noqa: RUF012

    def __init__(self, briefing: Briefing) -> None:
        del briefing
        self.ahead = list(ANSWERS)
        self.given, self.until_tick = None, FIRST_TICK
        self.notices.clear()

    def observe(self, observation: Observation) -> None:
        if self.given is not None and observation.notice:
            self.notices[self.given] = observation.notice

    def decide(self, observation: Observation) -> Command:
        if observation.tick >= self.until_tick and self.ahead:
            self.given = self.ahead.pop(0)
            self.until_tick += TICKS_TO_FALL if self.given == "over" else TICKS_EACH
        fields = dict(ANSWERS.get(self.given, {"kind": "noop"}))
        tick = observation.tick + fields.pop("_tick_off", 0)
        if fields.pop("_is_checked", True):
            return Command(tick=tick, **fields)
        return NEW_COMMAND(tick=tick, **fields)
