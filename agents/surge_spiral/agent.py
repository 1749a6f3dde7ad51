"""Surge-spiral: upwind while there is gas; outwards in a spiral when it is lost.

After Lochmatter and Martinoli 2008. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.random_stream import RandomStream
from gslcosim.search.reactive.cast_and_surge import surge_end_m
from gslcosim.search.reactive.reactive_searcher import ReactiveSearcher, ReactiveSettings
from gslcosim.search.reactive.spirals import ArchimedeanSpiral, SpiralPath, SquareSpiral, random_side
from gslcosim.search.senses.stop_and_measure import Contact

LEAST_LEG_M = 0.1


class SurgeSpiral(Agent):
    """Remembers where gas was met last, the wind there, and how far a spiral has come."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.draws = RandomStream(briefing.seed)
        self.searcher = ReactiveSearcher(briefing, ReactiveSettings.of(self.settings), self.draws)
        self.upwind_rad = 0.0
        self.is_surging = False
        self.spiral: SpiralPath | None = None
        self.n_restarts_left = 0
        self.n_returns_left = 0

    def observe(self, observation: Observation) -> None:
        """Watch for gas on the way too."""
        self.searcher.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg: surge, spiral or explore."""
        contact = self.searcher.ask(observation, aborts=not self.is_surging)
        if isinstance(contact, Command):
            return contact
        if contact.upwind_rad is None or self.searcher.is_away:
            self.is_surging, self.spiral = False, None
            return self.searcher.explore(observation)
        if contact.has_gas:
            self.is_surging, self.spiral, self.upwind_rad = True, None, contact.upwind_rad
        left_m = contact.remaining_m(observation.position_world_m, self.settings.lost_m)
        if self.is_surging and left_m > LEAST_LEG_M:
            step_m = min(self.settings.step_m, left_m)
            place_m = surge_end_m(observation.position_world_m, contact.gas_m, self.upwind_rad, step_m)
            return self.searcher.fly_to(observation, place_m)
        if self.is_surging:
            self.is_surging = False
            self.n_restarts_left, self.n_returns_left = self.settings.n_restarts, self.settings.n_returns
            self.spiral = self.start_spiral(observation.position_world_m)
            answer = self.searcher.lose(observation, contact, self.upwind_rad)
            if answer is not None:
                return answer
        return self.wind_out(observation, contact)

    def start_spiral(self, centre_m: tuple[float, ...]) -> SpiralPath:
        """Return a spiral about a place, upwind first."""
        s, side = self.settings, random_side(self.draws)
        if s.shape == "archimedean":
            spiral = ArchimedeanSpiral(
                gap_m=s.gap_m, arc_m=s.arc_m, start_rad=self.upwind_rad, side=side, reach_m=s.reach_m
            )
        else:
            spiral = SquareSpiral(
                side_m=s.side_m, growth_m=s.growth_m, heading_rad=self.upwind_rad, side=side, n_sides=s.n_sides
            )
        room = self.searcher.pilot.room
        return SpiralPath(spiral, centre_m, is_free=room.contains, n_skips=s.n_skips)

    def wind_out(self, observation: Observation, contact: Contact) -> Command:
        """Return the next leg of the spiral; where it is blocked begin again; after it wind out from the last gas."""
        while self.spiral is not None:
            place_m = self.spiral.next_place_m()
            if place_m is not None:
                return self.searcher.cast_to(observation, place_m)
            is_blocked, self.spiral = self.spiral.is_blocked, None
            if is_blocked and self.n_restarts_left > 0:
                self.n_restarts_left -= 1
                self.spiral = self.start_spiral(observation.position_world_m)
            elif self.n_returns_left > 0 and contact.last_m is not None:
                self.n_returns_left -= 1
                self.spiral = self.start_spiral(contact.last_m)
        return self.searcher.explore(observation)


if __name__ == "__main__":
    run(SurgeSpiral)
