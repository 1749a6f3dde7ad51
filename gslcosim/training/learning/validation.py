"""Validation of a policy on cases it was not trained in, and recorded runs of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.bench.cases.models import EntrySpec
from gslcosim.runtime.status import RunResult
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim.search.learned.policies.policy import Policy
from gslcosim.training.families.case_runs import CaseRun, compute_rows
from gslcosim.training.trainers.evolved_method import EvolvedParameters, compute_cost
from gslcosim.training.trainers.policy_costs import run_searches
from gslcosim.training.trainers.search_pool import SearchPool

LEARNED = "learned"


class PolicyValidation:
    """Flies a policy in the cases of validation, each with its own seed: in a batch, or a method in this process."""

    def __init__(self, family: str, cases: Sequence[LoadedScenario], pool: SearchPool | None) -> None:
        self._family, self._cases, self._pool = family, tuple(cases), pool
        self._seeds = np.array([case.scenario.seed for case in cases], np.int64)

    def figures(self, policy: Any) -> dict[str, float]:
        """Return mean cost and success, as `validation_cost` and `validation_success`."""
        if isinstance(policy, EvolvedParameters):
            rows = compute_rows(self._family, self._cases, policy.entry)
            costs = np.array([compute_cost(row) for row in rows])
            success = np.array([row["success"] for row in rows])
        else:
            assert self._pool is not None, "policies fly in batches"
            numbers = np.arange(len(self._cases))
            flown = run_searches(
                self._pool.envs, [policy], numbers, self._seeds, self._pool.places_of(policy.observation_names)
            )
            costs, success = flown.costs(*self._pool.scales(numbers)), flown.success
        return {"validation_cost": float(costs.mean()), "validation_success": float(success.mean())}


def build_entry(policy: Any, policy_file: Path) -> EntrySpec:
    """Return how a suite enters what was learned: a method with its parameters, or the agent `learned` with a file."""
    if isinstance(policy, EvolvedParameters):
        return policy.entry
    assert isinstance(policy, Policy), "trainers have policies or parameters"
    return EntrySpec(name=LEARNED, start=StartSpec(python=LEARNED), parameters={"policy": str(policy_file.resolve())})


def record_runs(family: str, cases: Sequence[LoadedScenario], entry: EntrySpec, runs_dir: Path) -> list[RunResult]:
    """Fly cases with recordings, each into a run's folder of its own, for `gslcosim view`."""
    return [CaseRun(family=family, case=case, entry=entry).record(runs_dir) for case in cases]
