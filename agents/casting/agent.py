"""Casting: aslant to the wind through the plume; back across the wind when its edge is passed, then aslant again.

After Lochmatter and Martinoli 2008. README.md beside this file has the rules.
"""

import math

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.reactive.cast_and_surge import CastSequence, oblique_surge_end_m
from gslcosim_search.reactive.plume_tracking import PlumeTrackingAgent, Recovery
from gslcosim_search.reactive.spirals import random_side
from gslcosim_search.senses.stop_and_measure import Contact


class Casting(PlumeTrackingAgent):
    """Remembers its side of the wind, where gas was met last, and how far a cast back has come."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.beta_rad = math.radians(self.settings.beta_deg)
        self.side = random_side(self.draws)

    def meet_gas(self) -> None:
        """Cross to the other edge after having come back from one."""
        if self.recovery is not None:
            self.side = -self.side

    def track(self, observation: Observation, contact: Contact, *, is_regained: bool) -> Command:
        """Return a leg aslant through the plume, from the line upwind through gas that was met again."""
        return self.fly_to(
            observation,
            oblique_surge_end_m(
                observation.position_world_m,
                contact.gas_m if is_regained else None,
                self.upwind_rad,
                self.side * self.beta_rad,
                self.settings.step_m,
            ),
        )

    def start_recovery(self, here_m: tuple[float, ...], contact: Contact) -> Recovery:
        """Return the turns of a cast whose first leg leads back over the edge that was passed."""
        del contact
        return CastSequence(
            anchor_m=(here_m[0], here_m[1]),
            upwind_rad=self.upwind_rad,
            side=-self.side,
            width_m=self.settings.cast_m,
            growth=self.settings.growth,
            n_legs=self.settings.n_casts,
        ).next_turn_m


if __name__ == "__main__":
    run(Casting)
