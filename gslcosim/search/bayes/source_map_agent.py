"""Agents that keep a map of where the source may be, and update it by each finding."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Agent, Briefing, Command, Observation
from gslcosim.search.bayes import puff_tracing
from gslcosim.search.bayes.belief_search import BeliefSearch, BeliefSearchSettings
from gslcosim.search.bayes.puff_tracing import PuffModel, SourceMap, displacements_m, footprint
from gslcosim.search.method_settings import load_settings
from gslcosim.search.senses.hit_detection import Finding


class SourceBeliefAgent(Agent):
    """An agent whose belief is a `SourceMap`: a subclass says what a finding teaches and where it goes next.

    A method names its `program` (`__file__`, with its card beside it).

    Its settings: those of `BeliefSearchSettings`, floor_frac and visit_m.
    """

    program: ClassVar[str]

    def __init__(self, briefing: Briefing) -> None:
        """Begin with an even belief over free cells, and compile what runs in flight.

        Raises:
            MethodError: the agent lacks something that its card asks for, or a parameter is wrong.
        """
        settings = self.settings = load_settings(briefing, self.program)
        puff_tracing.warm_up()
        self.search = BeliefSearch(briefing, BeliefSearchSettings.of(settings))
        self.map = SourceMap(self.search.grid, free=self.search.free, floor_frac=settings.floor_frac)

    def observe(self, observation: Observation) -> None:
        """Update the map by what was found, on the way or at a stop."""
        if (rejected_m := self.search.take_rejected()) is not None:
            self.map.reject(rejected_m, self.settings.visit_m)
        finding = self.search.observe(observation)
        if finding is not None:
            self.learn(finding)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg, or a declaration."""
        self.observe(observation)
        return self.answer(observation, self.map.probability())

    def answer(self, observation: Observation, p: NDArray[np.float64]) -> Command:
        """Return the next leg by a belief, or the declaration once it has drawn together."""
        return self.search.answer(observation, p, self.search.drawn_together(p), lambda: self.next_leg(observation, p))

    @abstractmethod
    def learn(self, finding: Finding) -> None:
        """Update the map by a finding."""

    @abstractmethod
    def next_leg(self, observation: Observation, p: NDArray[np.float64]) -> Command:
        """Return the next leg by a belief."""


class PuffTracingAgent(SourceBeliefAgent):
    """Traces each finding back with the wind; goes upwind after gas, else where that tells most.

    Its settings: those of a `SourceBeliefAgent`, wind_step_s, window_s, initial_sigma_m, spread_m_sqrt_s,
    detection_probability and sensed_m2.
    """

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        settings = self.settings
        self.model = PuffModel(
            step_s=settings.wind_step_s,
            window_s=settings.window_s,
            initial_sigma_m=settings.initial_sigma_m,
            spread_m_sqrt_s=settings.spread_m_sqrt_s,
            detection_probability=settings.detection_probability,
            sensed_m2=settings.sensed_m2,
        )

    def learn(self, finding: Finding) -> None:
        """Trace the finding back to where its puff may have come from."""
        travelled_m = displacements_m(self.search.winds, self.model, finding.sensor_m, field=self.search.field)
        puff_tracing.update(self.map, self.model, finding.sensor_m, travelled_m, is_hit=finding.is_hit)

    def next_leg(self, observation: Observation, p: NDArray[np.float64]) -> Command:
        """Return a leg upwind soon after gas, else one to where a finding tells most."""
        return self.search.next_leg(observation, p, self.chance(observation))

    def chance(self, observation: Observation) -> NDArray[np.float64]:
        """Return the chance to detect gas of a source at each offset, in the wind of late."""
        plan_grid = self.search.plan_grid
        travelled_m = displacements_m(self.search.winds, self.model, observation.position_world_m)
        return footprint(self.model, travelled_m, plan_grid.cell_m, plan_grid.shape)
