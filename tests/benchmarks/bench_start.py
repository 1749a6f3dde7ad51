"""Print how soon a run of several processes begins, by how its processes are started, in turns.

Run `python tests/benchmarks/bench_start.py [N]`. The first tick is when the command says that it flies, counted from
the command; the end is that of a run of one tick. Each way to start adds one thing to the way before it:

    spawned   each service is a new Python
    forked    services are forks of a server that has imported what they share
    preforked and those that import for long were forked first, and have imported it already
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time

COMMAND = [sys.executable, "-m", "gslcosim"]
FLIGHT = ["up", "warehouse_empty", "--set", "referee.stop.time_limit_s=0.1"]
# The first two leave a part of the product out, in the command and in its fork server.
SPAWNED = """
import sys
from gslcosim.runtime.processes import fork_server
fork_server.ForkServer.is_possible = staticmethod(lambda: False)
from gslcosim.__main__ import main
sys.exit(main())
"""
FORKED = """
import sys
from gslcosim.runtime.processes import fork_server
serve = "import sys; from dataclasses import replace; from gslcosim.runtime.processes import fork_server; "
serve += "from gslcosim.runtime.distributed.service_main import build_fork_work; "
serve += "fork_server.serve_forks(int(sys.argv[1]), replace(build_fork_work(), early={}))"
fork_server.build_python_command = lambda *words: [sys.executable, "-P", "-c", serve, *words[-2:]]
from gslcosim.__main__ import main
sys.exit(main())
"""
STARTS: dict[str, list[str]] = {
    "spawned": [sys.executable, "-c", SPAWNED, *FLIGHT],
    "forked": [sys.executable, "-c", FORKED, *FLIGHT],
    "preforked": [*COMMAND, *FLIGHT],
}
TITLES = ("first tick [s]", "end of a run of one tick [s]", "processor time of command [s]")


def begin(runs_dir, call):
    """Fly one tick; return when it was run, when the command ended [s], and the processor's time of the command."""
    began = time.perf_counter()
    call = [*call, "--runs-dir", runs_dir]
    process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    first_tick_s = float("nan")
    lines = []
    for line in process.stderr:
        lines.append(line)
        if "flying" in line:
            first_tick_s = time.perf_counter() - began
    process.stderr.close()
    _, _, usage = os.wait4(process.pid, 0)
    if first_tick_s != first_tick_s:
        sys.exit(f"bench_start: expected a run that begins, {call} did not:\n{''.join(lines)}")
    return first_tick_s, time.perf_counter() - began, usage.ru_utime + usage.ru_stime


def main():
    """Fly in turns and print medians."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    rounds = {start: [] for start in STARTS}
    with tempfile.TemporaryDirectory() as place:
        os.environ["TMPDIR"] = place
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        for i in range(n + 1):
            for start, call in STARTS.items():
                taken = begin(place, call)
                if i:  # the first fills the caches
                    rounds[start].append(taken)
    medians = {start: [statistics.median(column) for column in zip(*rounds[start], strict=True)] for start in STARTS}
    print(f"start of the quickstart, {os.cpu_count()} cores, medians of {n} rounds in turns")  # noqa: T201
    print(f"{'':32}" + "".join(f"{start:>12}" for start in STARTS))  # noqa: T201
    for i, title in enumerate(TITLES):
        print(f"{title:32}" + "".join(f"{medians[start][i]:12.2f}" for start in STARTS))  # noqa: T201
    ratios = [1.0] + [now[0] / before[0] for before, now in zip(list(medians.values()), list(medians.values())[1:])]
    print(f"{'first tick, of the way before':32}" + "".join(f"{ratio:12.2f}" for ratio in ratios))  # noqa: T201


if __name__ == "__main__":
    main()
