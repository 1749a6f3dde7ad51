"""Tuning: a search for good parameters on training seeds within a budget, and validation of what it found."""

import hashlib
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim_bench.cases.models import Case, derive_seed
from gslcosim_bench.cases.plan import Plan, build_plan, expand_cases
from gslcosim_bench.execution.runner import Progress
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.settings import (
    SettingFigures,
    SettingRuns,
    compute_difference,
    compute_figures,
    group_runs,
    paired_p_value,
)
from gslcosim_bench.store import ResultsFolder
from gslcosim_bench.studies.runner import Row, StudyHost, StudyRunner
from gslcosim_bench.studies.target import (
    DEFAULT,
    ParameterRange,
    Setting,
    StudyTarget,
    build_study_suite,
    collect_seeds,
    collect_test_seeds,
    restrict_cases,
    with_changed_fields,
    with_disjoint_seeds,
)

STUDY_NAME = "tuning"
BATCH = 4
"""Settings that are asked for at once, whatever the number of workers: it is part of the result."""
SIGNIFICANT = 0.05
"""p below which the best setting is said to differ from the default."""
TRAINING, VALIDATION, STUDY_LOG = "training", "validation", "study.log"


@dataclass(frozen=True, kw_only=True)
class EvaluationPlan:
    """Cases and repetitions that every setting flies, with seeds of their own.

    Attributes:
        subject: The method, in a suite with these seeds.
        name: What the suite is called.
        slots: Case and repetition of each run.
        seeds: All seeds of it, see `disjoint_seeds.collect_seeds`.
    """

    subject: StudyTarget
    name: str
    slots: tuple[tuple[str, int], ...]

    @property
    def seed(self) -> int:
        """The seed that all others come from."""
        return self.subject.loaded.suite.seed

    def plan(self, settings: Sequence[Setting], *, after: Plan | None = None) -> Plan:
        """Return the runs of some settings behind those of an earlier plan, in the order of a suite of them all."""
        plan = build_plan(
            build_study_suite(self.subject, [each.entry(self.subject) for each in settings], name=self.name)
        )
        slots = set(self.slots)
        trials = [trial for trial in plan.trials if (trial.case, trial.repetition) in slots]
        if after is None:
            return replace(plan, trials=tuple(trials))
        entries = (*after.entries, *plan.entries)
        all_settings = tuple(entry.spec for entry in entries)
        place = {case.name: i for i, case in enumerate(plan.cases)}
        turn = {spec.name: i for i, spec in enumerate(all_settings)}
        trials = sorted(
            [*after.trials, *trials], key=lambda each: (place[each.case], each.repetition, turn[each.entry])
        )
        return replace(
            plan,
            loaded=with_changed_fields(plan.loaded, entries=all_settings),
            entries=entries,
            trials=tuple(replace(trial, index=i) for i, trial in enumerate(trials)),
        )


def build_evaluation_plan(
    subject: StudyTarget, purpose: str, number: int, *, n: int, taken: frozenset[int]
) -> EvaluationPlan:
    """Return a plan of n runs.

    All cases are run equally often. What is left over goes to cases of all scenarios in turn, at random within each.

    Args:
        purpose: `training` or `validation`; part of the seeds.
        number: Seed of the tuning; part of the seeds, and of the lot.
        taken: Seeds that may not occur.
    """
    rounds = 1
    while True:
        loaded = with_disjoint_seeds(subject, purpose, number, repetitions=rounds, taken=taken)
        lot = _draw_cases([case for _, case in expand_cases(loaded)], loaded.suite.seed)
        cases = _first_that_fly(replace(subject, loaded=loaded), lot, n=n)
        if len(cases) * rounds >= n:
            break
        rounds = max(rounds + 1, math.ceil(n / len(cases)))
    slots = [(case, i) for i in range(rounds) for case in cases][:n]
    chosen = replace(subject, loaded=restrict_cases(loaded, {case for case, _ in slots}))
    return EvaluationPlan(subject=chosen, name=f"{purpose}_{subject.entry.name}", slots=tuple(slots))


