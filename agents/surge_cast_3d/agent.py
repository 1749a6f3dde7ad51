"""Surge-cast in three dimensions: upwind while there is gas; to the sides, up and down when it is lost.

After Rahbar et al. 2017. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.reactive.cast_and_surge import PlaneCastSequence, side_or_random, surge_end_m
from gslcosim_search.reactive.plume_tracking import PlumeTrackingAgent, Recovery
from gslcosim_search.senses.stop_and_measure import Contact


class SurgeCast3d(PlumeTrackingAgent):
    """Remembers where gas was met last, the wind there, how far a cast has come, and at which height it explores."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.explore_height_m = briefing.search_height_m
        self.n_layers = 0

    def track(self, observation: Observation, contact: Contact, *, is_regained: bool) -> Command:
        """Return a level leg upwind, on the line and at the height of the gas of the last leg."""
        del is_regained
        here_m = observation.position_world_m
        step_m = min(self.settings.step_m, contact.remaining_m(here_m, self.settings.lost_m))
        x_m, y_m = surge_end_m(here_m, contact.gas_m, self.upwind_rad, step_m)
        return self.fly_to(observation, (x_m, y_m, here_m[2] if contact.gas_m is None else contact.gas_m[2]))

    def start_recovery(self, here_m: tuple[float, ...], contact: Contact) -> Recovery:
        """Return the turns of a cast that begins on the side, and above or below, where gas was met last."""
        last_m, (x_m, y_m, z_m) = contact.last_m or here_m, here_m
        return PlaneCastSequence(
            anchor_m=(x_m, y_m, z_m),
            upwind_rad=self.upwind_rad,
            side=side_or_random(last_m, here_m, self.upwind_rad, self.draws),
            lift=1 if last_m[2] >= z_m else -1,
            width_m=self.settings.cast_m,
            height_m=self.settings.cast_height_m,
            n_legs=self.settings.n_casts,
        ).next_turn_m

    def explore(self, observation: Observation) -> Command:
        """Return a leg without gas; when all of a height is seen the next one comes: above, below, farther above."""
        if self.unseen.n_unseen == 0:
            self.n_layers += 1
            away_m = (self.n_layers + 1) // 2 * self.settings.layer_m * (1 if self.n_layers % 2 else -1)
            low_m, high_m = self.pilot.room.min_m[2], self.pilot.room.max_m[2]
            self.explore_height_m = max(low_m, min(high_m, self.pilot.height_m + away_m))
        return super().explore(observation)


if __name__ == "__main__":
    run(SurgeCast3d)
