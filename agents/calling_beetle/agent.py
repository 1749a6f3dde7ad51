"""Calling beetles: who smells gas calls the others by radio, and who smells nothing goes where it was called from.

README.md beside this file has the rules. One process may fly any number of them.
"""

import math
from collections.abc import Iterator

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, RadioMessage, run
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search import elementary
from gslcosim_search.elementary import distance

CROSSWIND_RAD = math.radians(90)
ZIGZAG_RAD = math.radians(60)


class CallingBeetle(Agent):
    """Remembers the resistance in clean air, its side of the wind, and where the last call came from."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.nose = next(sensor.name for sensor in briefing.sensors if sensor.unit == "ohm")
        self.vane = next(sensor.name for sensor in briefing.sensors if sensor.model == "anemometer")
        self.channel = briefing.channels[0].name if briefing.channels else None
        self.min_m = tuple(low + self.settings.wall_margin_m for low in briefing.bounds.min_m)
        self.max_m = tuple(high - self.settings.wall_margin_m for high in briefing.bounds.max_m)
        self.height_m = briefing.search_height_m
        self.side = 1 if briefing.seed % 2 else -1
        self.clean_ohm = 0.0
        self.call_m: tuple[float, float] | None = None

    def observe(self, observation: Observation) -> None:
        """Listen: a call may come with any observation, not only with those that ask for a command."""
        for reception in observation.incoming:
            x_m, y_m = reception.text.split()
            self.call_m = (float(x_m), float(y_m))

    def decide(self, observation: Observation) -> Command:
        """Return the next leg, and call when there is gas here."""
        ohm = observation.reading(self.nose).values[0]
        self.clean_ohm = max(self.clean_ohm, ohm)
        smells_gas = ohm < self.settings.smells_below_frac * self.clean_ohm
        x_m, y_m = self.next_waypoint(observation, smells_gas=smells_gas)
        return Command(
            tick=observation.tick,
            kind="waypoint",
            position_world_m=(x_m, y_m, self.height_m),
            outgoing=self.calls(observation) if smells_gas else (),
        )

    def calls(self, observation: Observation) -> tuple[RadioMessage, ...]:
        """Return what is sent from a place with gas: the place."""
        x_m, y_m, _ = observation.position_world_m
        return () if self.channel is None else (RadioMessage(channel=self.channel, text=f"{x_m:.2f} {y_m:.2f}"),)

    def next_waypoint(self, observation: Observation, *, smells_gas: bool) -> tuple[float, float]:
        """Return the end of the first leg that keeps away from the walls, or else the nearest point that does."""
        x0_m, y0_m, _ = observation.position_world_m
        for heading_rad in self.headings_rad(observation, smells_gas=smells_gas):
            x_m = x0_m + self.settings.leg_m * elementary.cos(heading_rad)
            y_m = y0_m + self.settings.leg_m * elementary.sin(heading_rad)
            if self.min_m[0] <= x_m <= self.max_m[0] and self.min_m[1] <= y_m <= self.max_m[1]:
                return x_m, y_m
        return max(self.min_m[0], min(self.max_m[0], x0_m)), max(self.min_m[1], min(self.max_m[1], y0_m))

    def headings_rad(self, observation: Observation, *, smells_gas: bool) -> Iterator[float]:
        """Yield headings in the order in which they are tried: upwind in gas, else to the call, at last across."""
        x0_m, y0_m, _ = observation.position_world_m
        upwind_rad = observation.reading(self.vane).values[1]
        if smells_gas:
            self.side = -self.side
            yield upwind_rad + self.side * ZIGZAG_RAD
            yield upwind_rad - self.side * ZIGZAG_RAD
        elif self.call_m is not None and distance(self.call_m, (x0_m, y0_m)) > self.settings.near_m:
            yield elementary.atan2(self.call_m[1] - y0_m, self.call_m[0] - x0_m)
        yield upwind_rad + self.side * CROSSWIND_RAD
        self.side = -self.side
        yield upwind_rad + self.side * CROSSWIND_RAD
        yield upwind_rad + math.pi


if __name__ == "__main__":
    run(CallingBeetle)
