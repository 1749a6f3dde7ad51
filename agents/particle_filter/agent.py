"""Particle filter: places where the source may be, born upwind of gas and weighed by what is found.

After Li, Meng, Wang and Zeng 2011. README.md beside this file has the rules, method.yaml the parameters.
"""

from collections import deque

import numpy as np

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.bayes import particle_filter
from gslcosim_search.bayes.belief_search import BeliefAgent
from gslcosim_search.bayes.particle_filter import (
    ParticleCloud,
    newborn_area_m2,
    puff_variances_m2,
    wind_spread_m_sqrt_s,
)
from gslcosim_search.bayes.puff_tracing import partial_sums_m
from gslcosim_search.elementary import distance
from gslcosim_search.motion.coverage import CoverageGrid
from gslcosim_search.motion.declaration import Estimate, by_spread
from gslcosim_search.reactive.spirals import ArchimedeanSpiral, random_side
from gslcosim_search.senses.hit_detection import Finding


class ParticleFilter(BeliefAgent):
    """Surges upwind in gas and spirals when it is lost, or goes to the mean; declares when particles draw together."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        settings = self.settings
        particle_filter.warm_up()
        self.cloud = ParticleCloud(settings.particles, briefing.bounds, self.draws.generator("particles"))
        self.sensed_m2 = settings.sensed_m2 or newborn_area_m2(settings.first_sigma_m)
        self.means_m: deque[tuple[float, float]] = deque(maxlen=settings.estimates)
        self.unseen = CoverageGrid(self.flights.pilot.room, edge_m=settings.explore_step_m)
        self.spiral: ArchimedeanSpiral | None = None
        self.centre_m = (0.0, 0.0)

    def observe(self, observation: Observation) -> None:
        """Weigh the particles by what was found; take note of what was seen of the room."""
        self.unseen.note(observation.position_world_m)
        super().observe(observation)

    def reject(self, place_m: tuple[float, float]) -> None:
        """Begin again without particles."""
        self.cloud.clear()

    def update(self, observation: Observation, finding: Finding, weight: float) -> None:
        """Bear, weigh and resample; the first gas bears particles."""
        if not (finding.is_hit or self.cloud.is_born):
            return
        settings, winds_m_s = self.settings, self.winds.window_m_s()
        travelled_m = partial_sums_m(winds_m_s, settings.wind_step_s)
        spread = wind_spread_m_sqrt_s(winds_m_s, settings.wind_step_s, settings.spread_m_sqrt_s)
        variance_m2 = puff_variances_m2(len(travelled_m), settings.wind_step_s, spread, settings.first_sigma_m)
        if finding.is_hit:
            self.cloud.bear(finding.sensor_m, travelled_m, variance_m2, share=settings.birth_share)
        particle_filter.update_particles(
            self.cloud,
            finding.sensor_m,
            travelled_m,
            variance_m2,
            is_hit=finding.is_hit,
            detection_probability=settings.detection_probability,
            sensed_m2=self.sensed_m2,
            floor_frac=settings.floor_frac,
            weight=weight,
        )
        if self.cloud.n_effective() < settings.resample_below * settings.particles:
            if settings.resampling == "copies":
                self.cloud.resample_by_copies(jitter_m=settings.copies_jitter_m)
            else:
                self.cloud.resample()
        self.means_m.append(self.cloud.mean_m())

    @property
    def p(self) -> np.ndarray:
        """The particles as a probability of each cell; even before any are born."""
        grid = self.grid
        return self.cloud.probability(grid) if self.cloud.is_born else np.full(grid.shape, 1.0 / grid.n_cells)

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the mean of the last estimates once the particles have drawn together."""
        if not self.cloud.is_born:
            return None
        spread = by_spread(
            self.cloud.places_m, self.cloud.weights(), limit_m=self.settings.declare_spread_m, radius_m=1.0
        )
        if spread is None or len(self.means_m) < self.settings.estimates:
            return None
        mean_m = np.mean(np.array(self.means_m), axis=0)
        return Estimate(position_m=(float(mean_m[0]), float(mean_m[1])), confidence=spread.confidence)

    def next_leg(self, observation: Observation) -> Command:
        """Return a leg upwind soon after gas, then one of a spiral; without particles one to a place not seen yet."""
        here_m = observation.position_world_m
        surge_m = self.surge_m(observation)
        if (
            self.is_tracking(observation)
            and surge_m is not None
            and self.flights.pilot.is_worth_it(observation, surge_m)
        ):
            self.spiral = None
            return self.flights.pilot.leg(observation, surge_m, hold_s=self.settings.hold_s)
        if not self.cloud.is_born:
            return self.goals.leg(observation, self.unseen.next_place_m(here_m, self.upwind_rad()), hold_s=0.0)
        if self.settings.motion == "mean" and distance(self.cloud.mean_m(), here_m[:2]) > self.settings.step_m:
            self.spiral = None
            return self.goals.leg(observation, self.cloud.mean_m(), hold_s=self.settings.hold_s)
        return self.spiral_leg(observation)

    def spiral_leg(self, observation: Observation) -> Command:
        """Return the next arc of a spiral round the place where the plume was lost; a wide one begins again."""
        offset_m = None if self.spiral is None else self.spiral.next_offset_m()
        if offset_m is None:
            x_m, y_m, _ = observation.position_world_m
            self.centre_m = (x_m, y_m) if self.spiral is None else self.cloud.mean_m()
            self.spiral = self.new_spiral()
            offset_m = self.spiral.next_offset_m() or (0.0, 0.0)
        target_m = (self.centre_m[0] + offset_m[0], self.centre_m[1] + offset_m[1])
        return self.flights.pilot.leg(observation, target_m, hold_s=self.settings.explore_hold_s)

    def new_spiral(self) -> ArchimedeanSpiral:
        """Return a spiral that leaves its centre in a random direction, to a random side."""
        return ArchimedeanSpiral(
            gap_m=self.settings.spiral_gap_m,
            arc_m=self.settings.step_m,
            start_rad=self.draws.angle_rad(),
            side=random_side(self.draws),
            reach_m=self.settings.spiral_most_m,
        )


if __name__ == "__main__":
    run(ParticleFilter)
