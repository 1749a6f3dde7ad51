"""Runner of studies: trials of a plan that grows, in one folder of results, by workers that serve all of a study."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gslcosim_bench.cases.models import Selection, Trial
from gslcosim_bench.cases.plan import Plan
from gslcosim_bench.execution.pool import Pool
from gslcosim_bench.execution.runner import Progress, StaleRows, SuiteRun
from gslcosim_bench.store import ResultsFolder

Row = Mapping[str, Any]


class StudyRunner:
    """Runs trials into a folder; trials whose rows are there are not repeated.

    A study draws its trials by its seed and begins at the first one in each call, so that an interrupted call resumes
    where it stopped and ends as if it had not been interrupted.

    Attributes:
        plan: All trials so far; None before the first.
        n_flown_now: Trials that this runner has run, without those that were there.
    """

    def __init__(
        self,
        folder: ResultsFolder,
        start_pool: Callable[[], Pool],
        *,
        report: Callable[[Progress], None],
        confirm_put_aside: Callable[[StaleRows], bool],
    ) -> None:
        """Read the rows of a folder.

        Args:
            start_pool: Such as a `SharedPool`: the workers are not ended here.
            confirm_put_aside: As of `SuiteRun`.
        """
        self.plan: Plan | None = None
        self.n_flown_now = 0
        self._folder = folder
        self._start_pool = start_pool
        self._report = report
        self._confirm_put_aside = confirm_put_aside
        self._rows = {row["trial"]: row for row in folder.rows()}

    def run(self, plan: Plan, wanted: Sequence[Trial]) -> list[Row]:
        """Return the rows of some trials of a plan, which holds those of all plans before; run what is missing."""
        self.plan = plan
        if any(trial.id not in self._rows for trial in wanted):
            self._run_plan(plan)
        return [self._rows[trial.id] for trial in wanted]

    def finish(self) -> None:
        """Leave whole tables, also where a call before this one was killed after its last trial."""
        if self.plan is not None and self._folder.journal.is_file():
            self._run_plan(self.plan)

    def _run_plan(self, plan: Plan) -> None:
        summary = SuiteRun(
            plan, self._folder, self._start_pool, selection=Selection(), keeps_pool=True, report=self._report,
            confirm_put_aside=self._confirm_put_aside,
        ).fly()  # fmt: skip
        self.n_flown_now += summary.n_flown
        if summary.is_interrupted:
            raise KeyboardInterrupt
        self._rows = {row["trial"]: row for row in self._folder.rows()}


class SharedPool:
    """One pool for all of a study: called, it starts the pool the first time; as a context, it closes it at the end."""

    def __init__(self, start_pool: Callable[[], Pool]) -> None:
        """Take what starts the pool, which is not called where there is nothing to run."""
        self._start_pool = start_pool
        self._pool: Pool | None = None

    def __call__(self) -> Pool:
        """Return the pool."""
        if self._pool is None:
            self._pool = self._start_pool()
        return self._pool

    def __enter__(self) -> "SharedPool":
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the pool if it was started."""
        if self._pool is not None:
            self._pool.close()
