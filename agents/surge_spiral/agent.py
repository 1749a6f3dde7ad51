"""Surge-spiral: upwind while there is gas; outwards in a spiral when it is lost.

After Lochmatter and Martinoli 2008. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.reactive.cast_and_surge import surge_end_m
from gslcosim_search.reactive.plume_tracking import PlumeTrackingAgent, Recovery
from gslcosim_search.reactive.spirals import ArchimedeanSpiral, SpiralPath, SquareSpiral, random_side
from gslcosim_search.senses.stop_and_measure import Contact


class SurgeSpiral(PlumeTrackingAgent):
    """Remembers where gas was met last, the wind there, and how far a spiral has come."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.spiral: SpiralPath | None = None
        self.n_restarts_left = 0

    def track(self, observation: Observation, contact: Contact, *, is_regained: bool) -> Command:
        """Return a leg upwind, in line with the gas of the last leg."""
        del is_regained
        here_m = observation.position_world_m
        step_m = min(self.settings.step_m, contact.remaining_m(here_m, self.settings.lost_m))
        return self.fly_to(observation, surge_end_m(here_m, contact.gas_m, self.upwind_rad, step_m))

    def start_recovery(self, here_m: tuple[float, ...], contact: Contact) -> Recovery:
        """Return the places of a spiral about a place."""
        del contact
        self.n_restarts_left = self.settings.n_restarts
        return self.start_spiral(here_m)

    def start_spiral(self, centre_m: tuple[float, ...]) -> Recovery:
        """Return the places of a spiral about a place, upwind first."""
        s, side = self.settings, random_side(self.draws)
        if s.shape == "archimedean":
            spiral = ArchimedeanSpiral(
                gap_m=s.gap_m, arc_m=s.arc_m, start_rad=self.upwind_rad, side=side, reach_m=s.reach_m
            )
        else:
            spiral = SquareSpiral(
                side_m=s.side_m, growth_m=s.growth_m, heading_rad=self.upwind_rad, side=side, n_sides=s.n_sides
            )
        room = self.pilot.room
        self.spiral = SpiralPath(spiral, centre_m, is_free=room.contains, n_skips=s.n_skips)
        return self.spiral.next_place_m

    def recover(self, observation: Observation, contact: Contact) -> Command:
        """Return the next leg of the spiral; where it is blocked begin again; after it wind out from the last gas."""
        while self.recovery is not None:
            place_m = self.recovery()
            if place_m is not None:
                return self.cast_to(observation, place_m)
            self.recovery = None
            if self.spiral is not None and self.spiral.is_blocked and self.n_restarts_left > 0:
                self.n_restarts_left -= 1
                self.recovery = self.start_spiral(observation.position_world_m)
            elif self.n_returns_left > 0 and contact.last_m is not None:
                self.n_returns_left -= 1
                self.recovery = self.start_spiral(contact.last_m)
        return self.explore(observation)


if __name__ == "__main__":
    run(SurgeSpiral)
