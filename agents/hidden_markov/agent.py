"""Hidden Markov model: parcels of air hop from cell to cell, and what is found tells from which cell they came.

After Farrell, Pang and Li 2003. README.md beside this file has the rules, method.yaml the parameters.
"""

import numpy as np

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.bayes import hidden_markov
from gslcosim_search.bayes.belief_search import SourceBeliefAgent
from gslcosim_search.bayes.hidden_markov import (
    ParcelChain,
    compute_arrival_probabilities,
    compute_finding_likelihoods,
    likeliest_path,
    place_along_m,
)
from gslcosim_search.bayes.puff_tracing import PuffModel
from gslcosim_search.beliefs import distances_m
from gslcosim_search.senses.hit_detection import Finding


class HiddenMarkov(SourceBeliefAgent):
    """Believes by the chain's backward pass; after gas it follows the chain's likeliest path back to the source."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        hidden_markov.warm_up()
        settings = self.settings
        # For plans, which look at the whole room at once and know no walls.
        self.open_air = PuffModel(
            step_s=settings.wind_step_s,
            window_s=settings.window_s,
            initial_sigma_m=0.5 * self.grid.cell_m,
            spread_m_sqrt_s=settings.spread_m_sqrt_s,
            detection_probability=settings.detection_probability,
        )

    def update(self, observation: Observation, finding: Finding, weight: float) -> None:
        """Pull the finding back along the chain, from the sensor's cell to every cell and time of release."""
        plume = self.plume()
        chance = compute_arrival_probabilities(plume, self.cell_at(finding.sensor_m))
        mean_share, log_share = compute_finding_likelihoods(
            chance,
            detection_probability=self.settings.detection_probability,
            puffs_per_hop=self.settings.puffs_per_s * plume.hop_s,
        )
        if finding.is_hit:
            self.map.detect(mean_share, weight=weight)
        else:
            self.map.miss(log_share, weight=weight)

    def next_leg(self, observation: Observation) -> Command:
        """Return a leg back along the plume soon after gas, else one to where a finding tells most."""
        trace_m = None
        if self.settings.follow == "path" and self.is_tracking(observation):
            trace_m = self.trace_m(observation.position_world_m)
        return self.surge_or_search(observation, self.chance(observation, self.open_air), trace_m=trace_m)

    def trace_m(self, here_m: tuple[float, ...]) -> tuple[float, float] | None:
        """Return a place back along the likeliest path from a source that is at least a step away."""
        step_m, grid = self.settings.step_m, self.grid
        elsewhere = np.where(distances_m(grid, here_m) >= step_m, self.p, 0.0)
        path = likeliest_path(self.plume(), self.cell_at(here_m), elsewhere)
        return None if path is None else place_along_m(path, grid, step_m)

    def plume(self) -> ParcelChain:
        """Return the chain of the window past, in the wind as it was met."""
        settings = self.settings
        if self.field is not None:
            return hidden_markov.build_chain_in_wind_field(
                self.grid,
                ~self.free,
                self.field.winds_m_s(),
                window_s=settings.window_s,
                spread_m_sqrt_s=settings.spread_m_sqrt_s,
            )
        return hidden_markov.build_chain_in_uniform_wind(
            self.grid,
            ~self.free,
            self.winds.window_m_s(),
            step_s=settings.wind_step_s,
            spread_m_sqrt_s=settings.spread_m_sqrt_s,
        )

    def cell_at(self, place_m: tuple[float, ...]) -> hidden_markov.Cell:
        """Return the cell nearest to a place."""
        i, j = self.grid.nearest_cell(place_m)
        return i, j


if __name__ == "__main__":
    run(HiddenMarkov)
