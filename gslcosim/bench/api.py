"""Run a suite from Python, as `gslcosim bench run` does."""

from collections.abc import Callable, Sequence
from pathlib import Path

from gslcosim.bench.cases.plan import build_plan
from gslcosim.bench.cases.suite_files import LoadedSuite, load_suite
from gslcosim.bench.execution.pool import LocalPool, n_cores
from gslcosim.bench.execution.runner import Progress, SuiteRun
from gslcosim.bench.execution.sandbox_requirement import check_sandbox
from gslcosim.bench.execution.selection import Selection
from gslcosim.bench.results import Results
from gslcosim.bench.store.folder import ResultsFolder


def run(
    suite: str | Path | LoadedSuite,
    folder: str | Path,
    *,
    jobs: int | None = None,
    only: Sequence[str] = (),
    report: Callable[[Progress], None] = lambda _: None,
) -> Results:
    """Fly what is missing of a suite, and return all rows that there are.

    Args:
        suite: A file, the name of a bundled suite, or what `load_suite` returns.
        folder: Where results go; the same call goes on where it stopped.
        jobs: How many worker processes; one for each core if absent.
        only: Which trials, as `--only` has it: `["entry=surge_*", "scenario=gsl_bench_3"]`.
        report: Receives progress reports.

    Raises:
        ScenarioError: the suite is wrong.
        UsageError: the folder cannot be used or written, or the suite demands a sandbox that is not here.
        KeyboardInterrupt: it was interrupted; what was run is kept.
    """
    loaded = suite if isinstance(suite, LoadedSuite) else load_suite(suite)
    n_workers = jobs or n_cores()
    plan = build_plan(loaded)
    check_sandbox(plan)
    summary = SuiteRun(
        plan,
        ResultsFolder(Path(folder)),
        lambda: LocalPool(n_workers, loaded.suite.limits),
        selection=Selection.of(only),
        report=report,
    ).fly()
    if summary.is_interrupted:
        raise KeyboardInterrupt
    return Results.load(folder)
