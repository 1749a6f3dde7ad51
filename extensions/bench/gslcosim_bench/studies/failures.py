"""Failure finder: a search for cases in which a method fails and the oracle does not, within a budget of runs."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.base.rng import stream
from gslcosim.environment.positions import draw_positions, find_position_problems
from gslcosim.scenario import load_scenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim.scenario.serialization import read_yaml
from gslcosim_bench.cases.models import (
    LOWER_ANCHOR,
    SCHEMA,
    EntrySpec,
    ScenarioSpec,
    Suite,
    as_overrides,
)
from gslcosim_bench.cases.plan import build_plan, combine_hashes
from gslcosim_bench.cases.suite_files import LoadedSuite
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.rates import wilson
from gslcosim_bench.store import ResultsFolder
from gslcosim_bench.studies.runner import Row, StudyHost, StudyRunner
from gslcosim_bench.studies.search_space import SearchSpace, get_place
from gslcosim_bench.studies.target import find_method_entry

BATCH = 8
"""Cases that are drawn at once, whatever the number of workers: it is part of the result."""
EXPLORE_SHARE, REFINE_SHARE = 0.5, 0.3
"""Shares of the budget for random cases and for cases beside failures; the rest flies the worst again."""
N_AGAIN = 2
"""Other seeds with which each of the worst cases is flown again."""
# Fewer cases are not worth a batch.
_MIN_BATCH = 3
_MAX_PARENTS = 6
_MOVE_M = 1.0
"""Standard deviation of a move of a start or source in a case beside another [m]."""
_MAX_TRIES = 20
_SEED_BITS = 31


@dataclass(frozen=True, kw_only=True)
class SearchedCase:
    """A case of the search: a level of each factor, places, and the seed of run and gas.

    `parent` is the case that it was made from, and `root` the random case that all began with; `again` counts the other
    seeds of a case that is flown again.
    """

    name: str
    levels: tuple[float, ...]
    places: Mapping[str, tuple[float, ...]]
    seed: int
    root: str
    parent: str = ""
    again: int = 0

    def values(self, space: SearchSpace) -> dict[str, Any]:
        """Return all that the case sets in the scenario of its space, by path."""
        chosen = (factor.values(level) for factor, level in zip(space.factors, self.levels, strict=True))
        varied = {path: value for each in chosen for path, value in each.items()}
        return {**space.set, **varied, **{path: list(place) for path, place in self.places.items()}}


@dataclass(frozen=True, kw_only=True)
class CaseOutcome:
    """A case and what came of it: the row of the method, and that of the oracle where the method failed."""

    case: SearchedCase
    row: Row
    oracle: Row | None = None

    @property
    def is_failure(self) -> bool:
        """True where the method fails and the oracle finds the source."""
        return not self.row["success"] and self.oracle is not None and bool(self.oracle["success"])

    @property
    def distance_m(self) -> float:
        """Distance from the start to the first source, heights apart [m]."""
        return math.dist(*((self.row[f"{at}_x_m"], self.row[f"{at}_y_m"]) for at in ("start", "source")))

    @property
    def severity(self) -> float:
        """Severity of a failure, 0 to 1: the oracle's score times how much of the distance was left at best.

        severity = q_oracle min(1, (nearest - r) / (distance at the start - r)); r is the success radius; 0 without a
        failure.
        """
        if not self.is_failure or self.oracle is None:
            return 0.0
        radius_m = self.row["within_m"] or 0.0
        left_m, start_m = (max(0.0, each - radius_m) for each in (self.row["nearest_m"] or 0.0, self.distance_m))
        return float(self.oracle["score"] or 0.0) * min(1.0, left_m / max(start_m, 1e-9))


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """Failures among random cases at a level of a factor, and among all others, with the exact test of both."""

    factor: str
    level: str
    rate: Estimate
    other: Estimate
    p: float


@dataclass(frozen=True, kw_only=True)
class RankedFailure:
    """One of the worst failures, with what else was flown about it.

    Attributes:
        outcome: The worst case of those that began with one random case.
        again: The same case with other seeds.
        n_beside: Cases beside it that were flown.
        n_beside_failed: Those of them that are failures.
    """

    outcome: CaseOutcome
    again: tuple[CaseOutcome, ...]
    n_beside: int
    n_beside_failed: int

    @property
    def severity(self) -> float:
        """Mean of the severities over its seeds, so that a failure by chance counts little."""
        each = (self.outcome, *self.again)
        return sum(one.severity for one in each) / len(each)

    @property
    def n_again(self) -> int:
        """Number of runs with other seeds."""
        return len(self.again)

    @property
    def n_again_failed(self) -> int:
        """Number of those that failed too."""
        return sum(each.is_failure for each in self.again)


@dataclass(frozen=True, kw_only=True)
class FailureSearch:
    """Result of a search for failures.

    `failures` has the worst of each root, worst first; `contrasts` are over the random cases, the clearest first.
    """

    entry: str
    space: SearchSpace
    seed: int
    budget: int
    n_runs: int
    n_flown_now: int
    outcomes: tuple[CaseOutcome, ...]
    failures: tuple[RankedFailure, ...]
    contrasts: tuple[Contrast, ...]

    @property
    def random(self) -> tuple[CaseOutcome, ...]:
        """The outcomes of the random cases, which tell how often the method fails."""
        return tuple(each for each in self.outcomes if not each.case.parent)

    @property
    def failure_rate(self) -> Estimate:
        """Share of the random cases that are failures."""
        return wilson(sum(each.is_failure for each in self.random), len(self.random))


@dataclass(frozen=True, kw_only=True)
class FinderProgress:
    """Progress of a search after a batch."""

    phase: str
    n_runs: int
    budget: int
    n_cases: int
    n_failures: int


class FailureFinder:
    """One call of `gslcosim bench failures`.

    Cases are drawn again by the seed in each call; `StudyRunner` resumes them.
    """

    def __init__(
        self,
        method: str,
        space: SearchSpace,
        *,
        budget: int,
        seed: int,
        folder: Path,
        host: StudyHost,
        sensors_by_method: bool = False,
        tell: Callable[[FinderProgress], None] = lambda _: None,
    ) -> None:
        """Prepare to search.

        Args:
            budget: Runs in all, those of the oracle included.
            sensors_by_method: Whether the method flies with the sensors of its card instead of the scenario's.
            tell: Receives how the search stands, after each batch.
        """
        if budget < 4 * BATCH:
            raise UsageError(
                f"--budget: expected at least {4 * BATCH} runs, for two batches of cases with their oracles, was "
                f"{budget}. Give more."
            )
        entry = find_method_entry(method, option="METHOD")
        self.entry = entry.model_copy(update={"sensors": "by_method"}) if sensors_by_method else entry
        self._space = space
        self._budget = budget
        self._seed = seed
        self._host = host
        self._folder = ResultsFolder(folder)
        self._tell = tell
        self._specs: list[ScenarioSpec] = []
        self._outcomes: list[CaseOutcome] = []
        self._n_drawn = 0
        self._n_runs = 0

    def find(self) -> FailureSearch:
        """Search, fly the worst again with other seeds, and return what came of it."""
        explore = round(EXPLORE_SHARE * self._budget)
        refine = explore + round(REFINE_SHARE * self._budget)
        with self._host.sharing_pool() as host:
            self._runner = StudyRunner(self._folder, host)
            while n := self._batch_within(explore):
                self._fly("random cases", [self._random_case() for _ in range(n)])
            while n := self._batch_within(refine):
                parents = self._parents()
                self._fly("cases beside failures", [self._mutate(parents[i % len(parents)]) for i in range(n)])
            n_worst = (self._budget - self._n_runs) // (2 * N_AGAIN)
            worst = [each.outcome.case for each in self._ranked()[:n_worst]]
            self._fly("the worst again", [self._reseed(case, k + 1) for case in worst for k in range(N_AGAIN)])
            self._runner.finish()
        return FailureSearch(
            entry=self.entry.name,
            space=self._space,
            seed=self._seed,
            budget=self._budget,
            n_runs=self._n_runs,
            n_flown_now=self._runner.n_flown_now,
            outcomes=tuple(self._outcomes),
            failures=tuple(self._ranked()),
            contrasts=tuple(compute_contrasts(self._space, [o for o in self._outcomes if not o.case.parent])),
        )

    # A case takes two runs at most: the oracle flies where the method has failed.
    def _batch_within(self, n_runs: int) -> int:
        n = min(BATCH, (n_runs - self._n_runs) // 2)
        return n if n >= _MIN_BATCH else 0

    def _rng(self, *words: object) -> np.random.Generator:
        return stream(self._seed, "/".join(["failures", *map(str, words)]))

    def _next_name(self) -> str:
        self._n_drawn += 1
        return f"case_{self._n_drawn:04d}"

    def _random_case(self) -> SearchedCase:
        name = self._next_name()
        rng = self._rng(name)
        for _ in range(_MAX_TRIES):
            levels = tuple(factor.draw(rng) for factor in self._space.factors)
            case = SearchedCase(name=name, levels=levels, places={}, seed=_draw_seed(rng), root=name)
            if (placed := self._place(case)) is not None:
                return placed
        raise UsageError(
            f"{self._space.name}: expected cases with a place for a start and each source, found none in {_MAX_TRIES} "
            "random ones. Vary less, or give the scenario a larger room."
        )

    # One or two things change: a level, or a place that moves.
    def _mutate(self, parent: SearchedCase) -> SearchedCase:
        name = self._next_name()
        rng = self._rng(name)
        things: list[int | str] = [*range(len(self._space.factors)), *parent.places]
        for _ in range(_MAX_TRIES):
            chosen = {int(i) for i in rng.choice(len(things), size=min(len(things), 1 + int(rng.integers(2))))}
            levels, places = list(parent.levels), dict(parent.places)
            for thing in (things[i] for i in sorted(chosen)):
                if isinstance(thing, int):
                    levels[thing] = self._space.factors[thing].mutate(levels[thing], rng)
                else:
                    x_m, y_m, z_m = places[thing]
                    dx_m, dy_m = _MOVE_M * rng.normal(size=2)
                    places[thing] = (round(x_m + float(dx_m), 3), round(y_m + float(dy_m), 3), z_m)
            case = SearchedCase(
                name=name, levels=tuple(levels), places=places, seed=parent.seed, root=parent.root, parent=parent.name
            )
            if (placed := self._place(case)) is not None:
                return placed
        # Nothing about the parent is free: it is flown with another seed.
        return replace(parent, name=name, seed=_draw_seed(rng), parent=parent.name)

    def _reseed(self, case: SearchedCase, k: int) -> SearchedCase:
        seed = _draw_seed(self._rng(case.name, "again", k))
        return replace(case, name=f"{case.name}_again_{k}", seed=seed, parent=case.name, again=k)

    # The case with places that are free, drawn by its seed where it has none; None where there are none.
    def _place(self, case: SearchedCase) -> SearchedCase | None:
        missing = {path: "random" for path in self._space.place_paths if path not in case.places}
        values = {**case.values(self._space), **missing}
        try:
            loaded = load_scenario(
                self._space.scenario, overrides=as_overrides(values), seed=case.seed, placer=draw_positions
            )
        except ScenarioError as error:
            if missing and "random" in str(error):
                return None
            raise
        if find_position_problems(loaded.scenario, scenario_dir=loaded.directory):
            return None
        return replace(case, places={path: get_place(loaded.scenario, path) for path in self._space.place_paths})

    def _parents(self) -> list[SearchedCase]:
        ranked = [each.outcome for each in self._ranked()]
        if not ranked:
            # Nothing has failed: the slowest successes are nearest to it.
            ranked = sorted(self._outcomes, key=lambda each: (each.row["score"] or 0.0, each.case.name))
        return [each.case for each in ranked[:_MAX_PARENTS]]

    def _ranked(self) -> list[RankedFailure]:
        by_root: dict[str, list[CaseOutcome]] = {}
        for each in self._outcomes:
            by_root.setdefault(each.case.root, []).append(each)
        ranked: list[RankedFailure] = []
        for family in by_root.values():
            failed = [each for each in family if each.is_failure and not each.case.again]
            if not failed:
                continue
            worst = max(failed, key=lambda each: each.severity)
            others = [each for each in family if each is not worst and not each.case.again]
            again = [each for each in family if each.case.again and each.case.parent == worst.case.name]
            ranked.append(
                RankedFailure(
                    outcome=worst,
                    again=tuple(again),
                    n_beside=len(others),
                    n_beside_failed=sum(each.is_failure for each in others),
                )
            )
        return sorted(ranked, key=lambda each: (-each.severity, each.outcome.case.name))

    def _fly(self, phase: str, cases: Sequence[SearchedCase]) -> None:
        if not cases:
            return
        rows = self._rows_of(cases, self.entry.name)
        failed = [case for case in cases if not rows[case.name]["success"]]
        oracles = self._rows_of(failed, LOWER_ANCHOR) if failed else {}
        self._outcomes += [CaseOutcome(case=c, row=rows[c.name], oracle=oracles.get(c.name)) for c in cases]
        self._tell(
            FinderProgress(
                phase=phase,
                n_runs=self._n_runs,
                budget=self._budget,
                n_cases=len(self._outcomes),
                n_failures=sum(each.is_failure for each in self._outcomes),
            )
        )

    # The plan grows by the trials of some cases; what is in the folder is not flown again.
    def _rows_of(self, cases: Sequence[SearchedCase], entry: str) -> dict[str, Row]:
        names = {case.name for case in cases}
        known = {spec.name for spec in self._specs}
        self._specs += [self._spec(case) for case in cases if case.name not in known]
        part = build_plan(self._suite([spec for spec in self._specs if spec.name in names]))
        wanted = [trial for trial in part.trials if trial.entry == entry]
        plan = self._runner.plan
        before, cases_before = (plan.trials, plan.cases) if plan is not None else ((), ())
        trials = [replace(trial, index=len(before) + i) for i, trial in enumerate(wanted)]
        new = [case for case in part.cases if case.name not in {each.name for each in cases_before}]
        plan = replace(
            part,
            loaded=self._suite(self._specs),
            cases=(*cases_before, *new),
            trials=(*before, *trials),
            suite_hash=combine_hashes([trial.case_hash for trial in (*before, *part.trials)]),
        )
        self._n_runs += len(trials)
        return {row["case"]: row for row in self._runner.run(plan, trials)}

    def _spec(self, case: SearchedCase) -> ScenarioSpec:
        return ScenarioSpec(
            source=str(self._space.scenario),
            name=case.name,
            family=self._space.name,
            set=case.values(self._space),
            seeds=(case.seed,),
        )

    def _suite(self, specs: Sequence[ScenarioSpec]) -> LoadedSuite:
        suite = Suite(
            schema=SCHEMA,
            name="failures",
            title=f"Cases in which {self.entry.name} may fail",
            scenarios=tuple(specs),
            entries=(self.entry, EntrySpec(name=LOWER_ANCHOR, start=StartSpec(python=LOWER_ANCHOR))),
            anchors=(),
        )
        path = self._space.scenario
        return LoadedSuite(suite=suite, path=path, directory=path.parent, shown_path=self._space.name)


def _draw_seed(rng: np.random.Generator) -> int:
    return int(rng.integers(1 << _SEED_BITS))


def compute_contrasts(space: SearchSpace, outcomes: Sequence[CaseOutcome]) -> list[Contrast]:
    """Return how often cases fail at each level of each factor and otherwise, the clearest contrast first.

    Numbers, the distance from start to source, and how far downwind of the source the start lies are cut at their
    thirds. The tests are Fisher's exact ones, of which there are many: they order the list and prove nothing.

    Args:
        outcomes: Of random cases, which alone are drawn evenly.
    """
    from scipy.stats import fisher_exact

    found: list[Contrast] = []
    failed = np.array([each.is_failure for each in outcomes], dtype=bool)
    for name, labels in _levels(space, outcomes):
        for level in dict.fromkeys(sorted(labels)):
            inside = np.array([label == level for label in labels])
            if not inside.any() or inside.all():
                continue
            counts = [(int(failed[some].sum()), int(some.sum())) for some in (inside, ~inside)]
            test: Any = fisher_exact([(k, n - k) for k, n in counts])
            found.append(
                Contrast(
                    factor=name,
                    level=level,
                    rate=wilson(*counts[0]),
                    other=wilson(*counts[1]),
                    p=float(test.pvalue),
                )
            )
    return sorted(found, key=lambda each: (each.p, each.factor, each.level))


def _levels(space: SearchSpace, outcomes: Sequence[CaseOutcome]) -> list[tuple[str, list[str]]]:
    named: list[tuple[str, list[str]]] = []
    for i, factor in enumerate(space.factors):
        levels = [each.case.levels[i] for each in outcomes]
        if factor.choices or factor.n:
            named.append((factor.name, [factor.describe(level) for level in levels]))
        else:
            named.append((factor.name, _thirds(levels)))
    named.append(("distance to the source [m]", _thirds([each.distance_m for each in outcomes])))
    downwind_m = [_downwind_m(each, space) for each in outcomes]
    if all(value is not None for value in downwind_m):
        named.append(("start downwind of the source [m]", _thirds([float(value or 0.0) for value in downwind_m])))
    return named


# By the velocity at the inlet, where the case sets it or the scenario has it.
def _downwind_m(outcome: CaseOutcome, space: SearchSpace) -> float | None:
    wind: Any = outcome.case.values(space).get("wind.inlet_velocity_m_s")
    if wind is None:
        text = space.scenario.read_text(encoding="utf-8-sig")
        wind = ((read_yaml(text, source="").block or {}).get("wind") or {}).get("inlet_velocity_m_s")
    if not isinstance(wind, list | tuple) or not math.hypot(*wind[:2]):
        return None
    offset_m = [outcome.row[f"start_{axis}_m"] - outcome.row[f"source_{axis}_m"] for axis in "xy"]
    return sum(a * b for a, b in zip(offset_m, wind[:2], strict=True)) / math.hypot(*wind[:2])


def _thirds(values: Sequence[float]) -> list[str]:
    edges = [float(f"{edge:.3g}") for edge in np.quantile(values, [0.0, 1 / 3, 2 / 3, 1.0])] if values else []
    labels = [f"{low:g} to {high:g}" for low, high in pairwise(edges)]
    return [labels[sum(value > edge for edge in edges[1:-1])] for value in values]
