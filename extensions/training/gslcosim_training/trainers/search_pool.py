"""Pool of searches over the cases of a family."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.scenario.loader import LoadedScenario
from gslcosim_search.learned.policy import ActionSettings
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.trainers.trainer import Curriculum, Weights


class SearchPool:
    """Prepared cases and a batch of searches in them.

    Args:
        cases: At least one; all with one agent and the same sensors.
        n_envs: How many searches fly at once.
        action: What their actions mean.
        discount: Of the shaping of rewards.
        flying: As for `BatchSearchEnv`.
        has_wind_frame: As for `BatchSearchEnv`.
        report: Receives how many of how many cases are prepared.
    """

    def __init__(
        self,
        cases: Sequence[LoadedScenario],
        n_envs: int,
        *,
        action: ActionSettings,
        discount: float = 0.99,
        flying: str = "exact",
        has_wind_frame: bool = False,
        report: Callable[[int, int], None] | None = None,
    ) -> None:
        self.envs = BatchSearchEnv(
            cases, n_envs, action=action.kind, step_m=action.step_m, speed_m_s=action.speed_m_s, hold_s=action.hold_s,
            discount=discount, frame=action.frame, shield_m=action.shield_m, has_wind_frame=has_wind_frame,
            flying=flying, report=report,
        )  # fmt: skip
        self.n_cases = len(cases)
        self.observation_names: tuple[str, ...] = self.envs.observation_names
        self._limits_s = np.array([case.scenario.referee.stop.time_limit_s for case in cases])
        self._diagonals_m = self.envs.diagonals_m
        vehicle = cases[0].scenario.agents[0].vehicle
        self.step_s = vehicle.hold_s if action.hold_s is None else action.hold_s

    def places_of(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Return the indices of some observations among all."""
        if strange := [name for name in names if name not in self.observation_names]:
            raise UsageError(
                f"trainer.observations: expected names among {', '.join(self.observation_names)}, was "
                f"{', '.join(strange)}."
            )
        return np.array([self.observation_names.index(name) for name in names], np.int64)

    def scales(self, cases: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the time limits [s] and the rooms' diagonals [m] of cases."""
        return self._limits_s[cases], self._diagonals_m[cases]

    def costs(self, weights: Weights) -> Curriculum:
        """Return the curriculum: it keeps the costs of cases, and `weights` gives their probabilities."""
        return Curriculum(weights, time_limits_s=self._limits_s, diagonals_m=self._diagonals_m)

    def close(self) -> None:
        """End the searches."""
        self.envs.close()
