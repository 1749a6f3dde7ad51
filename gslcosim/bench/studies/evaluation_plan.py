"""Evaluation plan: the runs that every setting makes, run batch after batch into one folder."""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gslcosim.base.errors import ScenarioError
from gslcosim.bench.cases.plan import Plan, build_plan, expand_cases
from gslcosim.bench.cases.trials import Case
from gslcosim.bench.execution.pool import Job, JobResult, Pool
from gslcosim.bench.execution.runner import Progress, SuiteRun
from gslcosim.bench.execution.selection import Selection
from gslcosim.bench.store.folder import ResultsFolder
from gslcosim.bench.studies.disjoint_seeds import Setting, build_setting_suite, restrict_cases, with_disjoint_seeds
from gslcosim.bench.studies.target import StudyTarget, with_changed_fields

Row = Mapping[str, Any]


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
        plan = build_plan(build_setting_suite(self.subject, settings, name=self.name))
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
        subject: The method and its cases.
        purpose: `training` or `validation`; part of the seeds.
        number: Seed of the tuning; part of the seeds, and of the lot.
        n: Runs of each setting.
        taken: Seeds that may not occur.
    """
    rounds = 1
    while True:
        loaded = with_disjoint_seeds(subject, purpose, number, repetitions=rounds, taken=taken)
        lot = _lot([case for _, case in expand_cases(loaded)], loaded.suite.seed)
        cases = _first_that_fly(replace(subject, loaded=loaded), lot, n=n)
        if len(cases) * rounds >= n:
            break
        rounds = max(rounds + 1, math.ceil(n / len(cases)))
    slots = [(case, i) for i in range(rounds) for case in cases][:n]
    chosen = replace(subject, loaded=restrict_cases(loaded, {case for case, _ in slots}))
    return EvaluationPlan(subject=chosen, name=f"{purpose}_{subject.entry.name}", slots=tuple(slots))


# One case of each scenario, then a second one of each, and so on.
def _lot(cases: Sequence[Case], seed: int) -> list[str]:
    drawn = sorted(cases, key=lambda case: hashlib.blake2b(f"{seed}/{case.name}".encode()).digest())
    rank: dict[str, int] = {}
    seen: dict[str, int] = {}
    for case in drawn:
        rank[case.name] = seen.get(case.scenario, 0)
        seen[case.scenario] = rank[case.name] + 1
    return sorted(rank, key=lambda name: rank[name])


# Some combinations are no case: their places are not free.
def _first_that_fly(subject: StudyTarget, lot: Sequence[str], *, n: int) -> list[str]:
    once = Setting(name=subject.entry.name, parameters={})
    n_tried = n
    while True:
        some = lot[:n_tried]
        loaded = restrict_cases(subject.loaded, some)
        try:
            plan = build_plan(build_setting_suite(replace(subject, loaded=loaded), [once], name="cases"))
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


class ReusablePool:
    """A pool that outlives the runs that use it, so that workers start once; `end` ends them."""

    def __init__(self, start: Callable[[], Pool]) -> None:
        """Take what starts the workers; it is called at the first run that flies."""
        self._start = start
        self._pool: Pool | None = None

    def lent(self) -> "ReusablePool":
        """Return the pool with its workers started."""
        if self._pool is None:
            self._pool = self._start()
        return self

    def end(self) -> None:
        """End all workers."""
        if self._pool is not None:
            self._pool.close()
            self._pool = None

    @property
    def n_workers(self) -> int:
        """See `Pool`."""
        return self._lent.n_workers

    @property
    def peak_mb(self) -> float:
        """See `Pool`."""
        return self._lent.peak_mb

    @property
    def reference_loops_s(self) -> list[float]:
        """See `Pool`."""
        return self._lent.reference_loops_s

    def submit(self, job: Job) -> None:
        """Take a job; see `Pool`."""
        self._lent.submit(job)

    def wait(self, timeout_s: float) -> list[JobResult]:
        """Return the jobs that have ended; see `Pool`."""
        return self._lent.wait(timeout_s)

    def close(self) -> None:
        """Do nothing: another run may follow."""

    @property
    def _lent(self) -> Pool:
        assert self._pool is not None, "a run that flies has asked for its workers"
        return self._pool


class SettingRunner:
    """Runs settings of an evaluation plan into a folder; runs that are there are not repeated."""

    def __init__(
        self, evaluation: EvaluationPlan, folder: ResultsFolder, pool: ReusablePool, report: Callable[[Progress], None]
    ) -> None:
        """Take an evaluation plan, the folder of its rows, the workers, and the receiver of progress."""
        self.evaluation = evaluation
        self._folder = folder
        self._pool = pool
        self._report = report
        self._plan: Plan | None = None
        self._rows = {row["trial"]: row for row in folder.rows()}
        self.n_flown_now = 0

    def fly(self, settings: Sequence[Setting]) -> dict[str, list[Row]]:
        """Return the rows of each setting by its name, flying what is missing.

        Raises:
            KeyboardInterrupt: it was interrupted; what was run is kept.
            GslCosimError: see `SuiteRun.fly`.
        """
        self._plan = self.evaluation.plan(settings, after=self._plan)
        names = {setting.name for setting in settings}
        wanted = [trial for trial in self._plan.trials if trial.entry in names]
        if any(trial.id not in self._rows for trial in wanted):
            self._run(self._plan)
        found: dict[str, list[Row]] = {setting.name: [] for setting in settings}
        for trial in wanted:
            found[trial.entry].append(self._rows[trial.id])
        return found

    def finish(self) -> None:
        """Leave whole tables, also where a call before this one was killed after its last run."""
        if self._plan is not None and self._folder.journal.is_file():
            self._run(self._plan)

    def _run(self, plan: Plan) -> None:
        summary = SuiteRun(plan, self._folder, self._pool.lent, selection=Selection(), report=self._report).fly()
        self.n_flown_now += summary.n_flown
        if summary.is_interrupted:
            raise KeyboardInterrupt
        self._rows = {row["trial"]: row for row in self._folder.rows()}
