"""Print how soon a run begins, with and without a warm server, in turns.

Run `python tests/benchmarks/bench_start.py [N]`. The first tick is when the command says that it flies, counted from
the command; the end is that of a run of one tick. A server is started for it, and ended.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time

COMMAND = [sys.executable, "-m", "gslcosim"]
FLIGHT = ["up", "warehouse_empty", "--set", "referee.stop.time_limit_s=0.1"]
STARTS: dict[str, list[str]] = {"cold": [], "warm": ["--warm"]}


def begin(runs_dir, arguments):
    """Fly one tick; return when it was run, when the command ended [s], and the processor's time of the command."""
    began = time.perf_counter()
    call = [*COMMAND, *FLIGHT, "--runs-dir", runs_dir, *arguments]
    process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    first_tick_s = float("nan")
    for line in process.stderr:
        if "flying" in line:
            first_tick_s = time.perf_counter() - began
    process.stderr.close()
    _, _, usage = os.wait4(process.pid, 0)
    return first_tick_s, time.perf_counter() - began, usage.ru_utime + usage.ru_stime


def main():
    """Fly in turns and print medians."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    rounds = {start: [] for start in STARTS}
    with tempfile.TemporaryDirectory() as place:
        os.environ["TMPDIR"] = place
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        began = time.perf_counter()
        server = subprocess.Popen([*COMMAND, "serve"], stdout=subprocess.PIPE, text=True)
        try:
            if not server.stdout.readline():
                sys.exit("bench_start: expected a server, it has ended.")
            ready_s = time.perf_counter() - began
            for i in range(n + 1):
                for start, arguments in STARTS.items():
                    taken = begin(place, arguments)
                    if i:  # the first fills the caches
                        rounds[start].append(taken)
        finally:
            server.terminate()
            server.wait()
    cold, warm = ([statistics.median(column) for column in zip(*rounds[start], strict=True)] for start in STARTS)
    print(f"start of the quickstart, {os.cpu_count()} cores, medians of {n} rounds in turns")  # noqa: T201
    print(f"{'':28}{'warm / cold':>12}{'cold':>10}{'warm':>10}")  # noqa: T201
    titles = ("first tick [s]", "end of a run of one tick [s]", "processor time of command [s]")
    for title, before, now in zip(titles, cold, warm, strict=True):
        print(f"{title:28}{now / before:12.2f}{before:10.2f}{now:10.2f}")  # noqa: T201
    print(f"the server was ready after {ready_s:.2f} s")  # noqa: T201


if __name__ == "__main__":
    main()
