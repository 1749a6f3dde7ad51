"""A search planned as a partially observable decision problem: a learned plume, a belief, and QMDP or Perseus.

README.md beside this file has the rules; the arithmetic is in gslcosim_search.information, offsets and pomdp.
"""

import math
from pathlib import Path

import numpy as np

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import waypoint
from gslcosim_search.beliefs import BeliefPublisher, CellGrid
from gslcosim_search.information.pomdp import (
    MOVES,
    PlumeTable,
    RunningWind,
    headings_rad,
    offsets_m,
    update_offset_belief,
)
from gslcosim_search.motion.declaration import Estimate, by_mass
from gslcosim_search.motion.legs import LegSpace, leg_end, next_leg
from gslcosim_search.occupancy import free_cells
from gslcosim_search.search_agent import SearchAgent
from gslcosim_search.senses.instruments import find_noses, find_vane
from gslcosim_search.senses.stop_and_measure import StopAndMeasure

TABLE = Path(__file__).with_name("plumes.npz")
MAX_CELLS = 20_000
# Directions over which the likelihood is averaged as long as no wind has been felt.
N_UNKNOWN = 8
# Ties between moves are broken by their order, not by the last bit of a sum.
DECIMALS = 9


class Qmdp(SearchAgent):
    """Believes in source cells; flies the move that its policy values most."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.table = PlumeTable.load(TABLE)
        self.move_m = self.table.policy_grid.cell_m
        nose = next(nose for nose in find_noses(briefing) if nose.unit == "ppm" or nose.estimate is not None)
        self.measure = StopAndMeasure((nose,), find_vane(briefing))
        self.wind = RunningWind(memory_s=self.settings.wind_memory_s, threshold_m_s=self.settings.threshold_m_s)
        self.room = LegSpace.within(briefing.bounds, self.settings.margin_m)
        self.publisher = BeliefPublisher(every_s=self.settings.belief_every_s)
        self.grid = CellGrid.covering(briefing.bounds, self.settings.cell_m, max_cells=MAX_CELLS)
        self.places_m = self.grid.centres_m()
        free = free_cells(briefing.known_map, self.grid)
        self.belief = np.asarray(free, np.float64).ravel() / np.sum(free)
        self.refused: set[tuple[int, int, int]] = set()
        self.visits: dict[tuple[int, int], int] = {}
        self.last: tuple[int, int, int] | None = None
        self.escape_rad, self.n_escape = 0.0, 0

    def observe(self, observation: Observation) -> None:
        """Measure while the vehicle holds."""
        super().observe(observation)
        self.measure.add(observation)

    @property
    def p(self) -> np.ndarray:
        """The belief in the source's cell."""
        return self.belief.reshape(self.grid.shape)

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return where the source is once the belief has gathered."""
        return by_mass(self.p, self.grid, radius_m=self.settings.source_radius_m, least=self.settings.declare_mass)

    def next_leg(self, observation: Observation) -> Command:
        """Return the move of the greatest value."""
        x_m, y_m = self._next_end_m(observation)
        return waypoint(observation, x_m, y_m, self.height_m, hold_s=self.settings.hold_s)

    def learn(self, observation: Observation) -> None:
        """Learn from the hold: gas, wind, and so where the source may be."""
        measured = self.measure.measured()
        if measured is None:
            return
        if measured.wind is not None:
            self.wind.add(observation.time_s, measured.wind.speed_m_s, measured.wind.upwind_rad)
        level, likelihood = self.table.level_of(measured.ppm[0]), np.zeros(self.grid.n_cells)
        for downwind_rad in self._downwinds_rad():
            likelihood += self.table.likelihood(level, self._offsets_m(observation, downwind_rad))
        likelihood /= len(self._downwinds_rad())
        self.belief = update_offset_belief(self.belief, likelihood, self.settings.power)

    def _downwinds_rad(self) -> list[float]:
        if self.wind.downwind_rad is not None:
            return [self.wind.downwind_rad]
        return [2.0 * math.pi * k / N_UNKNOWN for k in range(N_UNKNOWN)]

    def _offsets_m(self, observation: Observation, downwind_rad: float) -> np.ndarray:
        x_m, y_m, _ = observation.position_world_m
        return offsets_m(self.places_m, (x_m, y_m), downwind_rad)

    # A move that was refused here is not tried again here; circles that teach nothing are left at random.
    def _next_end_m(self, observation: Observation) -> tuple[float, float]:
        here_m = observation.position_world_m[:2]
        i, j = self.grid.nearest_cell(here_m)
        if observation.notice is not None:
            self.n_escape = 0
            if self.last is not None:
                self.refused.add(self.last)
        self.visits[i, j] = self.visits.get((i, j), 0) + 1
        if self.n_escape == 0 and 0 < self.settings.stuck_visits < self.visits[i, j]:
            self.escape_rad, self.n_escape = self.draws.angle_rad(), self.settings.escape_legs
            self.visits.clear()
        if self.n_escape > 0:
            self.n_escape -= 1
            self.last = None
            leg = next_leg(here_m, [self.escape_rad], self.move_m, self.room, self.draws)
            self.escape_rad = self.escape_rad if leg.heading_rad is None else leg.heading_rad
            return leg.end_m[0], leg.end_m[1]
        return self._best_end_m(observation, i, j)

    def _best_end_m(self, observation: Observation, i: int, j: int) -> tuple[float, float]:
        here_m, downwind_rad = observation.position_world_m[:2], self._downwinds_rad()[0]
        values = self.table.action_values(self.settings.policy, self.belief, self._offsets_m(observation, downwind_rad))
        headings = headings_rad(downwind_rad)
        for k in np.argsort(-values.round(DECIMALS), kind="stable"):
            quarter = round(headings[k] / (math.pi / 2.0)) % len(MOVES)
            end_m = leg_end(here_m, headings[k], self.move_m, self.room)
            if end_m is not None and (i, j, quarter) not in self.refused:
                self.last = (i, j, quarter)
                return end_m[0], end_m[1]
        self.last = None
        leg = next_leg(here_m, [], self.move_m, self.room, self.draws)
        return leg.end_m[0], leg.end_m[1]


if __name__ == "__main__":
    run(Qmdp)
