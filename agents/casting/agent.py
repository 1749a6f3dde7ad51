"""Casting: aslant to the wind through the plume; back across the wind when its edge is passed, then aslant again.

After Lochmatter and Martinoli 2008. README.md beside this file has the rules.
"""

import math

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.random_stream import RandomStream
from gslcosim.search.reactive.cast_and_surge import CastSequence, oblique_surge_end_m
from gslcosim.search.reactive.reactive_searcher import ReactiveSearcher, ReactiveSettings
from gslcosim.search.reactive.spirals import random_side
from gslcosim.search.senses.stop_and_measure import Contact

LEAST_LEG_M = 0.1


class Casting(Agent):
    """Remembers its side of the wind, where gas was met last, and how far a cast back has come."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.draws = RandomStream(briefing.seed)
        self.searcher = ReactiveSearcher(briefing, ReactiveSettings.of(self.settings), self.draws)
        self.beta_rad = math.radians(self.settings.beta_deg)
        self.side = random_side(self.draws)
        self.upwind_rad = 0.0
        self.is_crossing = False
        self.cast: CastSequence | None = None
        self.n_returns_left = 0

    def observe(self, observation: Observation) -> None:
        """Watch for gas on the way too."""
        self.searcher.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg: cross the plume, cast back, or explore."""
        contact = self.searcher.ask(observation, aborts=not self.is_crossing)
        if isinstance(contact, Command):
            return contact
        if contact.upwind_rad is None or self.searcher.is_away:
            self.is_crossing, self.cast = False, None
            return self.searcher.explore(observation)
        if contact.has_gas:
            return self.cross(observation, contact)
        left_m = contact.remaining_m(observation.position_world_m, self.settings.lost_m)
        if self.is_crossing and left_m > LEAST_LEG_M:
            return self.searcher.fly_to(observation, self.place_ahead_m(observation, None))
        if self.is_crossing:
            self.is_crossing, self.n_returns_left = False, self.settings.n_returns
            self.cast = self.cast_back(observation.position_world_m)
            answer = self.searcher.lose(observation, contact, self.upwind_rad)
            if answer is not None:
                return answer
        return self.cast_or_explore(observation, contact)

    def cross(self, observation: Observation, contact: Contact) -> Command:
        """Return a leg aslant through the plume; who comes back from an edge crosses to the other one."""
        assert contact.upwind_rad is not None
        gas_m = None if self.is_crossing else contact.gas_m
        if self.cast is not None:
            self.side = -self.side
        self.is_crossing, self.cast, self.upwind_rad = True, None, contact.upwind_rad
        return self.searcher.fly_to(observation, self.place_ahead_m(observation, gas_m))

    def place_ahead_m(self, observation: Observation, gas_m: tuple[float, ...] | None) -> tuple[float, float]:
        """Return the end of a leg aslant to the wind, from the line upwind through gas where there is some."""
        return oblique_surge_end_m(
            observation.position_world_m, gas_m, self.upwind_rad, self.side * self.beta_rad, self.settings.step_m
        )

    def cast_or_explore(self, observation: Observation, contact: Contact) -> Command:
        """Return the next leg of the cast; after it go back to the last gas and cast there; then explore."""
        while self.cast is not None:
            command = self.searcher.follow(observation, self.cast.next_turn_m)
            if command is not None:
                return command
            self.cast = self.cast_back(contact.last_m) if self.n_returns_left > 0 and contact.last_m else None
            self.n_returns_left -= 1
        return self.searcher.explore(observation)

    def cast_back(self, here_m: tuple[float, ...]) -> CastSequence:
        """Return a cast whose first leg leads back over the edge that was passed."""
        return CastSequence(
            anchor_m=(here_m[0], here_m[1]),
            upwind_rad=self.upwind_rad,
            side=-self.side,
            width_m=self.settings.cast_m,
            growth=self.settings.growth,
            n_legs=self.settings.n_casts,
        )


if __name__ == "__main__":
    run(Casting)
