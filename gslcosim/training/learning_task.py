"""A scenario as a task for learning, loaded again with each seed."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gslcosim.environment.of_scenario.places import problems_of_places
from gslcosim.environment.of_scenario.random_places import draw_places
from gslcosim.scenario import load_scenario
from gslcosim.scenario.loading import LoadedScenario


@dataclass(frozen=True, kw_only=True)
class LearningTask:
    """A scenario with values replaced; each seed draws its random places, gas and noise anew."""

    scenario: str | Path
    overrides: Sequence[str] = field(default=())

    def loaded(self, seed: int) -> LoadedScenario:
        """Return the scenario with a seed.

        Raises:
            ScenarioError: it has problems.
        """
        return load_scenario(
            self.scenario,
            overrides=self.overrides,
            seed=seed,
            checks=(lambda scenario, directory: problems_of_places(scenario, scenario_dir=directory),),
            placer=draw_places,
        )
