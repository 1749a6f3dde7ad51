"""Source map: a probability for each cell of the floor, from puffs of gas that are traced back with the wind.

After Pang and Farrell 2006. README.md beside this file has the rules, method.yaml the parameters.
"""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.bayes import puff_tracing
from gslcosim.search.bayes.belief_search import BeliefSearch, BeliefSearchSettings
from gslcosim.search.bayes.puff_tracing import PuffModel, SourceMap, displacements_m, footprint
from gslcosim.search.method_settings import load_settings


class SourceMapAgent(Agent):
    """Traces each finding back with the wind; goes upwind after gas, else where that tells most."""

    def __init__(self, briefing: Briefing) -> None:
        settings = self.settings = load_settings(briefing, __file__)
        puff_tracing.warm_up()
        self.search = BeliefSearch(briefing, BeliefSearchSettings.of(settings))
        self.model = PuffModel(
            step_s=settings.wind_step_s,
            window_s=settings.window_s,
            initial_sigma_m=settings.initial_sigma_m,
            spread_m_sqrt_s=settings.spread_m_sqrt_s,
            detection_probability=settings.detection_probability,
            sensed_m2=settings.sensed_m2,
        )
        self.map = SourceMap(self.search.grid, free=self.search.free, floor_frac=settings.floor_frac)

    def observe(self, observation: Observation) -> None:
        """Update the map by what was found, on the way or at a stop."""
        if (rejected_m := self.search.take_rejected()) is not None:
            self.map.reject(rejected_m, self.settings.visit_m)
        finding = self.search.observe(observation)
        if finding is not None:
            travelled_m = displacements_m(self.search.winds, self.model, finding.sensor_m, field=self.search.field)
            puff_tracing.update(self.map, self.model, finding.sensor_m, travelled_m, is_hit=finding.is_hit)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg, or a declaration."""
        self.observe(observation)
        p = self.map.probability()
        return self.search.answer(
            observation,
            p,
            self.search.drawn_together(p),
            lambda: self.search.next_leg(observation, p, self.chance(observation)),
        )

    def chance(self, observation: Observation) -> puff_tracing.Array:
        """Return the chance to detect gas of a source at each offset, in the wind of late."""
        plan_grid = self.search.plan_grid
        travelled_m = displacements_m(self.search.winds, self.model, observation.position_world_m)
        return footprint(self.model, travelled_m, plan_grid.cell_m, plan_grid.shape)


if __name__ == "__main__":
    run(SourceMapAgent)
