"""Surge-cast: upwind while there is gas; across the wind, one way and then farther the other, when it is lost.

After Lochmatter and Martinoli 2008. README.md beside this file has the rules and the exact arithmetic.
"""

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.reactive.cast_and_surge import BlankMemory, CastSequence, side_or_random, surge_end_m
from gslcosim_search.reactive.plume_tracking import PlumeTrackingAgent, Recovery
from gslcosim_search.senses.stop_and_measure import Contact

WANDER_M = 0.5


class SurgeCast(PlumeTrackingAgent):
    """Remembers where gas was met last, the wind there, and how far a cast has come."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.blanks = BlankMemory(
            first_s=self.settings.memory_s, least_s=self.settings.least_memory_s, most_s=self.settings.most_memory_s
        )

    def observe(self, observation: Observation) -> None:
        """Watch for gas on the way too."""
        super().observe(observation)
        if self.watch.is_hit:
            self.blanks.note_hit(observation.time_s)

    @property
    def may_abort(self) -> bool:
        """True if gas ends a leg that is under way."""
        return self.settings.aborts_legs and super().may_abort

    def is_lost(self, observation: Observation, contact: Contact) -> bool:
        """Return whether the plume counts as lost: no gas for a distance, or for longer than the last blank."""
        if self.settings.lost_by == "last_blank":
            return not contact.has_gas and self.blanks.is_lost(observation.time_s)
        return super().is_lost(observation, contact)

    def track(self, observation: Observation, contact: Contact, *, is_regained: bool) -> Command:
        """Return a leg upwind, in line with the gas of the last leg; without gas only as far as it takes to lose it."""
        del is_regained
        here_m, step_m = observation.position_world_m, self.settings.step_m
        if self.settings.lost_by == "distance":
            step_m = min(step_m, contact.remaining_m(here_m, self.settings.lost_m))
        return self.fly_to(observation, surge_end_m(here_m, contact.gas_m, self.upwind_rad, step_m))

    def start_recovery(self, here_m: tuple[float, ...], contact: Contact) -> Recovery:
        """Return the turns of a cast that begins on the side on which gas was met last, else on a random one."""
        return CastSequence(
            anchor_m=(here_m[0], here_m[1]),
            upwind_rad=self.upwind_rad,
            side=side_or_random(contact.last_m or here_m, here_m, self.upwind_rad, self.draws),
            width_m=self.settings.cast_m,
            growth=self.settings.growth,
            n_legs=self.settings.n_casts,
        ).next_turn_m

    def explore(self, observation: Observation) -> Command:
        """Return a leg without gas: to a place not seen yet, or at random nearby."""
        if self.settings.explore == "unseen" or self.is_away:
            return super().explore(observation)
        x_m, y_m, _ = observation.position_world_m
        wander_m = (self.draws.uniform(-WANDER_M, WANDER_M), self.draws.uniform(-WANDER_M, WANDER_M))
        return self.cast_to(observation, (x_m + wander_m[0], y_m + wander_m[1]))


if __name__ == "__main__":
    run(SurgeCast)
