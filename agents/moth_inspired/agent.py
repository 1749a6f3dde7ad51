"""Moth-inspired: find, track in, track out, reacquire by a cloverleaf, and declare where the plume is lost each time.

After Li, Farrell et al. 2006. README.md beside this file has the rules.
"""

import math

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.random_stream import RandomStream
from gslcosim.search.reactive.cast_and_surge import oblique_surge_end_m
from gslcosim.search.reactive.reactive_searcher import ReactiveSearcher, ReactiveSettings
from gslcosim.search.reactive.spirals import CloverleafPath, random_side
from gslcosim.search.senses.stop_and_measure import Contact

LEAST_LEG_M = 0.1


class MothInspired(Agent):
    """Remembers its side, its wind, and how far a cloverleaf has come."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.draws = RandomStream(briefing.seed)
        self.searcher = ReactiveSearcher(briefing, ReactiveSettings.of(self.settings), self.draws)
        self.side = random_side(self.draws)
        self.upwind_rad = 0.0
        self.is_tracking = False
        self.clover: CloverleafPath | None = None

    def observe(self, observation: Observation) -> None:
        """Watch for gas on the way too."""
        self.searcher.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg, or the declaration."""
        contact = self.searcher.ask(observation, aborts=not self.is_tracking)
        if isinstance(contact, Command):
            return contact
        if contact.upwind_rad is None or self.searcher.is_away:
            self.is_tracking, self.clover = False, None
            return self.searcher.explore(observation)
        if contact.has_gas:
            return self.track_in(observation, contact)
        left_m = contact.remaining_m(observation.position_world_m, self.settings.lost_m)
        if self.is_tracking and left_m > LEAST_LEG_M:
            return self.track_out(observation, min(left_m, self.settings.step_m))
        if self.is_tracking:
            self.is_tracking, self.clover = False, self.new_clover(contact)
            answer = self.searcher.lose(observation, contact, self.upwind_rad)
            if answer is not None:
                return answer
        command = None if self.clover is None else self.searcher.follow(observation, self.clover.next_place_m)
        return self.searcher.explore(observation) if command is None else command

    def track_in(self, observation: Observation, contact: Contact) -> Command:
        """Return a leg upwind, by an angle to one side and then to the other."""
        assert contact.upwind_rad is not None
        gas_m = None if self.is_tracking else contact.gas_m
        self.is_tracking, self.clover, self.upwind_rad = True, None, contact.upwind_rad
        self.side = -self.side
        slant_rad = self.side * math.radians(self.settings.slant_deg)
        here_m, step_m = observation.position_world_m, self.settings.step_m
        return self.searcher.fly_to(observation, oblique_surge_end_m(here_m, gas_m, self.upwind_rad, slant_rad, step_m))

    def track_out(self, observation: Observation, step_m: float) -> Command:
        """Return a leg straight upwind: the gas may come again."""
        return self.searcher.fly_to(
            observation, oblique_surge_end_m(observation.position_world_m, None, self.upwind_rad, 0.0, step_m)
        )

    def new_clover(self, contact: Contact) -> CloverleafPath:
        """Return a cloverleaf about the place where gas was met last."""
        assert contact.last_m is not None
        return CloverleafPath(
            centre_m=contact.last_m[:2],
            radius_m=self.settings.leaf_m,
            upwind_rad=self.upwind_rad,
            side=self.side,
            n_per_leaf=self.settings.n_per_leaf,
        )


if __name__ == "__main__":
    run(MothInspired)
