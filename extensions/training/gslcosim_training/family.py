"""Family of cases to train in: cases drawn by their seeds, with rooms, plumes and how often each comes."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.bundled import bundled_families
from gslcosim.base.errors import ScenarioError
from gslcosim.base.problems import Problem
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.model import Environment
from gslcosim.environment.store import load_environment
from gslcosim.scenario.loader import LoadedScenario
from gslcosim_bench.cases.families import CaseFamily, FamilySpec, read_family
from gslcosim_bench.cases.models import SPLITS, Split, as_overrides
from gslcosim_bench.studies.target import collect_bundled_seeds
from gslcosim_services.fields.gas_setup import gas_seed
from gslcosim_services.fields.models.filament_gas import build_cached_plume
from gslcosim_training.stepped_run import LearningTask, get_environment_key

# Receives how many of how many are done.
Told = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class Family(CaseFamily):
    """A family of cases to train in: they are loaded, their rooms and plumes made, and hard ones drawn more often."""

    def cases(self, split: Split, n: int, *, report: Told = lambda done, total: None) -> list[LoadedScenario]:
        """Return the first n cases of a split; the same ones each time, whatever was asked for before.

        Args:
            split: `training`, `validation` or `test`.

        Raises:
            UsageError: there is no such split, or it has fewer seeds.
            ScenarioError: a case has problems.
        """
        cases: list[LoadedScenario] = []
        for i in range(len(self.seeds_of(split, n))):
            cases.append(self.case(split, i))
            report(i + 1, n)
        return cases

    def case(self, split: Split, i: int) -> LoadedScenario:
        """Return the i-th case of a split, from 0 on.

        Raises:
            ScenarioError: it has problems; the text names its seed.
        """
        seed = self.spec.seeds.of(split).first + i
        overrides = as_overrides(self.values_of(split, i))
        task = LearningTask(scenario=self.scenario, overrides=overrides, set_in=str(self.path))
        try:
            return task.loaded(seed)
        except ScenarioError as error:
            raise ScenarioError(f"{self.path}: seed {seed} of {split}: {error}") from error

    def prepare(self, cases: Sequence[LoadedScenario], *, report: Told = lambda done, total: None) -> None:
        """Make the rooms and winds of cases that were not made before, each once; `report` is called for rooms."""
        rooms = {get_environment_key(case): case for case in cases}
        for i, case in enumerate(rooms.values()):
            prepare_environment(case.scenario, scenario_dir=case.directory)
            report(i + 1, len(rooms))

    def record_tapes(self, cases: Sequence[LoadedScenario], *, report: Told = lambda done, total: None) -> None:
        """Record the gas of cases that have it on tape and were not recorded before; their rooms are there."""
        taped = [case for case in cases if case.scenario.gas.tape]
        environments: dict[str, Environment] = {}
        for i, case in enumerate(taped):
            key = get_environment_key(case)
            if key not in environments:
                folder = prepare_environment(case.scenario, scenario_dir=case.directory)
                environments[key] = load_environment(folder)
            build_cached_plume(case.scenario, environments[key]).reset(gas_seed(case.scenario, case.scenario.seed))
            report(i + 1, len(taped))

    def weights(self, costs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the probabilities of cases in training, (n,).

        p_i = w_i / sum w, w_i = floor + (1 - floor) (c_i / max c)^power

        Args:
            costs: Mean cost of each case so far, (n,), not negative; NaN where it has not been flown.

        Source:
            Doping as in Sniffy Bug (Duisterhof et al. 2021), whose training draws hard rooms more often; the formula
            is ours.
        """
        doping = self.spec.doping
        known = costs[~np.isnan(costs)]
        most = float(known.max()) if len(known) else 0.0
        if doping is None or most <= 0.0:
            return np.full(len(costs), 1.0 / len(costs))
        shares = np.where(np.isnan(costs), 1.0, np.clip(costs, 0.0, most) / most)
        weights = doping.floor + (1.0 - doping.floor) * shares**doping.power
        return weights / weights.sum()


def load_family(source: str | Path) -> Family:
    """Read and check a family.

    Raises:
        ScenarioError: there is no such family, or it has problems: all of them in one error.
    """
    family = read_family(source, check=_taken_seeds)
    return Family(spec=family.spec, path=family.path, directory=family.directory)


def _taken_seeds(spec: FamilySpec) -> Iterator[Problem]:
    for split in SPLITS:
        seeds = spec.seeds.of(split)
        taken = sorted(seed for seed in collect_bundled_seeds() if seed in seeds)
        if taken:
            yield Problem(
                where=f"seeds.{split}",
                expected="seeds that no bundled suite flies: suites test",
                found=f"{seeds.first} to {seeds.last}, with {taken[0]} of a suite among them",
                remedy="Begin elsewhere.",
            )


__all__ = ["Family", "bundled_families", "load_family"]
