"""A diagonal line of robots sweeps the room across the wind until one of them has gas; then all converge on the best.

After Marjovi and Marques. README.md beside this file has the rules and the deviations.
"""

import math

import numpy as np

from gslcosim.agent_kit import Briefing, run
from gslcosim_search.elementary import distance
from gslcosim_search.swarms.formations import (
    FormationAgent,
    diagonal_line,
    find_lane_point,
    in_world,
    nearest_axis_rad,
    plan_crosswind_lanes,
)
from gslcosim_search.swarms.particle_swarm import Sighting
from gslcosim_search.swarms.rounds import Round

NOWHERE_M = (math.inf, math.inf)


class LineSweep(FormationAgent):
    """One robot of the line; it remembers how far the sweep came, how wide the line is, and where going on failed."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.line = diagonal_line(self.n_members, 1.0)
        self.axis_rad = 0.0
        self.lanes_m: np.ndarray | None = None
        self.n_swept = 0
        self.spacing_m = self.settings.spacing_m
        self.failed_m = NOWHERE_M
        self.failed_s = 0.0
        self.n_blank = 0

    def numbers(self) -> tuple[float, ...]:
        """Return how far this robot has come with the sweep."""
        return (self.n_swept,)

    def next_place_m(self, now: Round) -> np.ndarray:
        """Return where this robot goes: with the sweep while there is no gas, else about the best place."""
        self.n_blank = 0 if now.has_gas else self.n_blank + 1
        if self.n_blank > self.settings.patience:
            self.best = None
        best = self.best
        if best is None:
            self.spacing_m = self.settings.spacing_m
            return self.swept_place_m(now)
        return self.converging_place_m(now, best)

    def swept_place_m(self, now: Round) -> np.ndarray:
        """Return the next place along the sweep: all go on from how far any of them has come."""
        if self.lanes_m is None:
            self.lanes_m = self.sweep_m(now)
        swept = [int(now.numbers_of(name)[0]) for name in now.names if now.numbers_of(name)]
        self.n_swept = max([self.n_swept, *swept]) + 1
        centre_m = find_lane_point(self.lanes_m, (self.n_swept - 1) * self.settings.search_step_m)
        return centre_m + in_world(self.settings.spacing_m * self.line, self.axis_rad)[self.index]

    def sweep_m(self, now: Round) -> np.ndarray:
        """Return the lanes of the line's middle, near end first: beyond walls, as all of the line must reach them."""
        n, spacing_m = self.n_members, self.settings.spacing_m
        self.axis_rad = nearest_axis_rad(self.upwind_rad)
        lanes_m = plan_crosswind_lanes(self.room, self.axis_rad, n * spacing_m, inset_m=-0.5 * (n - 1) * spacing_m)
        here_m = now.positions_m.mean(axis=0)
        return min((lanes_m, lanes_m[::-1]), key=lambda lanes_m: distance(lanes_m[0], here_m))

    def converging_place_m(self, now: Round, best: Sighting) -> np.ndarray:
        """Return the place in a line upwind of the round's most gas; where that failed lately, narrower about it."""
        s, i = self.settings, int(now.amounts.argmax())
        is_good = now.amounts[i] >= s.good_frac * best.amount
        if not is_good:
            self.failed_m, self.failed_s = best.place_m, best.time_s
        elif best.time_s > self.failed_s + s.contract_s:
            self.failed_m = NOWHERE_M
        centre_m = now.positions_m[i] if is_good else np.array(best.place_m)
        surges = is_good and distance(centre_m, self.failed_m) > s.lead_m
        self.spacing_m *= 1.0 / s.shrink_frac if surges else s.shrink_frac
        self.spacing_m = min(s.most_spacing_m, max(s.least_spacing_m, self.spacing_m))
        lead_m = np.array([[s.lead_m if surges else 0.0, 0.0]])
        return centre_m + in_world(self.spacing_m * self.line + lead_m, self.upwind_rad)[self.index]


if __name__ == "__main__":
    run(LineSweep)
