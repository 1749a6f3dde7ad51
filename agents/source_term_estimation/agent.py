"""Source-term estimation: particles of place, rate and plume, weighed by readings; flies where a reading tells most.

After Hutchinson, Liu and Chen 2018. README.md beside this file has the rules, method.yaml the parameters.
"""

import math
from dataclasses import replace

import numpy as np

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search import elementary
from gslcosim_search.bayes import source_terms
from gslcosim_search.bayes.belief_search import BeliefAgent
from gslcosim_search.bayes.source_terms import PlumeSensor, SourcePrior, SourceTermFilter, TermPrior
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.motion.coverage import CoverageGrid
from gslcosim_search.motion.declaration import Estimate, by_spread
from gslcosim_search.search_agent import extract_settings
from gslcosim_search.senses.hit_detection import Finding
from gslcosim_search.senses.instruments import find_noses

N_DIRECTIONS = 8
NEAR_AND_FAR = (1.0, 3.0)  # candidate places lie so many steps away


class SourceTermEstimation(BeliefAgent):
    """Believes in sets of source terms; goes where the next reading tells most, and to the mean once it is narrow."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, self.program)
        self.nose = next(nose for nose in find_noses(briefing) if nose.unit == "ppm" or nose.estimate is not None)
        super().__init__(briefing, settings, nose=self.nose)
        self.threshold_ppm = settings.mox_floor_ppm if self.nose.unit == "ohm" else settings.gas_threshold_ppm
        model = replace(extract_settings(PlumeSensor, settings), threshold_ppm=self.threshold_ppm)
        source_terms.warm_up(model)
        rng = self.draws.generator("source terms")
        self.filter = SourceTermFilter(self.prior(briefing), model, settings.particles, rng, n_moves=settings.moves)
        self.unseen = CoverageGrid(self.flights.pilot.room, edge_m=settings.explore_step_m)

    def prior(self, briefing: Briefing) -> SourcePrior:
        """Return what is believed at the start; a granted plume narrows the rate."""
        (x_0, y_0, z_0), (x_1, y_1, z_1) = briefing.bounds.min_m, briefing.bounds.max_m
        rates = self.settings.rate_ppm_m3_s
        if briefing.plume is not None:
            rates = (briefing.plume.release_ppm_m3_s / 3.0, briefing.plume.release_ppm_m3_s * 3.0)
        return SourcePrior(
            {
                "x_m": TermPrior(kind="uniform", a=x_0, b=x_1),
                "y_m": TermPrior(kind="uniform", a=y_0, b=y_1),
                "z_m": TermPrior(kind="uniform", a=z_0, b=min(z_1, z_0 + self.settings.highest_m)),
                "rate": TermPrior(kind="log_uniform", a=rates[0], b=rates[1]),
                "speed": TermPrior(kind="log_uniform", a=0.5, b=2.0),
                "direction_rad": TermPrior(kind="normal", a=0.0, b=self.settings.direction_std_rad),
                "diffusivity_m2_s": _log_uniform(self.settings.diffusivity_m2_s),
                "lifetime_s": _log_uniform(self.settings.lifetime_s),
            }
        )

    def observe(self, observation: Observation) -> None:
        """Take a reading for each finding; take note of what was seen of the room."""
        self.unseen.note(observation.position_world_m)
        super().observe(observation)

    def reject(self, place_m: tuple[float, float]) -> None:
        """Leave the surroundings of a place out of the particles."""
        self.filter.reject(place_m, self.settings.visit_m)

    def update(self, observation: Observation, finding: Finding, weight: float) -> None:
        """Weigh the particles by a reading and its wind: the mixing ratio after gas, none in clean air."""
        speed_m_s, direction_rad = self.wind()
        ppm = max(self.nose.ppm(observation), 1.01 * self.threshold_ppm) if finding.is_hit else 0.0
        self.filter.read(finding.sensor_m, ppm, speed_m_s=speed_m_s, direction_rad=direction_rad)

    def wind(self) -> tuple[float, float]:
        """Return speed and direction of the mean wind of the last seconds: where the air goes."""
        u_m_s, v_m_s = self.recent_wind_m_s()
        return norm2(u_m_s, v_m_s), elementary.atan2(v_m_s, u_m_s)

    @property
    def p(self) -> np.ndarray:
        """The particles as a probability of each cell."""
        return self.filter.probability(self.grid)

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the mean of the particles once they have drawn together."""
        places_m, weights = self.filter.terms[:, :2], self.filter.weights()
        return by_spread(places_m, weights, limit_m=self.settings.declare_spread_m, radius_m=self.settings.visit_m)

    def next_leg(self, observation: Observation) -> Command:
        """Return the next step towards the place of most information and probability for the way."""
        here_m, mean = observation.position_world_m, self.filter.mean()
        mean_m = (mean["x_m"], mean["y_m"])
        hold_s = self.settings.hold_s if self.is_tracking(observation) else self.settings.explore_hold_s
        surge_m = self.surge_m(observation)
        if self.settings.planner == "moth" and self.is_tracking(observation) and surge_m is not None:
            return self.goals.leg(observation, surge_m, hold_s=hold_s)
        if self.settings.planner == "mean" and distance(mean_m, here_m[:2]) > 0.5 * self.settings.step_m:
            return self.goals.leg(observation, mean_m, hold_s=hold_s)
        goals_m = np.array([*self.around(here_m), mean_m, self.unseen.next_place_m(here_m, self.upwind_rad())])
        places_m = np.column_stack([goals_m, np.full(len(goals_m), self.height_m)])
        speed_m_s, direction_rad = self.wind()
        gain = self.filter.gain_bits(places_m, speed_m_s=speed_m_s, direction_rad=direction_rad)
        away_m = np.linalg.norm(self.filter.terms[:, None, :2] - goals_m[None], axis=2)
        likely = elementary.product(self.filter.weights(), away_m <= self.settings.visit_m)
        distances_m = np.linalg.norm(goals_m - here_m[:2], axis=1)
        worth = np.where(
            distances_m < 0.5 * self.settings.step_m, -1.0, (gain + likely) / (distances_m + self.settings.near_m)
        )
        x_m, y_m = goals_m[int(worth.argmax())].tolist()
        return self.goals.leg(observation, (x_m, y_m), hold_s=hold_s)

    def around(self, here_m: tuple[float, ...]) -> list[tuple[float, float]]:
        """Return candidate places in eight directions, near and far, that lie in the room and are not refused."""
        places_m = [
            (
                here_m[0] + n * self.settings.step_m * elementary.cos(a),
                here_m[1] + n * self.settings.step_m * elementary.sin(a),
            )
            for n in NEAR_AND_FAR
            for a in np.arange(N_DIRECTIONS) * (2.0 * math.pi / N_DIRECTIONS)
        ]
        return [place_m for place_m in places_m if self.goals.is_goal(place_m)]


def _log_uniform(limits: tuple[float, float]) -> TermPrior:
    return TermPrior(kind="log_uniform", a=limits[0], b=limits[1])


if __name__ == "__main__":
    run(SourceTermEstimation)
