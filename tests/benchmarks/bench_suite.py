"""What a suite costs: time per trial and its parts, how busy the workers are, and whether their memory stays flat.

    python tests/benchmarks/bench_suite.py                    # 500 short runs by one worker, then by all cores
    python tests/benchmarks/bench_suite.py --suite gsl_bench_2023 --only repetition=0

Times are given beside a loop of plain Python that is run between the runs, so that machines can be compared.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from gslcosim_bench import Results
from gslcosim_bench.cases import build_plan, load_suite
from gslcosim_bench.cases.models import Selection
from gslcosim_bench.execution.pool import LocalPool
from gslcosim_bench.execution.runner import Progress, SuiteRun
from gslcosim_bench.store import ResultsFolder

SHORT_FLIGHTS = """
schema: gslcosim/suite/1
name: short_flights
scenarios: [tiny_room]
set: {gas.tape: true}
repetitions: 167
gas_seeds: 1
entries: [{name: dung_beetle, start: {python: dung_beetle}}]
"""
PARTS = ("preparing", "starting", "flying", "judging", "storing")


class Memory:
    """What each worker has for itself, looked at whenever the run reports."""

    def __init__(self) -> None:
        self.samples_mb: list[tuple[int, float]] = []

    def look(self, progress: Progress) -> None:
        """Take a sample of the largest worker."""
        if progress.phase != "trials":
            return
        workers = psutil.Process().children()
        sizes = [(info.rss - info.shared) / 1e6 for info in (worker.memory_info() for worker in workers)]
        self.samples_mb.append((progress.done, max(sizes, default=0.0)))

    def after(self, share: float, total: int) -> float:
        """Return the largest worker's memory when so much of the runs was over [MB]."""
        return next((size for done, size in self.samples_mb if done >= share * total), self.samples_mb[-1][1])


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", help="a suite instead of the short flights")
    parser.add_argument("--only", action="append", default=[], help="as bench run --only")
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, psutil.cpu_count(logical=False) or 1])
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gslcosim-bench-suite-") as scratch:
        suite = arguments.suite or Path(scratch) / "suite.yaml"
        if arguments.suite is None:
            Path(suite).write_text(SHORT_FLIGHTS)
        for n_jobs in arguments.jobs:
            tell(n_jobs, *flown(suite, Path(scratch) / f"results_{n_jobs}", n_jobs, arguments.only))


def flown(
    suite: str | Path, folder: Path, n_jobs: int, only: list[str]
) -> tuple[Results, dict[str, Any], Memory, float]:
    """Fly a suite and return its rows, its wall times, the workers' memory and the whole time [s]."""
    loaded = load_suite(suite)
    memory, began = Memory(), time.perf_counter()
    summary = SuiteRun(
        build_plan(loaded),
        ResultsFolder(folder),
        lambda: LocalPool(n_jobs, loaded.suite.limits),
        selection=Selection.of(only),
        report=memory.look,
    ).fly()
    return Results.load(folder), summary.wall, memory, time.perf_counter() - began


def tell(n_jobs: int, results: Results, wall: dict[str, Any], memory: Memory, total_s: float) -> None:
    """Print the figures of a run."""
    n, loop_s = len(results), wall["reference_loop_s"]
    parts = {part: float(np.nansum(results.array(f"wall_{part}_s"))) / n for part in PARTS}
    parts_text = ", ".join(f"{part} {1000 * taken_s:.1f} ms" for part, taken_s in parts.items())
    lines = [
        f"{n_jobs} workers, {n} flights, {results.array('end_s').sum():.0f} s simulated: {total_s:.0f} s in all, "
        f"preparing {wall['preparing_s']:.0f} s",
        f"  a flight: {parts_text}",
        f"  busy {100 * wall['busy_share']:.0f} % of the time after preparation, "
        f"flying {100 * wall['flying_share']:.0f} %",
        f"  a flight costs {sum(parts.values()) / loop_s:.1f} times a loop of plain Python ({1000 * loop_s:.1f} ms)",
        f"  memory of the largest worker: {memory.after(0.1, n):.0f} MB after a tenth of the flights, "
        f"{memory.after(0.999, n):.0f} MB at the end; at most {wall['peak_worker_mb']:.0f} MB with its agents",
    ]
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
