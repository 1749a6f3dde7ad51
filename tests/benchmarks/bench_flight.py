"""Print how fast the quickstart flies, in many processes and in one, and where the time goes.

Run with `make bench`, or `python tests/benchmarks/bench_flight.py [SCENARIO] [N_RUNS]`.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def fly(scenario: str, runs_dir: str, *arguments: str) -> dict[str, Any]:
    """Fly once and return the result."""
    call = [sys.executable, "-m", "gslcosim", "up", scenario, "--json", "--runs-dir", runs_dir, *arguments]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    if not done.stdout.startswith("{"):
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def loop_s() -> float:
    """Return the processor's time of a plain loop: how fast the machine is today."""
    started = time.process_time()
    total = 0
    for i in range(5_000_000):
        total += i & 7
    return time.process_time() - started


def show_ratios(rounds: list[tuple[dict[str, Any], dict[str, Any], float]]) -> None:
    """Print what carries over to other machines: medians of ratios within a round, and a plain loop."""
    speed = statistics.median(many["real_time_factor"] / one["real_time_factor"] for many, one, _ in rounds)
    start = statistics.median(many["start_up_s"] / many["flight_wall_s"] for many, _, _ in rounds)
    print(f"  many processes / one, speed                    {speed:8.2f}")  # noqa: T201
    print(f"  many processes, first tick / flight            {start:8.2f}")  # noqa: T201
    print(f"  a plain loop [s]                               {statistics.median(r[2] for r in rounds):8.3f}")  # noqa: T201


def show(title: str, results: list[dict[str, Any]]) -> None:
    """Print the best of several runs, and where its time went."""
    best = max(results, key=lambda result: result["real_time_factor"])
    factors = ", ".join(f"{result['real_time_factor']:g}" for result in results)
    print(f"\n{title}: {best['real_time_factor']:g} x real time (all runs: {factors})")  # noqa: T201
    print(  # noqa: T201
        f"  {best['sim_time_s']:g} s simulated in {best['flight_wall_s']:g} s; first tick after "
        f"{best['start_up_s']:g} s; whole command {best['wall_time_s']:g} s; {best['resends']} resends"
    )
    print(f"  {'us per tick':12}{'stepping':>10}{'encoding':>10}{'receiving':>11}{'waiting':>10}")  # noqa: T201
    for name, timing in best["timing_us_per_tick"].items():
        columns = [timing.get(kind, 0.0) for kind in ("stepping", "encoding", "receiving", "waiting")]
        print(f"  {name:12}{columns[0]:10.1f}{columns[1]:10.1f}{columns[2]:11.1f}{columns[3]:10.1f}")  # noqa: T201


def main() -> None:
    """Fly in both ways and print the figures."""
    scenario = sys.argv[1] if len(sys.argv) > 1 else str(ROOT / "scenarios" / "warehouse_empty.yaml")
    n_runs = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    with tempfile.TemporaryDirectory() as runs_dir:
        fly(scenario, runs_dir, "--in-process")  # fills the caches
        print(f"{Path(scenario).stem}, recording on, {os.cpu_count()} cores, {n_runs} rounds in turns")  # noqa: T201
        rounds = [(fly(scenario, runs_dir), fly(scenario, runs_dir, "--in-process"), loop_s()) for _ in range(n_runs)]
        multi, single = [first for first, _, _ in rounds], [second for _, second, _ in rounds]
        show_ratios(rounds)
        show("independent processes over Zenoh", multi)
        show("one process", single)
        digests = {result["digest"] for result in multi + single}
        print(f"\ndigests: {len(digests)} different ({', '.join(sorted(digests))})")  # noqa: T201


if __name__ == "__main__":
    main()
