"""Tuning: a search for good parameters on training seeds within a budget, and validation of what it found."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.bench.cases.trials import derive_seed
from gslcosim.bench.execution.pool import Pool
from gslcosim.bench.execution.runner import Progress
from gslcosim.bench.statistics.estimates import Estimate
from gslcosim.bench.store.folder import ResultsFolder
from gslcosim.bench.studies.disjoint_seeds import DEFAULT, Setting, collect_seeds, collect_test_seeds
from gslcosim.bench.studies.evaluation_plan import (
    EvaluationPlan,
    ReusablePool,
    Row,
    SettingRunner,
    build_evaluation_plan,
)
from gslcosim.bench.studies.optuna_search import OptunaSearch, load_optuna
from gslcosim.bench.studies.parameter_values import ParameterRange
from gslcosim.bench.studies.setting_figures import (
    SettingFigures,
    SettingRuns,
    compute_difference,
    compute_figures,
    group_runs,
    paired_p_value,
)
from gslcosim.bench.studies.target import StudyTarget


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Runs in all, for each setting in training, and for each of the two that are run in validation."""

    flights: int
    per_setting: int
    per_validation: int

    @property
    def n_settings(self) -> int:
        """Number of settings that the search can run, the default among them."""
        return (self.flights - self.validation) // self.per_setting

    @property
    def validation(self) -> int:
        """Runs that are kept for the validation of the best setting and the default."""
        return 2 * self.per_validation

    @property
    def search(self) -> int:
        """Runs of the search."""
        return self.n_settings * self.per_setting


