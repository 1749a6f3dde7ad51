"""Fluxotaxis: a lattice of robots follows the flux of gas upstream, and declares when more flows out of it than in.

After Zarzhitsky and Spears. README.md beside this file has the rules and the deviations.
"""

import numpy as np

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.motion.declaration import Estimate
from gslcosim_search.swarms.fluxotaxis import (
    REACH,
    OutflowRule,
    RingFlow,
    divergence_slope,
    inflow_direction,
    relaxed_lattice,
    ring_flow,
)
from gslcosim_search.swarms.formations import FormationAgent, fit_plane, formation, mixed_direction, odour_offset_m
from gslcosim_search.swarms.rounds import Round

NO_FLOW = RingFlow(inward=0.0, outward=0.0)


class Fluxotaxis(FormationAgent):
    """One robot of the lattice; besides what the flight remembers it counts rounds with outflow."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        s = self.settings
        self.offsets_m = formation("hexagon", self.n_members, s.spacing_m)
        self.lanes = {"lane_m": 2.0 * s.spacing_m + s.gap_m, "inset_m": s.spacing_m}
        self.rule = OutflowRule(least_frac=s.released_frac, least_flow=s.least_flow, n_rounds=s.n_rounds)
        self.found: tuple[tuple[float, float], float] | None = None

    def learn(self, observation: Observation) -> None:
        """Take in the round, and what flows out of the lattice."""
        now = self.now
        self.learn_round(now, observation.time_s)
        flow = ring_flow(now.positions_m, flux_of(now))
        self.found = self.rule.declared(flow if self.is_bracketed(now) else NO_FLOW, now.positions_m.mean(axis=0))

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return where more gas flows out than in."""
        return None if self.found is None else Estimate(position_m=self.found[0], confidence=self.found[1])

    def next_leg(self, observation: Observation) -> Command:
        """Return the step with the lattice."""
        self.target_m = self.next_place_m(self.now)
        return super().next_leg(observation)

    def next_place_m(self, now: Round) -> np.ndarray:
        """Return this robot's place in the lattice after the next step of all."""
        flux = flux_of(now)
        return self.place_m(now) + self.next_step_m(now, flux, ring_flow(now.positions_m, flux))

    def place_m(self, now: Round) -> np.ndarray:
        """Return where this robot belongs in the lattice: in its slot until all have formed up, then by the forces."""
        centre_m = self.centre_of(now, self.offsets_m)
        slots_m = centre_m + self.offsets_m[self.slots_of(now)]
        if np.linalg.norm(now.positions_m - slots_m, axis=1).max() > self.settings.spacing_m:
            return centre_m + self.offsets_m[self.index]
        lattice_m = relaxed_lattice(now.positions_m, self.settings.spacing_m)
        return lattice_m[now.names.index(self.rounds.team.name)]

    def next_step_m(self, now: Round, flux: np.ndarray, flow: RingFlow) -> np.ndarray:
        """Return the step of the whole lattice: none about a source, upstream in gas, else to where gas may be."""
        here_m = now.positions_m.mean(axis=0)
        if not now.has_gas:
            return self.searching_centre_m(here_m, **self.lanes) - here_m
        self.met_gas(here_m, **self.lanes)
        upstream = None if self.rule.is_holding else self.upstream(now, flux, flow)
        return np.zeros(2) if upstream is None else self.settings.step_m * upstream

    def is_bracketed(self, now: Round) -> bool:
        """Return whether the gas leaves in the middle: beside a plume that widens, gas flows out of any ring."""
        offset_m = odour_offset_m(now.positions_m, now.amounts, self.upwind_rad)
        return abs(offset_m) <= self.settings.bracket_frac * self.settings.spacing_m

    def upstream(self, now: Round, flux: np.ndarray, flow: RingFlow) -> np.ndarray | None:
        """Return the direction to the source: up the divergence where gas is released, else to where most comes in."""
        if flow.released_frac >= self.settings.released_frac:
            slope = divergence_slope(now.positions_m, flux, REACH * self.settings.spacing_m)
            if slope.gradient_per_m is not None:
                return mixed_direction(slope.gradient_per_m, None, 0.0)
        inflow = inflow_direction(now.positions_m, flux)
        if inflow is not None:
            return inflow
        gradient = fit_plane(now.positions_m, now.amounts).gradient_per_m
        return mixed_direction(gradient, self.wind.upwind_rad, 0.5)


def flux_of(now: Round) -> np.ndarray:
    """Return the flux of gas at each robot, (n, 2): its amount times the wind, none where that was not felt."""
    return now.amounts[:, None] * np.nan_to_num(now.winds_m_s)


if __name__ == "__main__":
    run(Fluxotaxis)
