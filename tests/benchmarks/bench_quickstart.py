"""Speed and start of the quickstart by how it is run, in turns: processes, sandboxes, a viewer, and ways of starting.

`python tests/benchmarks/bench_quickstart.py --only separate landlock --n 5`. Each row is beside the first: the ratio of
speeds, and how much later the first tick comes. Below are the microseconds a tick of each participant. Each way but the
first adds or leaves out one thing:

    one         one process
    grouped     services share a process
    served      a viewer of live data is beside the run, and nobody looks closely
    bubblewrap  the agent is in this sandbox, as in the next row
    landlock
    forked      services are forks that import for themselves what they alone need
    spawned     each service is a new Python
"""

# ruff: noqa: T201 - this is a script

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
from typing import Any

from gslcosim.runtime.processes.sandbox.selection import unavailable_reason

# Runs last as long as their limit.
RUN = ("up", "warehouse_empty", "--json", "--set", "referee.success.within_m=0.001")
WORDS = {
    "separate": (),
    "one": ("--in-process",),
    "grouped": ("--processes", "grouped"),
    "served": ("--serve",),
    "bubblewrap": ("--set", "agents[0].sandbox=bubblewrap"),
    "landlock": ("--set", "agents[0].sandbox=landlock"),
    "forked": (),
    "spawned": (),
}
# These leave a part of the product out, in the command and in its fork server.
CHANGES = {
    "spawned": "fork_server.ForkServer.is_possible = staticmethod(lambda: False)",
    "forked": """
serve = "import sys; from dataclasses import replace; from gslcosim.runtime.processes import fork_server; "
serve += "from gslcosim.runtime.distributed.service_main import build_fork_work; "
serve += "fork_server.serve_forks(int(sys.argv[1]), replace(build_fork_work(), early={}))"
fork_server.build_python_command = lambda *words: [sys.executable, "-P", "-c", serve, *words[-2:]]
""",
}
PROGRAM = """
import sys
from gslcosim.runtime.processes import fork_server
{change}
from gslcosim.__main__ import main
sys.exit(main())
"""
TASKS = ("stepping", "encoding", "receiving", "waiting")


def run_once(way: str, runs_dir: str, limit_s: float) -> dict[str, Any]:
    """Run the quickstart and return its result; a viewer is closed once it has been given everything."""
    python = ["-c", PROGRAM.format(change=CHANGES[way])] if way in CHANGES else ["-m", "gslcosim"]
    words = ["--set", "agents[0].sandbox=none"] if "sandbox" not in " ".join(WORDS[way]) else []
    words += ["--runs-dir", runs_dir, "--set", f"referee.stop.time_limit_s={limit_s}", *WORDS[way]]
    call = [sys.executable, *python, *RUN, *words]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    notes = []
    for line in process.stderr:
        notes.append(line)
        if "stays open" in line:
            process.send_signal(signal.SIGINT)
    text = process.communicate()[0]
    if not text.startswith("{") or not json.loads(text)["valid"]:
        sys.exit(f"{way}: expected a valid run, was:\n{text}{''.join(notes)}")
    return json.loads(text)


def main() -> None:
    """Run in turns and print medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=3, help="rounds (default: 3)")
    parser.add_argument("--only", nargs="+", default=list(WORDS), choices=list(WORDS), help="ways to run it")
    parser.add_argument("--limit-s", type=float, default=300.0, help="simulated time of a run (default: 300 s)")
    options = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    lacks = {way: unavailable_reason(way) for way in ("bubblewrap", "landlock")}
    ways = [way for way in options.only if not lacks.get(way)]
    results: dict[str, list[dict[str, Any]]] = {way: [] for way in ways}
    with tempfile.TemporaryDirectory() as runs_dir:
        run_once(ways[0], runs_dir, 20.0)  # fills the caches
        for i in range(options.n):
            # Each is the first as often as the others.
            for way in (*ways[i % len(ways) :], *ways[: i % len(ways)]):
                results[way].append(run_once(way, runs_dir, options.limit_s))
    print(f"quickstart, {os.cpu_count()} cores, medians of {options.n} rounds in turns")
    print(f"{'':12}{'x real time':>12}{'ratio':>8}{'first tick [s]':>16}{'later [ms]':>12}  all speeds")
    medians = {
        way: [statistics.median(run[key] for run in runs) for key in ("real_time_factor", "start_up_s")]
        for way, runs in results.items()
    }
    first_speed, first_start_s = medians[ways[0]]
    for way, (speed, start_s) in medians.items():
        later_ms = 1000 * (start_s - first_start_s)
        speeds = " ".join(f"{run['real_time_factor']:.0f}" for run in results[way])
        print(f"{way:12}{speed:12.0f}{speed / first_speed:8.2f}{start_s:16.2f}{later_ms:+12.0f}  {speeds}")
    for way, runs in results.items():
        print(f"\n{f'{way} [us]':18}" + "".join(f"{task:>12}" for task in TASKS))
        for name, timing in max(runs, key=lambda run: run["real_time_factor"])["timing_us_per_tick"].items():
            print(f"  {name:16}" + "".join(f"{timing.get(task, 0.0):12.1f}" for task in TASKS))
    digests = {run["digest"] for runs in results.values() for run in runs}
    print(f"\ndigests: {len(digests)} different ({', '.join(sorted(digests))})")


if __name__ == "__main__":
    main()