# One case of each scenario, then a second one of each, and so on.
def _draw_cases(cases: Sequence[Case], seed: int) -> list[str]:
    drawn = sorted(cases, key=lambda case: hashlib.blake2b(f"{seed}/{case.name}".encode()).digest())
    rank: dict[str, int] = {}
    seen: dict[str, int] = {}
    for case in drawn:
        rank[case.name] = seen.get(case.scenario, 0)
        seen[case.scenario] = rank[case.name] + 1
    return sorted(rank, key=lambda name: rank[name])


# Some combinations are no case: their places are not free.
def _first_that_fly(subject: StudyTarget, lot: Sequence[str], *, n: int) -> list[str]:
    once = Setting(name=subject.entry.name, parameters={}).entry(subject)
    n_tried = n
    while True:
        some = lot[:n_tried]
        loaded = restrict_cases(subject.loaded, some)
        try:
            plan = build_plan(build_study_suite(replace(subject, loaded=loaded), [once], name="cases"))
            flown = {case.name for case in plan.cases}
        except ScenarioError:
            # Of those tried none may be a case; of all of them some has to be.
            if n_tried >= len(lot):
                raise
            flown = set[str]()
        found = [name for name in some if name in flown]
        if len(found) >= n or n_tried >= len(lot):
            return found[:n]
        n_tried = 2 * n_tried


def run_settings(runner: StudyRunner, evaluation: EvaluationPlan, settings: Sequence[Setting]) -> dict[str, list[Row]]:
    """Return the rows of each setting of an evaluation plan by its name; run what is missing."""
    plan = evaluation.plan(settings, after=runner.plan)
    found: dict[str, list[Row]] = {setting.name: [] for setting in settings}
    wanted = [trial for trial in plan.trials if trial.entry in found]
    for trial, row in zip(wanted, runner.run(plan, wanted), strict=True):
        found[trial.entry].append(row)
    return found


