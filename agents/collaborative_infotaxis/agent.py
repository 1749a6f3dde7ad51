"""Collaborative infotaxis: each robot runs infotaxis on the findings of all, and leaves to the others what they chose.

README.md beside this file has the rules, method.yaml the parameters.
"""

import math

import numpy as np

from gslcosim.agent_kit import Briefing, Command, Observation, RadioMessage, run
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.elementary import distance
from gslcosim_search.information.information_agent import arrival_radius_m, assumed_dispersal, direction_spread_rad
from gslcosim_search.information.objectives import find_min_cost_index
from gslcosim_search.motion.declaration import Estimate, by_entropy, by_mass
from gslcosim_search.motion.legs import LegPlanner, leg_end
from gslcosim_search.occupancy import free_cells
from gslcosim_search.search_agent import SearchAgent
from gslcosim_search.senses.hit_detection import Finding, GasEvidence
from gslcosim_search.senses.instruments import find_noses, find_vane
from gslcosim_search.senses.wind_field import WindRecord
from gslcosim_search.swarms.rounds import Report, Team, round_to_sent_digits
from gslcosim_search.swarms.shared_belief import SharedBelief, SharedFinding, assigned_costs

WIND_STEP_S = 1.0
# Who was not heard for so long has no plan any more.
PLAN_LASTS_S = 15.0
# Others whose plans are weighed: each doubles the outcomes.
N_PLANNED = 2
Place = tuple[float, float]


class CollaborativeInfotaxis(SearchAgent):
    """One robot of the team; its belief rests on the findings of all, its choice on where the others are going."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        s = self.settings
        self.team, self.pilot = Team(briefing), LegPlanner(briefing, self.draws, margin_m=s.wall_margin_m)
        self.evidence = GasEvidence(find_noses(briefing)[0], every_s=s.stop_s, threshold_ppm=s.threshold_ppm)
        self.winds = WindRecord(find_vane(briefing), step_s=WIND_STEP_S, n_steps=max(1, round(s.wind_memory_s)))
        self.grid = CellGrid.covering(briefing.bounds, s.cell_m)
        self.belief = SharedBelief(
            self.grid,
            free_cells(briefing.known_map, self.grid),
            assumed_dispersal(briefing, s, 2),
            floor=s.floor,
            power=s.power,
            near_m=0.5 * s.step_m,
            reach_m=arrival_radius_m(briefing) if s.arrival == "by_mission" else 0.0,
        )
        self.reports: list[Report] = []
        self.aimed_m: Place | None = None
        self.choose((1.0, 1.0), 0.0)

    def observe(self, observation: Observation) -> None:
        """Take note of wind and gas on the way, and of what the others found."""
        super().observe(observation)
        self.winds.add(observation)
        finding = self.evidence.add(observation)
        if finding is not None:
            self.reports.append(self.report(finding, observation.time_s))
            self.take(self.team.name, self.reports[-1])
        for name, report in self.team.receive(observation):
            self.take(name, report)

    @property
    def p(self) -> np.ndarray:
        """The belief of all."""
        return self.belief.p

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command while a leg is under way."""
        return self.pilot.continue_leg(observation)

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return where the source is, once most of the belief lies close together or its entropy is low."""
        s, p = self.settings, self.p
        found = by_mass(p, self.grid, radius_m=s.radius_m, least=s.mass)
        return found or by_entropy(p, self.grid, limit_bits=s.entropy_bits, radius_m=s.radius_m)

    def next_leg(self, observation: Observation) -> Command:
        """Return the way to the next stop."""
        x_m, y_m, _ = observation.position_world_m
        self.aimed_m = self.choose((x_m, y_m), observation.time_s)
        return self.pilot.leg(observation, self.aimed_m, hold_s=self.settings.hold_s)

    def choose(self, here_m: Place, time_s: float) -> Place:
        """Return the place that adds most to what the others will find; not one that another robot is going to."""
        plans_m = self.plans_m(here_m, time_s)
        places_m = self.places_m(here_m)
        places_m = [p for p in places_m if all(distance(p, q) > self.settings.apart_m for q in plans_m)] or places_m
        wind_m_s, spread_rad = self.wind()
        own = self.belief.candidates(places_m, wind_m_s, spread_rad)
        planned = [self.belief.candidates([place_m], wind_m_s, spread_rad) for place_m in plans_m[:N_PLANNED]]
        return places_m[find_min_cost_index(assigned_costs(self.belief.p.reshape(-1), own, planned))]

    def places_m(self, here_m: Place) -> list[Place]:
        """Return the ends of steps that may be flown; here where there are none."""
        n, room = self.settings.n_headings, self.pilot.room
        ends = [leg_end(here_m, 2.0 * math.pi * k / n, self.settings.step_m, room) for k in range(n)]
        return [(end[0], end[1]) for end in ends if end is not None] or [here_m]

    def plans_m(self, here_m: Place, time_s: float) -> list[Place]:
        """Return where the others are going, by what they reported last, the nearest first."""
        recent = self.team.recent(time_s, PLAN_LASTS_S).values()
        plans_m = [(report.numbers[2], report.numbers[3]) for report in recent if len(report.numbers) >= 4]
        return sorted(plans_m, key=lambda plan_m: distance(plan_m, here_m))

    def wind(self) -> tuple[Place, float]:
        """Return the mean wind of the last seconds [m/s], and how far its direction spreads [rad]."""
        winds_m_s = self.winds.winds_m_s()
        if not len(winds_m_s):
            return (0.0, 0.0), 0.0
        x_m_s, y_m_s = winds_m_s.mean(axis=0)
        return (float(x_m_s), float(y_m_s)), direction_spread_rad(winds_m_s)

    def report(self, finding: Finding, time_s: float) -> Report:
        """Return a finding as the others hear it: it weighs the same for all."""
        wind_m_s, spread_rad = self.wind()
        report = Report(
            time_s=time_s,
            position_m=finding.sensor_m,
            amount=float(finding.is_hit),
            wind_m_s=wind_m_s,
            numbers=(float(len(self.reports) + 1), spread_rad, *(self.aimed_m or ())),
        )
        return round_to_sent_digits(report, self.team)

    def take(self, finder: str, report: Report) -> None:
        """Put a finding into the belief, one's own or another's."""
        if len(report.numbers) < 2 or report.wind_m_s is None:
            return
        self.belief.add(
            SharedFinding(
                finder=finder, number=int(report.numbers[0]), time_s=report.time_s, place_m=report.position_m[:2],
                is_hit=report.amount > 0.5, wind_m_s=report.wind_m_s, spread_rad=report.numbers[1],
            )
        )  # fmt: skip

    def outgoing(self, observation: Observation) -> tuple[RadioMessage, ...]:
        """Return the last findings, the oldest first: who missed one hears it the next time."""
        return tuple(
            message for report in self.reports[-self.settings.n_repeats :] for message in self.team.call(report)
        )


if __name__ == "__main__":
    run(CollaborativeInfotaxis)
