"""Costs of policies in a batch: one search for each policy and case, all at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.learned.policies.policy import Policy


@dataclass(frozen=True, kw_only=True)
class SearchOutcomes:
    """Outcomes of searches: success, time [s] and last distance to the source [m] of each."""

    success: NDArray[np.bool_]
    time_s: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    n_steps: int

    def costs(self, time_limits_s: NDArray[np.float64], diagonals_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what each search cost, between 0 and 2; see `compute_costs`."""
        return compute_costs(self.success, self.time_s / time_limits_s, self.distance_m / diagonals_m)


def compute_costs(
    success: NDArray[np.bool_], shares_of_time: NDArray[np.float64], shares_of_room: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what searches cost, between 0 and 2.

    cost = t / limit upon success, else 1 + distance / diagonal, so that who fails nearer fails less.

    Args:
        success: Of each search, (n,).
        shares_of_time: Times over time limits, (n,).
        shares_of_room: Last distances to the source over diagonals of rooms, (n,).
    """
    return np.where(success, shares_of_time, 1.0 + np.minimum(shares_of_room, 1.0))


def run_searches(
    envs: Any, policies: Sequence[Policy], cases: NDArray[np.int64], seeds: NDArray[np.int64], places: NDArray[np.int64]
) -> SearchOutcomes:
    """Fly every policy in every case, each once, and return how the searches ended, policy by policy.

    Args:
        envs: A `BatchSearchEnv` with a search for each policy and case.
        policies: All with the same observations.
        cases: Which cases, (k,).
        seeds: Of gas and noise, (k,): the same for all policies.
        places: Where the policies' observations stand in those of `envs`.
    """
    n_policies, k = len(policies), len(cases)
    n = n_policies * k
    chosen = {"cases": np.tile(cases, n_policies), "seeds": np.tile(seeds, n_policies)}
    observed, infos = envs.reset(seed=0, options=chosen)
    parts = [slice(i * k, (i + 1) * k) for i in range(n_policies)]
    memories = [policy.memory(k) for policy in policies]
    is_over, success = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    time_s, distance_m = np.zeros(n), np.array(infos["distance_to_source_m"], np.float64)
    n_steps = 0
    while not is_over.all():
        seen, actions = np.ascontiguousarray(observed[:, places]), []
        for i, policy in enumerate(policies):
            chosen_now, memories[i] = policy.act(seen[parts[i]], memories[i])
            actions.append(chosen_now)
        n_steps += int((~is_over).sum())
        observed, _, terminated, truncated, infos = envs.step(np.concatenate(actions))
        ends = (np.asarray(terminated) | np.asarray(truncated)) & ~is_over
        if ends.any():
            success[ends] = np.asarray(infos["success"])[ends]
            time_s[ends] = np.asarray(infos["time_s"])[ends]
            distance_m[ends] = np.asarray(infos["distance_to_source_m"])[ends]
            is_over |= ends
    return SearchOutcomes(success=success, time_s=time_s, distance_m=distance_m, n_steps=n_steps)
