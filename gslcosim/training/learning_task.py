"""Scenario as a task for learning, loaded again with each seed."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gslcosim.environment.build.position_checks import find_position_problems
from gslcosim.environment.build.random_positions import draw_positions
from gslcosim.scenario import load_scenario
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.overrides import SET_OPTION


@dataclass(frozen=True, kw_only=True)
class LearningTask:
    """A scenario with values replaced; each seed draws its random places, gas and noise again.

    Problems with values are said to stand in `set_in`.
    """

    scenario: str | Path
    overrides: Sequence[str] = field(default=())
    set_in: str = SET_OPTION

    def loaded(self, seed: int) -> LoadedScenario:
        """Return the scenario with a seed.

        Raises:
            ScenarioError: it has problems.
        """
        return load_scenario(
            self.scenario,
            overrides=self.overrides,
            seed=seed,
            set_in=self.set_in,
            checks=(lambda scenario, directory: find_position_problems(scenario, scenario_dir=directory),),
            placer=draw_positions,
        )


def get_environment_key(loaded: LoadedScenario) -> str:
    """Return what scenarios have in common whose room and wind are the same."""
    scenario = loaded.scenario
    return f"{loaded.directory}\n{scenario.environment.model_dump_json()}\n{scenario.wind.model_dump_json()}"
