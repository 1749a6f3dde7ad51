"""A formation that climbs the gas: a plane through the readings of three or more robots gives the slope.

README.md beside this file has the rules and the deviations from the literature.
"""

import numpy as np

from gslcosim.agent_kit import Briefing, run
from gslcosim_search.swarms.formations import FormationAgent, fit_plane, formation, mixed_direction
from gslcosim_search.swarms.rounds import Round


class PlaneFit(FormationAgent):
    """One robot of a ring that reads in step with the others and moves with them up the slope and up the wind."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        radius_m = self.settings.radius_m
        self.offsets_m = formation("ring", self.n_members, radius_m)
        self.lanes = {"lane_m": 2.0 * radius_m + self.settings.gap_m, "inset_m": radius_m}

    def next_place_m(self, now: Round) -> np.ndarray:
        """Return this robot's place in the ring about the formation's next centre."""
        return self.next_centre_m(now) + self.offsets_m[self.index]

    def next_centre_m(self, now: Round) -> np.ndarray:
        """Return where the formation's centre goes: up the slope in gas, else to where gas was or may be."""
        here_m = self.centre_of(now, self.offsets_m)
        if not now.has_gas:
            return self.searching_centre_m(here_m, **self.lanes)
        self.met_gas(here_m, **self.lanes)
        plane = fit_plane(now.positions_m, now.amounts)
        if plane.gradient_per_m is None and self.best is not None:
            return np.array(self.best.place_m)
        uphill = mixed_direction(plane.gradient_per_m, self.wind.upwind_rad, self.settings.wind_share)
        return here_m if uphill is None else here_m + self.settings.step_m * uphill


if __name__ == "__main__":
    run(PlaneFit)