class OptunaSearch:
    """A study that asks for settings in batches and gets their scores in order: equal calls, equal settings.

    Nothing of it depends on who flew, or when: settings are drawn by the seed and by the scores given so far.
    The study is kept in a file that Optuna's own tools read; it is written again each time, from runs that are
    there.

    Source:
        Bergstra et al. 2011, Algorithms for Hyper-Parameter Optimization (TPE); Optuna: Akiba et al. 2019,
        doi:10.1145/3292500.3330701. Of a batch, settings without a score yet count as bad ones ("constant liar").
    """

    def __init__(self, ranges: Sequence[ParameterRange], *, seed: int, log: Path) -> None:
        """Begin a study.

        Args:
            log: Where the study is kept; what stands there is replaced.
        """
        self._optuna = load_optuna()
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

        self._ranges = tuple(ranges)
        self._distributions = {each.name: self._distribution(each) for each in ranges}
        self._waiting: list[Any] = []
        log.unlink(missing_ok=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", self._optuna.exceptions.ExperimentalWarning)
            sampler = self._optuna.samplers.TPESampler(seed=seed, constant_liar=True)
        self._study = self._optuna.create_study(
            storage=JournalStorage(JournalFileBackend(str(log))),
            sampler=sampler,
            study_name=STUDY_NAME,
            direction="maximize",
        )

    def ask(self, n: int) -> list[dict[str, int | float]]:
        """Return the next settings; their scores are given before the next ones are asked for."""
        assert not self._waiting, "scores are told before more is asked for"
        self._waiting = [self._study.ask(self._distributions) for _ in range(n)]
        return [{each.name: each.rounded(trial.params[each.name]) for each in self._ranges} for trial in self._waiting]

    def tell(self, scores: Sequence[float]) -> None:
        """Take the scores of the settings that were asked for, in their order."""
        for trial, score in zip(self._waiting, scores, strict=True):
            self._study.tell(trial, score)
        self._waiting = []

    def add(self, values: Mapping[str, int | float], score: float) -> None:
        """Take a setting that was not asked for, and its score."""
        self._study.add_trial(
            self._optuna.trial.create_trial(params=dict(values), distributions=self._distributions, value=score)
        )

    def _distribution(self, each: ParameterRange) -> Any:
        if each.is_whole:
            return self._optuna.distributions.IntDistribution(int(each.low), int(each.high), log=each.is_log)
        return self._optuna.distributions.FloatDistribution(float(each.low), float(each.high), log=each.is_log)


def load_optuna() -> Any:
    """Return Optuna, which then prints nothing by itself."""
    try:
        import optuna
    except ModuleNotFoundError as error:
        raise UsageError(
            "tune: expected Optuna to be installed, was not. Install it: pip install 'gslcosim-bench[tune]'"
        ) from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return optuna


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
    """Return the shares of a budget.

    A setting flies half the square root of the budget, 2 at least: as the budget grows, settings get more in number
    and better known at the same rate. A fifth of it is kept for validation, where best and default fly as often as a
    setting at least.
    """
    k = per_setting if per_setting is not None else max(2, round(math.sqrt(flights) / 2))
    budget = Budget(flights=flights, per_setting=k, per_validation=max(k, flights // 10))
    if budget.n_settings < 2:
        raise UsageError(
            f"--budget: expected at least {4 * k} flights, for the default, another setting and the validation of "
            f"both with {k} flights each; was {flights}. Give more, or fewer --flights-per-setting."
        )
    return budget


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
    """One call of `gslcosim bench tune`: asks, runs, reports; then validates.

    The search is drawn again by its seed in each call; `StudyRunner` resumes it.
    """

    def __init__(
        self,
        subject: StudyTarget,
        ranges: Sequence[ParameterRange],
        budget: Budget,
        *,
        seed: int,
        folder: Path,
        host: StudyHost,
        tell: Callable[[TuningProgress], None] = lambda _: None,
    ) -> None:
        """Prepare to tune.

        Args:
            seed: Of the search, and part of the seeds of all its runs.
            tell: Receives how the search stands, after each batch.
        """
        self._subject = subject
        self._ranges = tuple(ranges)
        self._budget = budget
        self._seed = seed
        self._folder = folder
        self._host = host
        self._tell = tell
        self._flights: dict[str, SettingRuns] = {}
        self._tried: list[EvaluatedSetting] = []

    def tune(self) -> TuningResult:
        """Search, validate, and return what came of it."""
        load_optuna()
        with ResultsFolder(self._folder).locked():
            search = OptunaSearch(self._ranges, seed=derive_seed(self._seed, "search"), log=self._folder / STUDY_LOG)
            training, validation = self.evaluations()
            with self._host.sharing_pool() as host:
                runner = StudyRunner(ResultsFolder(self._folder / TRAINING), host)
                n_asked = self._search(search, runner, training)
                runner.finish()
                best = max(self._tried, key=lambda tried: tried.figures.score.value)
                n_now = runner.n_flown_now
                validated = None
                if best is not self._tried[0]:
                    runner = StudyRunner(ResultsFolder(self._folder / VALIDATION), host)
                    validated = self._validate(runner, validation, best.setting)
                    n_now += runner.n_flown_now
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
        self._host.report(Progress(phase="planning", done=0, total=2, elapsed_s=0.0))
        tests = collect_test_seeds(self._subject.loaded)
        training = build_evaluation_plan(self._subject, TRAINING, self._seed, n=self._budget.per_setting, taken=tests)
        self._host.report(Progress(phase="planning", done=1, total=2, elapsed_s=0.0))
        taken = tests | collect_seeds(training.subject.loaded)
        validation = build_evaluation_plan(
            self._subject, VALIDATION, self._seed, n=self._budget.per_validation, taken=taken
        )
        return training, validation

    # Batches are of one size and given in order, so that nothing depends on which run was over first.
    def _search(self, search: OptunaSearch, runner: StudyRunner, training: EvaluationPlan) -> int:
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
            self._take(new, run_settings(runner, training, new))
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

    def _validate(self, runner: StudyRunner, validation: EvaluationPlan, best: Setting) -> Validation:
        rows = run_settings(runner, validation, [Setting(name=DEFAULT, parameters={}), best])
        runner.finish()
        a, b = group_runs(rows[best.name]), group_runs(rows[DEFAULT])
        return Validation(
            seed=validation.seed,
            best=compute_figures(a),
            default=compute_figures(b),
            difference=compute_difference(a, b),
            p=paired_p_value(a, b),
        )
