"""A formation that goes upwind, centres itself on the odour, and is held together by Laplacian feedback.

After Soares, Aguiar, Pascoal and Martinoli. README.md beside this file has the rules and the deviations.
"""

import numpy as np

from gslcosim.agent_kit import Briefing, run
from gslcosim_search.swarms.formations import (
    FormationAgent,
    formation,
    in_world,
    laplacian_leg_m,
    next_width,
    odour_offset_m,
)
from gslcosim_search.swarms.rounds import Round

LEAST_WIDTH, MOST_WIDTH = 0.5, 2.0


class Laplacian(FormationAgent):
    """One robot of the formation; besides what the flight remembers it knows how wide the formation is."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.slots_m = formation(self.settings.shape, self.n_members, self.settings.size_m)
        self.width = 1.0
        span_m = float(np.ptp(self.slots_m[:, 1]))
        self.lanes = {"lane_m": span_m + self.settings.gap_m, "inset_m": 0.5 * span_m}

    def next_place_m(self, now: Round) -> np.ndarray:
        """Return where this robot goes: by the law in gas, else with its slot to where gas was or may be."""
        upwind_rad = self.upwind_rad
        self.adapt_width(now)
        offsets_m = in_world(self.width * self.slots_m, upwind_rad)
        here_m = self.centre_of(now, offsets_m)
        if not now.has_gas:
            return self.searching_centre_m(here_m, **self.lanes) + offsets_m[self.index]
        self.met_gas(here_m, **self.lanes)
        s, i = self.settings, now.names.index(self.rounds.team.name)
        leg_m = laplacian_leg_m(
            i,
            now.positions_m,
            offsets_m[self.slots_of(now)],
            upwind_rad,
            odour_offset_m(now.positions_m, now.amounts, upwind_rad),
            dt_s=s.dt_s,
            formation_per_s=s.formation_per_s,
            upwind_m_s=s.upwind_m_s,
            odour_per_s=s.odour_per_s,
        )
        return now.positions_m[i] + leg_m

    def adapt_width(self, now: Round) -> None:
        """Stretch the formation while its edges smell gas, and draw it together while only its middle does."""
        slots_m = self.slots_m[self.slots_of(now)]
        self.width = next_width(
            self.width, slots_m, now.amounts > 0.0, change_frac=self.settings.widen_frac, least=LEAST_WIDTH,
            most=MOST_WIDTH,
        )  # fmt: skip


if __name__ == "__main__":
    run(Laplacian)