def split_budget(flights: int, per_setting: int | None = None) -> Budget:
    """Return how a budget is shared.

    A setting flies half the square root of the budget, 2 at least: as the budget grows, settings get more in number
    and better known at the same rate. A fifth of it is kept for validation, where best and default fly as often as a
    setting at least.

    Args:
        runs: All runs.
        per_setting: Runs of each setting, if given.

    Raises:
        UsageError: it is too small for the default, one other setting, and their validation.
    """
    k = per_setting if per_setting is not None else max(2, round(math.sqrt(flights) / 2))
    budget = Budget(flights=flights, per_setting=k, per_validation=max(k, flights // 10))
    if budget.n_settings < 2:
        raise UsageError(
            f"--budget: expected at least {4 * k} flights, for the default, another setting and the validation of "
            f"both with {k} flights each; was {flights}. Give more, or fewer --flights-per-setting."
        )
    return budget


BATCH = 4
"""Settings that are asked for at once, whatever the number of workers: it is part of the result."""

SIGNIFICANT = 0.05
"""p below which the best setting is said to differ from the default."""

TRAINING, VALIDATION, STUDY = "training", "validation", "study.log"


@dataclass(frozen=True, kw_only=True)
class EvaluatedSetting:
    """A setting and what its runs came to."""

    setting: Setting
    figures: SettingFigures


@dataclass(frozen=True, kw_only=True)
class Validation:
    """The best setting and the default on seeds that neither the search nor a test suite has.

    `difference` is of mean scores over the same runs, `p` of the paired permutation test that there is none.
    """

    seed: int
    best: SettingFigures
    default: SettingFigures
    difference: Estimate
    p: float

    @property
    def is_shown(self) -> bool:
        """True where interval and test both show a difference: few runs give narrow intervals."""
        return not self.difference.holds_zero and self.p < SIGNIFICANT


@dataclass(frozen=True, kw_only=True)
class TuningResult:
    """Result of a search.

    Attributes:
        suite: Name of the suite or scenario.
        entry: Name of the method.
        parameters: Those of the entry as it was entered.
        ranges: What was searched.
        seed: Of the search.
        budget: How the runs were shared.
        training_seed: Of the runs of the search.
        tried: All settings that were run, the default first, then in the order in which they were asked for.
        n_asked: How many settings were asked for; of equal ones only the first was run.
        best: The one with the highest mean score in training; of equal ones the first.
        difference: Its mean score over the default's in training; None where it is the default.
        validation: None where the best is the default.
        n_flown_before: Runs that were there already.
    """

    suite: str
    entry: str
    parameters: Mapping[str, object]
    ranges: tuple[ParameterRange, ...]
    seed: int
    budget: Budget
    training_seed: int
    tried: tuple[EvaluatedSetting, ...]
    n_asked: int
    best: EvaluatedSetting
    difference: Estimate | None
    validation: Validation | None
    n_flown_before: int

    @property
    def default(self) -> EvaluatedSetting:
        """The method as it was entered."""
        return self.tried[0]

    @property
    def n_search(self) -> int:
        """Runs of the search."""
        return len(self.tried) * self.budget.per_setting

    @property
    def n_validation(self) -> int:
        """Runs of the validation."""
        return self.budget.validation if self.validation is not None else 0


@dataclass(frozen=True, kw_only=True)
class TuningProgress:
    """Progress of a tuning after a batch."""

    n_settings: int
    most_settings: int
    n_flights: int
    budget: int
    best: EvaluatedSetting


class Tuner:
    """One call of `gslcosim tune`: asks, runs, reports; then validates.

    It always begins at the first batch. The search is drawn again by its seed, and runs that are in the folder are
    not run again, so that an interrupted call goes on where it stopped and ends as if it had not been interrupted.
    """

    def __init__(
        self,
        subject: StudyTarget,
        ranges: Sequence[ParameterRange],
        budget: Budget,
        *,
        seed: int,
        folder: Path,
        start_pool: Callable[[], Pool],
        report: Callable[[Progress], None] = lambda _: None,
        tell: Callable[[TuningProgress], None] = lambda _: None,
    ) -> None:
        """Prepare to tune.

        Args:
            subject: The method and its cases.
            ranges: What is searched.
            budget: How many runs.
            seed: Of the search, and part of the seeds of all its runs.
            folder: Where everything is kept.
            start_pool: Starts the workers; not called when there is nothing to fly.
            report: Receives the status of the run.
            tell: Receives how the search stands, after each batch.
        """
        self._subject = subject
        self._ranges = tuple(ranges)
        self._budget = budget
        self._seed = seed
        self._folder = folder
        self._start_pool = start_pool
        self._report = report
        self._tell = tell
        self._flights: dict[str, SettingRuns] = {}
        self._tried: list[EvaluatedSetting] = []

    def tune(self) -> TuningResult:
        """Search, validate, and return what came of it.

        Raises:
            KeyboardInterrupt: it was interrupted; the same call goes on.
            GslCosimError: Optuna is not there, the folder cannot be used, or nothing can be run.
        """
        load_optuna()
        with ResultsFolder(self._folder).locked():
            search = OptunaSearch(self._ranges, seed=derive_seed(self._seed, "search"), log=self._folder / STUDY)
            training, validation = self.evaluations()
            pool = ReusablePool(self._start_pool)
            try:
                runner = SettingRunner(training, ResultsFolder(self._folder / TRAINING), pool, self._report)
                n_asked = self._search(search, runner)
                runner.finish()
                best = max(self._tried, key=lambda tried: tried.figures.score.value)
                n_now = runner.n_flown_now
                validated = None
                if best is not self._tried[0]:
                    runner = SettingRunner(validation, ResultsFolder(self._folder / VALIDATION), pool, self._report)
                    validated = self._validate(runner, best.setting)
                    n_now += runner.n_flown_now
            finally:
                pool.end()
        n_used = len(self._tried) * self._budget.per_setting + (self._budget.validation if validated else 0)
        return TuningResult(
            suite=self._subject.loaded.suite.name,
            entry=self._subject.entry.name,
            parameters=dict(self._subject.entry.parameters),
            ranges=self._ranges,
            seed=self._seed,
            budget=self._budget,
            training_seed=training.seed,
            tried=tuple(self._tried),
            n_asked=n_asked,
            best=best,
            difference=self._over_default(best.setting.name),
            validation=validated,
            n_flown_before=n_used - n_now,
        )

    def evaluations(self) -> tuple[EvaluationPlan, EvaluationPlan]:
        """Return the runs of training and of validation: no seed is one of the other's or of a suite's."""
        self._report(Progress(phase="planning", done=0, total=2, elapsed_s=0.0))
        tests = collect_test_seeds(self._subject.loaded)
        training = build_evaluation_plan(self._subject, TRAINING, self._seed, n=self._budget.per_setting, taken=tests)
        self._report(Progress(phase="planning", done=1, total=2, elapsed_s=0.0))
        taken = tests | collect_seeds(training.subject.loaded)
        validation = build_evaluation_plan(
            self._subject, VALIDATION, self._seed, n=self._budget.per_validation, taken=taken
        )
        return training, validation

    # Batches are of one size and given in order, so that nothing depends on which run was over first.
    def _search(self, search: OptunaSearch, runner: SettingRunner) -> int:
        new = [Setting(name=DEFAULT, parameters={})]
        names = {self._default_values(): DEFAULT}
        n_left = self._budget.n_settings - 1
        n_asked = 0
        while n_left:
            asked = search.ask(min(BATCH, n_left))
            n_left -= len(asked)
            for values in asked:
                n_asked += 1
                key = tuple(values.items())
                if key not in names:
                    names[key] = f"s_{n_asked:03d}"
                    new.append(Setting(name=names[key], parameters=values))
            self._take(new, runner.fly(new))
            search.tell([float(self._flights[names[tuple(values.items())]].score.mean()) for values in asked])
            if n_asked == len(asked):
                self._add_default(search)
            new = []
            self._tell(self._stage())
        return n_asked

    def _take(self, settings: Sequence[Setting], rows: Mapping[str, Sequence[Row]]) -> None:
        for setting in settings:
            self._flights[setting.name] = group_runs(rows[setting.name])
            self._tried.append(EvaluatedSetting(setting=setting, figures=compute_figures(self._flights[setting.name])))

    def _default_values(self) -> tuple[tuple[str, object], ...]:
        return tuple((each.name, self._subject.default_of(each.name)) for each in self._ranges)

    # A default outside the ranges is compared with, and tells the search nothing.
    def _add_default(self, search: OptunaSearch) -> None:
        values = dict(self._default_values())
        if all(each.holds(values[each.name]) for each in self._ranges):
            numbers = {name: value for name, value in values.items() if isinstance(value, int | float)}
            search.add(numbers, float(self._flights[DEFAULT].score.mean()))

    def _stage(self) -> TuningProgress:
        return TuningProgress(
            n_settings=len(self._tried),
            most_settings=self._budget.n_settings,
            n_flights=len(self._tried) * self._budget.per_setting,
            budget=self._budget.flights,
            best=max(self._tried, key=lambda tried: tried.figures.score.value),
        )

    def _over_default(self, name: str) -> Estimate | None:
        return None if name == DEFAULT else compute_difference(self._flights[name], self._flights[DEFAULT])

    def _validate(self, runner: SettingRunner, best: Setting) -> Validation:
        rows = runner.fly([Setting(name=DEFAULT, parameters={}), best])
        runner.finish()
        a, b = group_runs(rows[best.name]), group_runs(rows[DEFAULT])
        return Validation(
            seed=runner.evaluation.seed,
            best=compute_figures(a),
            default=compute_figures(b),
            difference=compute_difference(a, b),
            p=paired_p_value(a, b),
        )
