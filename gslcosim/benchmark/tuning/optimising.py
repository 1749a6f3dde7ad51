"""Tuning: a search for good parameters of a method on training seeds, and an honest look at what it found."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.benchmark.execution.jobs import Pool
from gslcosim.benchmark.execution.running import Progress
from gslcosim.benchmark.statistics.estimates import Estimate
from gslcosim.benchmark.store.folder import ResultsFolder
from gslcosim.benchmark.suite.seeds import seed_of
from gslcosim.benchmark.tuning.budget import Budget
from gslcosim.benchmark.tuning.course import Flyer, KeptPool, Row, TuningCourse, course_of
from gslcosim.benchmark.tuning.deriving import DEFAULT, Setting, seeds_of, seeds_of_tests
from gslcosim.benchmark.tuning.figures import Figures, Flights, difference_of, figures_of, flights_of, p_of
from gslcosim.benchmark.tuning.searching import Search, load_optuna
from gslcosim.benchmark.tuning.subject import Subject
from gslcosim.benchmark.tuning.values import Range

BATCH = 4
"""Settings that are asked for at once, whatever the number of workers: it is part of the result."""

SIGNIFICANT = 0.05
"""p below which the best setting is said to differ from the default."""

TRAINING, VALIDATION, STUDY = "training", "validation", "study.log"


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A setting and what its flights came to."""

    setting: Setting
    figures: Figures


@dataclass(frozen=True, kw_only=True)
class Validation:
    """The best setting and the default on seeds that neither the search nor a test suite has.

    `difference` is of mean scores over the same flights, `p` of the paired permutation test that there is none.
    """

    seed: int
    best: Figures
    default: Figures
    difference: Estimate
    p: float

    @property
    def is_shown(self) -> bool:
        """Whether a difference is shown: by its interval and by the test, for few flights give narrow intervals."""
        return not self.difference.holds_zero and self.p < SIGNIFICANT


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """What a search came to.

    Attributes:
        suite: Name of the suite or scenario.
        entry: Name of the method.
        parameters: Those of the entry as it was entered.
        ranges: What was searched.
        seed: Of the search.
        budget: How the flights were shared.
        training_seed: Of the flights of the search.
        tried: All settings that were flown, the default first, then in the order in which they were asked for.
        n_asked: How many settings were asked for; of equal ones only the first was flown.
        best: The one with the highest mean score in training; of equal ones the first.
        difference: Its mean score over the default's in training; None where it is the default.
        validation: None where the best is the default.
        n_flown_before: Flights that were there already.
    """

    suite: str
    entry: str
    parameters: Mapping[str, object]
    ranges: tuple[Range, ...]
    seed: int
    budget: Budget
    training_seed: int
    tried: tuple[Tried, ...]
    n_asked: int
    best: Tried
    difference: Estimate | None
    validation: Validation | None
    n_flown_before: int

    @property
    def default(self) -> Tried:
        """The method as it was entered."""
        return self.tried[0]

    @property
    def n_search(self) -> int:
        """Flights of the search."""
        return len(self.tried) * self.budget.per_setting

    @property
    def n_validation(self) -> int:
        """Flights of the validation."""
        return self.budget.validation if self.validation is not None else 0


@dataclass(frozen=True, kw_only=True)
class Stage:
    """How a tuning stands after a batch."""

    n_settings: int
    most_settings: int
    n_flights: int
    budget: int
    best: Tried


