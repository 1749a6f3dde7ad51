"""Runner of studies: trials of a plan that grows, in one folder of results, by workers that serve all of a study."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from gslcosim_bench.cases.models import Selection, Trial
from gslcosim_bench.cases.plan import Plan
from gslcosim_bench.execution.pool import Pool
from gslcosim_bench.execution.runner import Progress, StaleRows, SuiteRun
from gslcosim_bench.store import ResultsFolder

Row = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class StudyHost:
    """Workers of a study, and receivers of its progress.

    Attributes:
        start_pool: Starts the workers; not called when there is nothing to run.
        report: Receives the progress of a batch.
        confirm_put_aside: As of `SuiteRun`.
    """

    start_pool: Callable[[], Pool]
    report: Callable[[Progress], None] = lambda _: None
    confirm_put_aside: Callable[[StaleRows], bool] = lambda _: True

    @contextmanager
    def sharing_pool(self) -> "Generator[StudyHost]":
        """Give a host with one pool for all of a study: started at the first need, closed at the end."""
        pools: list[Pool] = []

        def start() -> Pool:
            if not pools:
                pools.append(self.start_pool())
            return pools[0]

        try:
            yield replace(self, start_pool=start)
        finally:
            for pool in pools:
                pool.close()


class StudyRunner:
    """Runs trials into a folder; trials whose rows are there are not repeated.

    A study draws its trials by its seed and begins at the first one in each call, so that an interrupted call resumes
    where it stopped and ends as if it had not been interrupted.

    Attributes:
        plan: All trials so far; None before the first.
        n_flown_now: Trials that this runner has run, without those that were there.
    """

    def __init__(self, folder: ResultsFolder, host: StudyHost) -> None:
        """Read the rows of a folder."""
        self.plan: Plan | None = None
        self.n_flown_now = 0
        self._folder = folder
        self._host = host
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
            plan, self._folder, self._host.start_pool, selection=Selection(), keeps_pool=True, report=self._host.report,
            confirm_put_aside=self._host.confirm_put_aside,
        ).fly()  # fmt: skip
        self.n_flown_now += summary.n_flown
        if summary.is_interrupted:
            raise KeyboardInterrupt
        self._rows = {row["trial"]: row for row in self._folder.rows()}
