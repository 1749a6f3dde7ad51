"""Family files to cases: read, checked, and drawn by their seeds."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.benchmark.tuning.deriving import seeds_of_bundled_suites
from gslcosim.environment.model import Environment
from gslcosim.environment.store import load_environment
from gslcosim.errors import ScenarioError, UsageError
from gslcosim.fields.gas_setup import gas_seed
from gslcosim.fields.models.filament_gas import taped_plume
from gslcosim.generation import prepare_environment
from gslcosim.rng import stream
from gslcosim.safe_files import read_regular_file
from gslcosim.scenario.bundled import bundled_folder
from gslcosim.scenario.loading import LoadedScenario, find_scenario
from gslcosim.scenario.problems import Problem
from gslcosim.scenario.spec_files import read_spec_file
from gslcosim.scenario.suggestions import did_you_mean
from gslcosim.training.families.family_models import SPLITS, Axis, FamilySpec, Split
from gslcosim.training.learning_task import LearningTask, room_key

FAMILY_FILE = "family.yaml"
_DIGITS = 6

# Is told how many of how many are done.
Told = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class Family:
    """A valid family and where it came from; `directory` is where its relative paths start."""

    spec: FamilySpec
    path: Path
    directory: Path

    @property
    def name(self) -> str:
        """The family's name."""
        return self.spec.name

    @cached_property
    def scenario(self) -> Path:
        """The file of the scenario that varies."""
        beside = self.directory / self.spec.scenario
        try:
            return find_scenario(beside if beside.is_file() else self.spec.scenario)
        except ScenarioError as error:
            raise ScenarioError(f"{self.path}: scenario: {error}") from error

    @property
    def identity(self) -> str:
        """A hash of all that decides the cases: the family as resolved, and its scenario."""
        text = f"{self.spec.model_dump_json()}\n{read_regular_file(self.scenario).decode('utf-8-sig')}"
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    def cases(self, split: Split, n: int, *, report: Told = lambda done, total: None) -> list[LoadedScenario]:
        """Return the first n cases of a split; the same ones each time, whatever was asked for before.

        Args:
            split: `training`, `validation` or `test`.
            n: How many.
            report: Is told how many are done.

        Raises:
            UsageError: there is no such split, or it has fewer seeds.
            ScenarioError: a case has problems.
        """
        if split not in SPLITS:
            raise UsageError(f"{self.name}: expected one of the splits {', '.join(SPLITS)}, was {split!r}.")
        seeds = self.spec.seeds.of(split)
        if not 1 <= n <= seeds.count:
            raise UsageError(
                f"{self.name}: expected 1 to {seeds.count} cases for {split}, as many as seeds.{split} has, was {n}."
            )
        cases: list[LoadedScenario] = []
        for i in range(n):
            cases.append(self.case(split, i))
            report(i + 1, n)
        return cases

    def case(self, split: Split, i: int) -> LoadedScenario:
        """Return the i-th case of a split, from 0 on.

        Raises:
            ScenarioError: it has problems; the text names its seed.
        """
        seed = self.spec.seeds.of(split).first + i
        overrides = tuple(f"{path}={json.dumps(value)}" for path, value in self.values_of(split, i).items())
        task = LearningTask(scenario=self.scenario, overrides=overrides, set_in=str(self.path))
        try:
            return task.loaded(seed)
        except ScenarioError as error:
            raise ScenarioError(f"{self.path}: seed {seed} of {split}: {error}") from error

    def values_of(self, split: Split, i: int) -> dict[str, Any]:
        """Return the values that the i-th case of a split sets, by their paths."""
        seeds = self.spec.seeds.of(split)
        values = dict(self.spec.set)
        for axis in self.spec.vary:
            values |= _drawn(axis, seed=seeds.first + i, first=seeds.first)
        return values

    def prepare(self, cases: Sequence[LoadedScenario], *, report: Told = lambda done, total: None) -> None:
        """Make the rooms and winds of cases that were not made before, each once; `report` is told of rooms."""
        rooms = {room_key(case): case for case in cases}
        for i, case in enumerate(rooms.values()):
            prepare_environment(case.scenario, scenario_dir=case.directory)
            report(i + 1, len(rooms))

    def record_tapes(self, cases: Sequence[LoadedScenario], *, report: Told = lambda done, total: None) -> None:
        """Record the gas of cases that have it on tape and were not recorded before; their rooms are there."""
        taped = [case for case in cases if case.scenario.gas.tape]
        environments: dict[str, Environment] = {}
        for i, case in enumerate(taped):
            key = room_key(case)
            if key not in environments:
                folder = prepare_environment(case.scenario, scenario_dir=case.directory)
                environments[key] = load_environment(folder)
            taped_plume(case.scenario, environments[key]).reset(gas_seed(case.scenario, case.scenario.seed))
            report(i + 1, len(taped))

    def weights(self, costs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how often cases come in training, as probabilities, (n,).

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


def bundled_families() -> dict[str, Path]:
    """Return the bundled family files by name."""
    return {path.parent.name: path for path in sorted(bundled_folder("families").glob(f"*/{FAMILY_FILE}"))}


def load_family(source: str | Path) -> Family:
    """Read and check a family.

    Args:
        source: A file, or the name of a bundled family.

    Raises:
        ScenarioError: there is no such family, or it has problems: all of them in one error.
    """
    path = _find(source)
    shown_path = str(source) if Path(source).is_file() else str(path)
    spec = read_spec_file(path, FamilySpec, shown_path=shown_path, keys="scenario and seeds", check=_taken_seeds)
    return Family(spec=spec, path=path, directory=path.parent.resolve())


def _find(source: str | Path) -> Path:
    path, bundled = Path(source), bundled_families()
    if path.is_file():
        return path
    if str(source) in bundled:
        return bundled[str(source)]
    raise ScenarioError(
        f"{source}: expected a family file or a bundled family ({', '.join(bundled)}), found neither. "
        f"{did_you_mean(str(source), list(bundled))}".rstrip()
    )


def _taken_seeds(spec: FamilySpec) -> Iterator[Problem]:
    for split in SPLITS:
        seeds = spec.seeds.of(split)
        taken = sorted(seed for seed in seeds_of_bundled_suites() if seed in seeds)
        if taken:
            yield Problem(
                path=f"seeds.{split}",
                expected="seeds that no bundled suite flies: suites test",
                found=f"{seeds.first} to {seeds.last}, with {taken[0]} of a suite among them",
                remedy="Begin elsewhere.",
            )


def _drawn(axis: Axis, *, seed: int, first: int) -> Iterator[tuple[str, Any]]:
    together = "+".join(path for path, drawn in axis.items() if drawn.values is not None)
    for path, drawn in axis.items():
        if drawn.values is not None:
            yield path, drawn.values[int(stream(seed, f"family.{together}").integers(len(drawn.values)))]
        elif drawn.rooms is not None:
            yield path, first + int(stream(seed, f"family.{path}").integers(drawn.rooms))
        elif drawn.between is not None:
            yield path, _between(*drawn.between, stream(seed, f"family.{path}").random(), is_log=drawn.log)


def _between(low: float, high: float, share: float, *, is_log: bool) -> float:
    value = low * (high / low) ** share if is_log else low + (high - low) * share
    return float(f"{value:.{_DIGITS}g}")
