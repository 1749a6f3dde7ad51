"""SniffySquad: a team on one GrGSL belief, some of it cold and some hot, that swaps these roles where it pays.

After arXiv 2411.06121. README.md beside this file has the rules, method.yaml the parameters.
"""

import numpy as np

from gslcosim.agent_kit import Briefing, Command, Observation, RadioMessage, run
from gslcosim_search import elementary
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.maps.gr_gsl import GrGsl, GrGslSettings, warm_up
from gslcosim_search.maps.map_agents import MapAgent
from gslcosim_search.motion.declaration import Estimate, by_variance
from gslcosim_search.motion.map_navigation import StopRecorder
from gslcosim_search.senses.instruments import find_noses, find_vane
from gslcosim_search.senses.stop_and_measure import Measurement
from gslcosim_search.swarms.rounds import Round, Rounds
from gslcosim_search.swarms.shared_belief import (
    belief_potential,
    langevin_step_m,
    potential_slope,
    settle_roles,
    swap_roles,
    temperature_ladder,
)

HIT, CLEAN, UNCLEAR = 1.0, 0.0, -1.0
N_REDRAWS = 20


class SniffySquad(MapAgent):
    """One robot of the squad: its belief is that of all, its role is a rung on the ladder of temperatures."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        warm_up()
        super().__init__(briefing)
        s = self.settings
        self.watch = StopRecorder(briefing, threshold_ppm=s.gas_threshold_ppm, every_s=s.finding_s)
        nose, vane = find_noses(briefing)[0], find_vane(briefing)
        self.rounds = Rounds(briefing, nose, vane, amount=self.verdict, timeout_s=s.timeout_s)
        figures = GrGslSettings(sigma_hit_rad=s.sigma_hit_rad, sigma_miss_rad=s.sigma_miss_rad)
        self.method = GrGsl(self.flights.free, self.flights.grid, figures, flyable=self.flights.flyable)
        self.ladder = temperature_ladder(self.rounds.n_members, s.coldest, s.hottest)
        self.role = self.rounds.index
        self.name = briefing.agent
        self.asked: Observation | None = None
        self.now: Round | None = None

    def observe(self, observation: Observation) -> None:
        """Read and listen: reports come with any observation."""
        super().observe(observation)
        self.watch.add(observation)
        self.rounds.observe(observation)

    def continue_leg(self, observation: Observation) -> Command | None:
        """Go on to the goal; there wait until all have read."""
        flights, self.asked = self.flights, observation
        command = super().continue_leg(observation) or flights.continue_to_goal(observation)
        if command is not None:
            return command
        flights.goal_m = None
        potential = float(belief_potential(self.method.p)[flights.grid.nearest_cell(observation.position_world_m)])
        self.now = self.rounds.complete(observation, (self.role, potential, self.draws.fraction()))
        return self.rounds.wait(observation) if self.now is None else None

    @property
    def p(self) -> np.ndarray:
        """The belief of the squad."""
        return self.method.p

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return where the source is once the belief is narrow."""
        return by_variance(self.p, self.grid, limit_m2=self.settings.declare_variance_m2)

    def outgoing(self, observation: Observation) -> tuple[RadioMessage, ...]:
        """Return the last report once more."""
        return self.rounds.call()

    def verdict(self, _: Measurement) -> float:
        """Return what the reports say of the gas at a stop: there was some, none, or the sensor cannot tell."""
        assert self.asked is not None
        return {True: HIT, False: CLEAN, None: UNCLEAR}[self.watch.stop(self.asked).is_hit]

    def learn(self, observation: Observation) -> None:
        """Take in what all have measured, in the order of their names, so that all come to the same belief."""
        assert self.now is not None
        now = self.now
        for report in now.reports.values():
            x_m_s, y_m_s = report.wind_m_s or (0.0, 0.0)
            is_calm = norm2(x_m_s, y_m_s) <= self.settings.wind_threshold_m_s
            if report.amount != UNCLEAR:
                downwind_rad = None if is_calm else elementary.atan2(y_m_s, x_m_s)
                self.method.update(report.position_m, is_hit=report.amount == HIT, downwind_rad=downwind_rad)
        self.role = self.roles(now)[self.name]

    def roles(self, now: Round) -> dict[str, int]:
        """Return everyone's role after this round's swaps, by what all have reported."""
        reported = {name: now.numbers_of(name) for name in now.names if len(now.numbers_of(name)) == 3}
        roles = settle_roles({name: int(numbers[0]) for name, numbers in reported.items()}, len(self.ladder))
        potentials = {name: numbers[1] for name, numbers in reported.items()}
        fractions = {name: numbers[2] for name, numbers in reported.items()}
        is_odd, attempt = now.number % 2 == 1, self.settings.attempt
        return {self.name: self.role} | swap_roles(
            roles, potentials, fractions, self.ladder, is_odd=is_odd, attempt=attempt
        )

    def next_leg(self, observation: Observation) -> Command:
        """Return the leg of a Langevin step; one that ends in something solid or at another robot is drawn again."""
        assert self.now is not None
        now = self.now
        flights, s = self.flights, self.settings
        here_m = observation.position_world_m[:2]
        others_m = [report.position_m[:2] for name, report in now.reports.items() if name != self.name]
        slope = potential_slope(belief_potential(self.method.p), flights.grid, here_m)
        goal_m = flights.nearest_flyable_m(here_m)
        for _ in range(N_REDRAWS):
            noise = np.array((self.draws.normal(), self.draws.normal()))
            dx_m, dy_m = langevin_step_m(
                slope, noise, temperature=self.ladder[self.role], mobility_m2=s.mobility_m2, longest_m=s.leg_m
            )
            end_m = (here_m[0] + float(dx_m), here_m[1] + float(dy_m))
            cell = flights.grid.cell_at(end_m)
            is_free = cell is not None and bool(flights.flyable[cell])
            if is_free and all(distance(end_m, other_m) > s.apart_m for other_m in others_m):
                goal_m = end_m
                break
        flights.go_to(goal_m)
        return flights.leg(observation) or flights.stay(observation)


if __name__ == "__main__":
    run(SniffySquad)
