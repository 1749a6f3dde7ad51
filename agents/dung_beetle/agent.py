"""The dung beetle, or zigzag: crosswind until the gas sensor responds, then upwind in zigzag legs.

After Russell et al. as flown in GSL-Bench. README.md beside this file has the rules and the exact arithmetic.
"""

import math
from collections.abc import Iterator

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import LegCommander
from gslcosim.agent_kit.settings import load_settings

RIGHT_ANGLE_RAD = 1.5707963267948966
HALF_TURN_RAD = 3.141592653589793
FULL_TURN_RAD = 6.283185307179586
N_RANDOM_HEADINGS = 100
MASK_64 = 0xFFFFFFFFFFFFFFFF


class DungBeetle(Agent):
    """Seeks gas across the wind, then zigzags up the wind; all it remembers is one reading, its side and a wind."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.nose = next(sensor.name for sensor in briefing.sensors if sensor.unit == "ohm")
        self.vane = next(sensor.name for sensor in briefing.sensors if sensor.model == "anemometer")
        self.min_m = tuple(low + self.settings.wall_margin_m for low in briefing.bounds.min_m)
        self.max_m = tuple(high - self.settings.wall_margin_m for high in briefing.bounds.max_m)
        self.pacer = LegCommander(briefing, leg_s=self.settings.leg_s)
        self.random_state = briefing.seed
        self.last_ohm: float | None = None
        self.side = 0  # 0 seeking, +1 zigzagging left of upwind, -1 right of it
        self.seek_side = 1  # +1 seeking left of upwind, -1 right of it
        self.zigzag_upwind_rad = 0.0

    def decide(self, observation: Observation) -> Command:
        """Return the next leg."""
        ohm = observation.reading(self.nose).values[0]
        upwind_rad = observation.reading(self.vane).values[1]
        has_more_gas = self.last_ohm is not None and ohm < self.last_ohm * (1.0 - self.settings.eps)
        self.last_ohm = ohm
        keeps_wind = self.settings.heading_memory and self.side != 0 and has_more_gas
        if self.side == 0:
            self.side = 1 if has_more_gas else 0
        elif not has_more_gas:
            self.side = -self.side
        if not keeps_wind:
            self.zigzag_upwind_rad = upwind_rad
        return self.pacer.leg(observation, self.next_waypoint(observation, self.zigzag_upwind_rad))

    def next_waypoint(self, observation: Observation, upwind_rad: float) -> tuple[float, float]:
        """Return the end of the first possible leg that keeps away from the walls; without one, leave the margin."""
        x0_m, y0_m, _ = observation.position_world_m
        for heading_rad in self.headings_rad(upwind_rad, is_blocked=observation.notice is not None):
            x_m = to_millimetre(x0_m + self.settings.leg_m * math.cos(heading_rad))
            y_m = to_millimetre(y0_m + self.settings.leg_m * math.sin(heading_rad))
            if self.min_m[0] <= x_m <= self.max_m[0] and self.min_m[1] <= y_m <= self.max_m[1]:
                return x_m, y_m
        x_m = max(self.min_m[0], min(self.max_m[0], x0_m))
        y_m = max(self.min_m[1], min(self.max_m[1], y0_m))
        return to_millimetre(x_m), to_millimetre(y_m)

    def headings_rad(self, upwind_rad: float, *, is_blocked: bool) -> Iterator[float]:
        """Yield headings in the order in which they are tried: the rule's own, then what is left at a wall."""
        if self.side == 0:
            yield from self.seeking_headings_rad(upwind_rad, is_blocked=is_blocked)
        else:
            yield upwind_rad + self.side * self.settings.zigzag_rad
            self.side = -self.side
            yield upwind_rad + self.side * self.settings.zigzag_rad
            yield upwind_rad + HALF_TURN_RAD
        for _ in range(N_RANDOM_HEADINGS):
            yield FULL_TURN_RAD * self.random_fraction()

    def seeking_headings_rad(self, upwind_rad: float, *, is_blocked: bool) -> Iterator[float]:
        """Yield what a seeking beetle tries before it draws: across the wind, by the other rule for walls both ways."""
        if self.settings.wall_rule == "random":
            if not is_blocked:
                yield upwind_rad + RIGHT_ANGLE_RAD
            return
        if is_blocked:
            self.seek_side = -self.seek_side
        yield upwind_rad + self.seek_side * RIGHT_ANGLE_RAD
        self.seek_side = -self.seek_side
        yield upwind_rad + self.seek_side * RIGHT_ANGLE_RAD

    def random_fraction(self) -> float:
        """Return the next random number in [0, 1), by SplitMix64, which every language can repeat exactly."""
        self.random_state = (self.random_state + 0x9E3779B97F4A7C15) & MASK_64
        z = self.random_state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK_64
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK_64
        return ((z ^ (z >> 31)) >> 11) / 9007199254740992.0


def to_millimetre(length_m: float) -> float:
    """Return a length rounded to whole millimetres, so that the last bit of sin and cos has no effect."""
    return math.floor(length_m * 1000.0 + 0.5) / 1000.0


if __name__ == "__main__":
    run(DungBeetle)
