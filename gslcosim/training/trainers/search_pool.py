"""Cases of a family with the searches that fly them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.store import load_environment
from gslcosim.errors import UsageError
from gslcosim.generation import prepare_environment
from gslcosim.scenario.loading import LoadedScenario
from gslcosim.search.learned.policies.policy import ActionSettings
from gslcosim.training.batch import BatchSearchEnv


class SearchPool:
    """Prepared cases and a batch of searches in them.

    Args:
        cases: At least one; all with one agent and the same sensors.
        n_envs: How many searches fly at once.
        action: What their actions mean.
        discount: Of the shaping of rewards.

    Raises:
        UsageError: a case cannot be batched.
    """

    def __init__(
        self, cases: Sequence[LoadedScenario], n_envs: int, *, action: ActionSettings, discount: float = 0.99
    ) -> None:
        self.envs = BatchSearchEnv(
            cases, n_envs, action=action.kind, step_m=action.step_m, speed_m_s=action.speed_m_s, hold_s=action.hold_s,
            discount=discount,
        )  # fmt: skip
        self.n_cases = len(cases)
        self.observation_names: tuple[str, ...] = self.envs.observation_names
        self._limits_s = np.array([case.scenario.referee.stop.time_limit_s for case in cases])
        self._diagonals_m = np.array([_diagonal_m(case) for case in cases])
        vehicle = cases[0].scenario.agents[0].vehicle
        self.step_s = vehicle.hold_s if action.hold_s is None else action.hold_s

    def places_of(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Return where some observations stand among all.

        Raises:
            UsageError: a name is none of them.
        """
        if strange := [name for name in names if name not in self.observation_names]:
            raise UsageError(
                f"trainer.observations: expected names among {', '.join(self.observation_names)}, was "
                f"{', '.join(strange)}."
            )
        return np.array([self.observation_names.index(name) for name in names], np.int64)

    def scales(self, cases: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the time limits [s] and the rooms' diagonals [m] of cases."""
        return self._limits_s[cases], self._diagonals_m[cases]

    def close(self) -> None:
        """End the searches."""
        self.envs.close()


def _diagonal_m(case: LoadedScenario) -> float:
    grid: Any = load_environment(prepare_environment(case.scenario, scenario_dir=case.directory)).grid
    return math.dist(grid.origin_m, grid.max_m)
