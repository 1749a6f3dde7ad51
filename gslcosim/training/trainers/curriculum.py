"""Curriculum of cases: what each has cost so far, and how often it comes by that: hard ones more often."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.training.trainers.policy_costs import compute_costs

# From mean costs of cases, NaN where not flown, to how often each comes; see `Family.weights`.
Weights = Callable[[NDArray[np.float64]], NDArray[np.float64]]
# Of a case's mean cost: the newest search counts a half.
_NEWEST = 0.5
_NEEDED = ("case", "success", "time_s", "distance_to_source_m")


class Curriculum:
    """Mean costs of cases, of which the newest search counts a half; NaN where a case has not been flown.

    Args:
        weights: From mean costs to how often each case comes.
        time_limits_s: Of the cases, (n_cases,) [s].
        diagonals_m: Of the cases' rooms, (n_cases,) [m].
    """

    def __init__(
        self, weights: Weights, *, time_limits_s: NDArray[np.float64], diagonals_m: NDArray[np.float64]
    ) -> None:
        self._weights, self._limits_s, self._diagonals_m = weights, time_limits_s, diagonals_m
        self.costs = np.full(len(time_limits_s), np.nan)

    @property
    def shares(self) -> NDArray[np.float64]:
        """Probabilities with which the cases come, (n_cases,)."""
        return self._weights(self.costs)

    def count(self, infos: Mapping[str, Any], ends: NDArray[np.bool_]) -> None:
        """Remember the searches that have ended, in their order.

        Args:
            infos: What a batch returns of a step, or its `final_info` where searches begin again at once.
            ends: Which searches have ended.

        Raises:
            UsageError: the environment does not say which case a search flew, or how it went.
        """
        ended = infos.get("final_info", infos)
        if missing := [name for name in _NEEDED if name not in ended]:
            raise UsageError(
                f"doping: expected environments that tell {', '.join(_NEEDED)} of searches that end, was without "
                f"{', '.join(missing)}. Take a BatchSearchEnv, or train without doping."
            )
        cases, success, time_s, distance_m = (np.asarray(ended[name])[ends] for name in _NEEDED)
        cases = cases.astype(np.int64)
        costs = compute_costs(
            success.astype(bool), time_s / self._limits_s[cases], distance_m / self._diagonals_m[cases]
        )
        for case, cost in zip(cases.tolist(), costs.tolist(), strict=True):
            before = self.costs[case]
            self.costs[case] = cost if np.isnan(before) else (1 - _NEWEST) * before + _NEWEST * cost
