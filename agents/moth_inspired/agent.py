"""Moth-inspired: find, track in, track out, reacquire by a cloverleaf, and declare where the plume is lost each time.

After Li, Farrell et al. 2006. README.md beside this file has the rules.
"""

import math

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.reactive.cast_and_surge import oblique_surge_end_m
from gslcosim_search.reactive.plume_tracking import PlumeTrackingAgent, Recovery
from gslcosim_search.reactive.spirals import CloverleafPath, random_side
from gslcosim_search.senses.stop_and_measure import Contact


class MothInspired(PlumeTrackingAgent):
    """Remembers its side, its wind, and how far a cloverleaf has come."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.side = random_side(self.draws)

    def meet_gas(self) -> None:
        """Change sides: in gas it tracks in by an angle to one side and then to the other."""
        self.side = -self.side

    def track(self, observation: Observation, contact: Contact, *, is_regained: bool) -> Command:
        """Return a leg upwind: aslant in gas, else straight, for the gas may come again."""
        here_m, settings = observation.position_world_m, self.settings
        slant_rad = self.side * math.radians(settings.slant_deg) if contact.has_gas else 0.0
        step_m = min(contact.remaining_m(here_m, settings.lost_m), settings.step_m)
        gas_m = contact.gas_m if is_regained else None
        return self.fly_to(observation, oblique_surge_end_m(here_m, gas_m, self.upwind_rad, slant_rad, step_m))

    def start_recovery(self, here_m: tuple[float, ...], contact: Contact) -> Recovery:
        """Return the places of a cloverleaf about the place where gas was met last."""
        del here_m
        assert contact.last_m is not None
        return CloverleafPath(
            centre_m=contact.last_m[:2],
            radius_m=self.settings.leaf_m,
            upwind_rad=self.upwind_rad,
            side=self.side,
            n_per_leaf=self.settings.n_per_leaf,
        ).next_place_m


if __name__ == "__main__":
    run(MothInspired)