class Tuner:
    """One call of `gslcosim tune`: asks, flies, tells; then validates.

    It always begins at the first batch. The search is drawn anew by its seed, and flights that are in the folder are
    not flown again, so that an interrupted call goes on where it stopped and ends as if it had not been interrupted.
    """

    def __init__(
        self,
        subject: Subject,
        ranges: Sequence[Range],
        budget: Budget,
        *,
        seed: int,
        folder: Path,
        start_pool: Callable[[], Pool],
        report: Callable[[Progress], None] = lambda _: None,
        tell: Callable[[Stage], None] = lambda _: None,
    ) -> None:
        """Prepare to tune.

        Args:
            subject: The method and its cases.
            ranges: What is searched.
            budget: How many flights.
            seed: Of the search, and part of the seeds of all its flights.
            folder: Where everything is kept.
            start_pool: Starts the workers; not called when there is nothing to fly.
            report: Is told how flights go.
            tell: Is told how the search stands, after each batch.
        """
        self._subject = subject
        self._ranges = tuple(ranges)
        self._budget = budget
        self._seed = seed
        self._folder = folder
        self._start_pool = start_pool
        self._report = report
        self._tell = tell
        self._flights: dict[str, Flights] = {}
        self._tried: list[Tried] = []

    def tune(self) -> Tuning:
        """Search, validate, and return what came of it.

        Raises:
            KeyboardInterrupt: it was interrupted; the same call goes on.
            GslCosimError: Optuna is not there, the folder cannot be used, or nothing can be flown.
        """
        load_optuna()
        with ResultsFolder(self._folder).locked():
            search = Search(self._ranges, seed=seed_of(self._seed, "search"), log=self._folder / STUDY)
            training, validation = self.courses()
            pool = KeptPool(self._start_pool)
            try:
                flyer = Flyer(training, ResultsFolder(self._folder / TRAINING), pool, self._report)
                n_asked = self._search(search, flyer)
                flyer.finish()
                best = max(self._tried, key=lambda tried: tried.figures.score.value)
                n_now = flyer.n_flown_now
                validated = None
                if best is not self._tried[0]:
                    flyer = Flyer(validation, ResultsFolder(self._folder / VALIDATION), pool, self._report)
                    validated = self._validate(flyer, best.setting)
                    n_now += flyer.n_flown_now
            finally:
                pool.end()
        n_used = len(self._tried) * self._budget.per_setting + (self._budget.validation if validated else 0)
        return Tuning(
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

    def courses(self) -> tuple[TuningCourse, TuningCourse]:
        """Return the flights of training and of validation: no seed is one of the other's or of a suite's."""
        self._report(Progress(phase="planning", done=0, total=2, elapsed_s=0.0))
        tests = seeds_of_tests(self._subject.loaded)
        training = course_of(self._subject, TRAINING, self._seed, n=self._budget.per_setting, taken=tests)
        self._report(Progress(phase="planning", done=1, total=2, elapsed_s=0.0))
        taken = tests | seeds_of(training.subject.loaded)
        validation = course_of(self._subject, VALIDATION, self._seed, n=self._budget.per_validation, taken=taken)
        return training, validation

    # Batches are of one size and told in order, so that nothing depends on which flight was over first.
    def _search(self, search: Search, flyer: Flyer) -> int:
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
            self._take(new, flyer.fly(new))
            search.tell([float(self._flights[names[tuple(values.items())]].score.mean()) for values in asked])
            if n_asked == len(asked):
                self._add_default(search)
            new = []
            self._tell(self._stage())
        return n_asked

    def _take(self, settings: Sequence[Setting], rows: Mapping[str, Sequence[Row]]) -> None:
        for setting in settings:
            self._flights[setting.name] = flights_of(rows[setting.name])
            self._tried.append(Tried(setting=setting, figures=figures_of(self._flights[setting.name])))

    def _default_values(self) -> tuple[tuple[str, object], ...]:
        return tuple((each.name, self._subject.default_of(each.name)) for each in self._ranges)

    # A default outside the ranges is compared with, and tells the search nothing.
    def _add_default(self, search: Search) -> None:
        values = dict(self._default_values())
        if all(each.holds(values[each.name]) for each in self._ranges):
            numbers = {name: value for name, value in values.items() if isinstance(value, int | float)}
            search.add(numbers, float(self._flights[DEFAULT].score.mean()))

    def _stage(self) -> Stage:
        return Stage(
            n_settings=len(self._tried),
            most_settings=self._budget.n_settings,
            n_flights=len(self._tried) * self._budget.per_setting,
            budget=self._budget.flights,
            best=max(self._tried, key=lambda tried: tried.figures.score.value),
        )

    def _over_default(self, name: str) -> Estimate | None:
        return None if name == DEFAULT else difference_of(self._flights[name], self._flights[DEFAULT])

    def _validate(self, flyer: Flyer, best: Setting) -> Validation:
        rows = flyer.fly([Setting(name=DEFAULT, parameters={}), best])
        flyer.finish()
        a, b = flights_of(rows[best.name]), flights_of(rows[DEFAULT])
        return Validation(
            seed=flyer.course.seed,
            best=figures_of(a),
            default=figures_of(b),
            difference=difference_of(a, b),
            p=p_of(a, b),
        )
