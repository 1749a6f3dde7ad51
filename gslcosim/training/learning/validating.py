"""How good a policy is on cases it was not trained in, and flights of it to look at."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.benchmark.suite.models import EntrySpec
from gslcosim.runtime.status import FlightResult
from gslcosim.scenario.loading import LoadedScenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim.search.learned.policies.policy import Policy
from gslcosim.training.families.flying import CaseFlight, rows_of
from gslcosim.training.trainers.method_parameters import MethodParameters, cost_of
from gslcosim.training.trainers.policy_searches import search
from gslcosim.training.trainers.search_pool import SearchPool

LEARNED = "learned"


class PolicyValidation:
    """Flies a policy in the cases of validation, each with its own seed: in a batch, or a method in this process."""

    def __init__(self, family: str, cases: Sequence[LoadedScenario], pool: SearchPool | None) -> None:
        self._family, self._cases, self._pool = family, tuple(cases), pool
        self._seeds = np.array([case.scenario.seed for case in cases], np.int64)

    def figures(self, policy: Any) -> dict[str, float]:
        """Return mean cost and success, as `validation_cost` and `validation_success`."""
        if isinstance(policy, MethodParameters):
            rows = rows_of(self._family, self._cases, policy.entry)
            costs = np.array([cost_of(row) for row in rows])
            success = np.array([row["success"] for row in rows])
        else:
            assert self._pool is not None, "policies fly in batches"
            numbers = np.arange(len(self._cases))
            flown = search(
                self._pool.envs, [policy], numbers, self._seeds, self._pool.places_of(policy.observation_names)
            )
            costs, success = flown.costs(*self._pool.scales(numbers)), flown.success
        return {"validation_cost": float(costs.mean()), "validation_success": float(success.mean())}


def entry_of(policy: Any, policy_file: Path) -> EntrySpec:
    """Return how a suite enters what was learned: a method with its parameters, or the agent `learned` with a file."""
    if isinstance(policy, MethodParameters):
        return policy.entry
    assert isinstance(policy, Policy), "trainers have policies or parameters"
    return EntrySpec(name=LEARNED, start=StartSpec(python=LEARNED), parameters={"policy": str(policy_file.resolve())})


def record_flights(
    family: str, cases: Sequence[LoadedScenario], entry: EntrySpec, runs_dir: Path
) -> list[FlightResult]:
    """Fly cases with recordings, each into a run's folder of its own, for `gslcosim view`."""
    return [CaseFlight(family=family, case=case, entry=entry).record(runs_dir) for case in cases]
