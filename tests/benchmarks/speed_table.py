"""Print the table of speed beside its goals: each figure is a ratio of two things measured in turns in this run.

    make bench-table
    make bench-nightly
    python tests/benchmarks/speed_table.py --all --n 3 --json
    python tests/benchmarks/speed_table.py --only "grouped" "bare hop"

What other programs took of the processors is printed beside each row. Rows "of BASE" fly the commit `--base`, which is
0.1.0 unless told otherwise. A row that this machine cannot measure says what it lacks. Without `--all` there are the
rows that matter most, in a few minutes; `--save` appends the medians to speed_history.jsonl, and `--compare` fails
where one is worse than in the last entries there.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import bench_against as against
import bench_peers as peers
import speed_history as history
import yaml

FOLDER = Path(__file__).resolve().parent
BLIND, ONE, QUIET, GROUPED = against.BLIND, against.ONE, against.QUIET, against.GROUPED
TAPE = ["--set", "gas.tape=true"]
N_AGENTS = 30
N_CPU_TIMES = 3
LIMITS = {"at least": lambda value, goal: value >= goal, "at most": lambda value, goal: value <= goal}


def place_of(i: int) -> dict[str, object]:
    """Return where one of thirty vehicles starts and searches, so that nearly all fly on to the end."""
    start_m = [1.5 + 2 * (i % 6), 2.0 + 2.4 * (i // 6), 0.2]
    return {"start_m": start_m, "search_height_m": round(0.8 + 0.22 * i, 2), "separation_m": 0.8}


@dataclass
class Bench:
    """Means of the rows: today's code, the base's where a row asks for it, and a folder for runs."""

    today: against.Code
    runs_dir: str
    base_commit: str
    stack: ExitStack
    peers_python: Path
    _base: list[against.Code] = field(default_factory=list)

    @property
    def base(self) -> against.Code:
        """The base, checked out and flown once when it is asked for first."""
        if not self._base:
            self._base.append(self.stack.enter_context(against.base_code(self.base_commit)))
            against.fly(self.base, self.runs_dir, [*ONE, *against.until(against.SHORT_S)])
        return self._base[0]

    def speed(self, arguments: list[str], code: against.Code | None = None, *, limit_s: int = against.LONG_S) -> float:
        """Return how many times real time the quickstart takes, start left out."""
        return against.fly(code or self.today, self.runs_dir, [*BLIND, *arguments, *against.until(limit_s)]).speed

    def cpu_us(self, arguments: list[str], code: against.Code | None = None) -> float:
        """Return what a tick costs of the processors [us], start left out: the least of three, as others only add."""
        flying = (code or self.today, self.runs_dir, [*BLIND, *arguments])
        return min(against.cpu_us_a_tick(*flying)[0] for _ in range(N_CPU_TIMES))

    def swarm(self) -> str:
        """Return a scenario as the quickstart, with thirty of its agents."""
        found = Path(self.runs_dir) / "thirty.yaml"
        if not found.exists():
            tree = yaml.safe_load((FOLDER.parents[1] / "scenarios" / f"{against.SCENARIO}.yaml").read_text())
            (agent,) = tree["agents"]
            tree["agents"] = [
                {**agent, "name": f"beetle_{i}", "vehicle": {**agent["vehicle"], **place_of(i)}}
                for i in range(N_AGENTS)
            ]
            found.write_text(yaml.safe_dump(tree))
            against.fly(self.today, self.runs_dir, [*ONE, *against.until(against.SHORT_S)], str(found))
        return str(found)


def separate_over_one(bench: Bench) -> float:
    return bench.speed([]) / bench.speed(ONE)


def grouped_over_better(bench: Bench) -> float:
    return bench.speed(GROUPED) / max(bench.speed([]), bench.speed(ONE))


def ring(shape: str) -> Callable[[Bench], float | str]:
    def measure(bench: Bench) -> float | str:
        if not bench.peers_python.exists():
            return "HELICS: make .venv-peers/ready"
        own, ipc = (
            next(contestant for contestant in peers.CONTESTANTS if contestant.name == name)
            for name in (peers.OWN, "helics-ipc")
        )
        return peers.measured(own, bench.peers_python, shape, 2000) / peers.measured(
            ipc, bench.peers_python, shape, 2000
        )

    return measure


def bare_hop(bench: Bench) -> float:
    call = [bench.today.python, FOLDER / "peers" / "bare_hop.py", "--rounds", "1"]
    hop = json.loads(subprocess.run(call, check=True, capture_output=True, text=True).stdout)
    return hop["bus_us"][0] / hop["datagram_us"][0]


# Prints the processors' time of all steps in one process, all threads; opening and closing of files are left out.
FLIGHT = """
import json, sys, time
from gslcosim.runtime.stepper import StepLoop
times_s = []
step = StepLoop.step
def timed(self):
    times_s[:] = times_s or [time.process_time()]
    try:
        return step(self)
    finally:
        times_s[1:] = [time.process_time()]
StepLoop.step = timed
from gslcosim.__main__ import main
main()
print("\\n" + json.dumps(times_s[1] - times_s[0]), file=sys.stderr)
"""


def flight_cpu_s(bench: Bench, arguments: list[str], scenario: str) -> float:
    """Return the processors' time of all steps [s]: the least of three, as others only add."""
    words = ["up", scenario, "--quiet", "--runs-dir", bench.runs_dir, *ONE, *BLIND, *arguments]
    call = [bench.today.python, "-c", FLIGHT, *words, *against.until(against.LONG_S)]
    flights = [
        subprocess.run(call, check=False, capture_output=True, text=True, cwd=bench.runs_dir)
        for _ in range(N_CPU_TIMES)
    ]
    return min(float(flight.stderr.split()[-1]) for flight in flights)


def recorder_share(n_agents: int) -> Callable[[Bench], float]:
    def measure(bench: Bench) -> float:
        scenario = against.SCENARIO if n_agents == 1 else bench.swarm()
        return 100 * (flight_cpu_s(bench, [], scenario) / flight_cpu_s(bench, QUIET, scenario) - 1)

    return measure


def first_tick(bench: Bench) -> float:
    with_it = against.first_tick_s(bench.today, bench.runs_dir, ONE)
    return with_it / against.first_tick_s(bench.today, bench.runs_dir, [*ONE, *QUIET])


def thirty_over_one(bench: Bench) -> float:
    return flight_cpu_s(bench, QUIET, bench.swarm()) / flight_cpu_s(bench, QUIET, against.SCENARIO)


def lockstep(bench: Bench) -> float:
    words = ["--set", "agents[0].mode=lockstep"]
    own, base = (bench.speed(words, code, limit_s=against.SHORT_S) for code in (bench.today, bench.base))
    return own / base


def tape(bench: Bench) -> float:
    return bench.cpu_us([*ONE, *QUIET, *TAPE]) / bench.cpu_us(ONE, code=bench.base)


def memory_mb(bench: Bench) -> float:
    return against.footprint(bench.today, bench.runs_dir).memory_mb


# The share of the fields' steps in the time of a flight in one process.
FIELDS = """
import json, sys, time
from gslcosim_services.fields.core import FieldsCore
taken_s = 0.0
step = FieldsCore.step
def timed(self, tick, inbox):
    global taken_s
    began = time.perf_counter()
    try:
        return step(self, tick, inbox)
    finally:
        taken_s += time.perf_counter() - began
FieldsCore.step = timed
from gslcosim.__main__ import main
main()
print("\\n" + json.dumps(taken_s), file=sys.stderr)
"""


def fields_share(bench: Bench) -> float:
    words = ["up", against.SCENARIO, "--json", "--quiet", "--runs-dir", bench.runs_dir, *ONE, *QUIET, *BLIND]
    call = [bench.today.python, "-c", FIELDS, *words, *against.until(against.LONG_S)]
    done = subprocess.run(call, check=False, capture_output=True, text=True, cwd=bench.runs_dir)
    return 100 * float(done.stderr.split()[-1]) / json.loads(done.stdout)["flight_wall_s"]


REPORT = """
import json, resource, sys, time
from pathlib import Path
from gslcosim_bench.report.writer import write_report
began = time.process_time()
write_report(Path(sys.argv[1]))
peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps([time.process_time() - began, peak_kb / 1e6]))
"""
# In a process of its own, whose memory ends with it.
RESULTS = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
import synthetic
plan = synthetic.Plan(n_scenarios=6, n_families=3, repetitions=221, controls_frac=0.4, n_points=150)
synthetic.make_results(Path(sys.argv[1]), plan)
"""


def report(index: int) -> Callable[[Bench], float]:
    def measure(bench: Bench) -> float:
        folder = Path(bench.runs_dir) / "results"
        if not folder.exists():
            kit = FOLDER.parent / "kit"
            subprocess.run([bench.today.python, "-c", RESULTS, folder, kit], check=True)
        call = [bench.today.python, "-c", REPORT, folder]
        return json.loads(subprocess.run(call, check=True, capture_output=True, text=True).stdout)[index]

    return measure


# The default solve of a room that GSL-Bench publishes, as importing it poses it; GADEN marks the hull of the outlet.
WIND = """
import json, sys, time
import numpy as np
from gslcosim.flow import Inlet, Outlet, solve_wind_report
codes = np.ascontiguousarray(np.moveaxis(np.load(sys.argv[1]), 0, 2)).astype(np.uint8)
try:
    from gslcosim.environment.grid_kernels import find_air_cells
    is_air = find_air_cells(codes)
except ImportError:
    is_air = codes != 1
patches = [
    Inlet(min_m=(0, 0.2, 0), max_m=(0, 1.8, 2.6), velocity_m_s=(1, 0, 0)),
    Outlet(min_m=(15.4, 13.6, 0), max_m=(15.4, 15.4, 2.6)),
]
warm_up = [patches[0], Outlet(min_m=(4, 0.2, 0), max_m=(4, 1.8, 2.6))]
solve_wind_report(np.ones((20, 14, 14), bool), 0.2, warm_up, end_time_s=0.1)
began = time.process_time()
report = solve_wind_report(is_air, 0.2, patches, max_time_s=120.0)
print(json.dumps([time.process_time() - began, report.n_steps, str(report.settling)]))
"""


def imported_wind(bench: Bench) -> float | str:
    reference = Path(os.environ.get("GSLCOSIM_REFERENCE", FOLDER.parents[2] / "shared" / "reference"))
    grid = reference / "gsl-bench/environments/005/occupancy/wh_complex_005_grid.npy"
    if not grid.exists():
        return "GSL-Bench's room 005: set GSLCOSIM_REFERENCE"
    calls = [[code.python, "-c", WIND, grid] for code in (bench.today, bench.base)]
    # Where the checkout is not on the path of modules.
    printed = [subprocess.check_output(call, text=True, cwd=bench.runs_dir) for call in calls]
    today_s, base_s = (json.loads(text)[0] for text in printed)
    return today_s / base_s


@dataclass(frozen=True, kw_only=True)
class Row:
    """A figure of the table: what it is, its goal, and how one round of it is measured."""

    title: str
    goal: float
    bound: str = "at least"
    measure: Callable[[Bench], float | str]
    is_once: bool = False
    is_short: bool = True


ROWS = (
    Row(title="separate / one process, speed", goal=1.0, measure=separate_over_one),
    Row(title="grouped / the better of separate and one, speed", goal=1.0, measure=grouped_over_better, is_short=False),
    Row(title="closed loop / HELICS ipc, ticks/s", goal=1.0, measure=ring("closed")),
    Row(title="open loop / HELICS ipc, ticks/s", goal=4.0, measure=ring("open"), is_short=False),
    Row(title="bare hop between two services / unix datagram", goal=3.0, bound="at most", measure=bare_hop),
    Row(title="recorder in flight, 1 agent [% CPU]", goal=5.0, bound="at most", measure=recorder_share(1)),
    Row(
        title="recorder in flight, 30 agents [% CPU]",
        goal=10.0,
        bound="at most",
        measure=recorder_share(30),
        is_short=False,
    ),
    Row(title="first tick in one process, with / without recorder", goal=1.1, bound="at most", measure=first_tick),
    Row(title="CPU at 30 agents / at 1", goal=6.0, bound="at most", measure=thirty_over_one),
    Row(title="lockstep agent over processes, speed, of BASE", goal=2.0, measure=lockstep, is_short=False),
    Row(title="one process, tape, recorder off, CPU, of BASE", goal=0.45, bound="at most", measure=tape),
    Row(title="memory of all processes [MB]", goal=400.0, bound="at most", measure=memory_mb),
    Row(
        title="settled wind of an imported room (005), CPU, of BASE",
        goal=0.2,
        bound="at most",
        measure=imported_wind,
        is_once=True,
        is_short=False,
    ),
    Row(title="fields' share of a flight [%]", goal=25.0, bound="at most", measure=fields_share),
    Row(
        title="report at 100,000 rows, CPU [s]",
        goal=30.0,
        bound="at most",
        measure=report(0),
        is_once=True,
        is_short=False,
    ),
    Row(
        title="report at 100,000 rows, peak memory [GB]",
        goal=1.0,
        bound="at most",
        measure=report(1),
        is_once=True,
        is_short=False,
    ),
)


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A row and what was measured of it; `lacks` says why nothing was."""

    row: Row
    rounds: list[float]
    foreign_cores: float
    lacks: str = ""

    def line(self) -> str:
        """Return the row as a line of the table."""
        head = f"{self.row.title:52}{self.row.bound:>9} {self.row.goal:6g}"
        if not self.rounds:
            return f"{head}   not measured: {self.lacks}"
        value = statistics.median(self.rounds)
        verdict = "PASS" if LIMITS[self.row.bound](value, self.row.goal) else "MISS"
        spread = f"{min(self.rounds):.3g}-{max(self.rounds):.3g}"
        return f"{head}{value:9.3g}  {verdict}  {spread:>14}  load {self.foreign_cores:.2f}"

    def as_json(self) -> dict[str, object]:
        """Return all of it."""
        row = {"title": self.row.title, "goal": self.row.goal, "bound": self.row.bound, "lacks": self.lacks}
        return {**row, "rounds": self.rounds, "foreign_cores": self.foreign_cores}


def measured(row: Row, bench: Bench, n: int) -> Measured:
    """Return a row's rounds."""
    load, rounds = against.ForeignLoad(), []
    for _ in range(1 if row.is_once else n):
        try:
            found = row.measure(bench)
        except subprocess.CalledProcessError as error:
            found = f"a command ended with exit code {error.returncode}"
        if isinstance(found, str):
            return Measured(row=row, rounds=[], foreign_cores=load.take(), lacks=found)
        rounds.append(found)
    return Measured(row=row, rounds=rounds, foreign_cores=load.take())


def main() -> None:
    """Measure all rows, and print each as soon as it is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=peers.positive, default=3, help="rounds of each row (default 3)")
    parser.add_argument("--base", default="9693e5e", help="the commit of rows of BASE (default: 0.1.0)")
    parser.add_argument("--only", nargs="+", default=[], metavar="TEXT", help="rows whose title contains a text")
    parser.add_argument("--peers-python", type=Path, default=peers.PEERS_PYTHON, help="the Python that has HELICS")
    parser.add_argument("--all", action="store_true", help="all rows, also those that take long")
    parser.add_argument("--save", action="store_true", help="append the medians to speed_history.jsonl")
    parser.add_argument("--compare", action="store_true", help="fail where a median is worse than in the last entries")
    parser.add_argument("--json", action="store_true", help="print all rounds as JSON")
    options = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    rows = [row for row in ROWS if options.all or options.only or row.is_short]
    rows = [row for row in rows if not options.only or any(text in row.title for text in options.only)]
    results = []
    with ExitStack() as stack:
        runs_dir = stack.enter_context(tempfile.TemporaryDirectory())
        today = against.Code(name="today", python=Path(sys.executable), folder=against.ROOT)
        bench = Bench(today, runs_dir, options.base, stack, options.peers_python)
        for arguments in ([], ONE, GROUPED, [*ONE, *QUIET], [*ONE, *QUIET, *TAPE, *BLIND]):
            against.fly(today, runs_dir, [*arguments, *against.until(against.LONG_S)])  # fills the caches
        if not options.json:
            print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, medians of {options.n}")  # noqa: T201
            print(f"{'':52}{'goal':>16}{'today':>9}{'':6}{'lowest-highest':>16}  foreign cores")  # noqa: T201
        for row in rows:
            results.append(measured(row, bench, options.n))
            if not options.json:
                print(results[-1].line(), flush=True)  # noqa: T201
    if options.json:
        print(json.dumps([result.as_json() for result in results], indent=2))  # noqa: T201
    medians = {result.row.title: statistics.median(result.rounds) for result in results if result.rounds}
    worse = history.find_regressions(medians, {row.title: row.bound for row in rows}, history.load_entries())
    if options.save:
        load = max(result.foreign_cores for result in results)
        commit, processor = history.find_commit(), platform.processor() or platform.machine()
        history.save_entry(history.Entry(commit=commit, processor=processor, foreign_cores=load, medians=medians))
    if options.compare and worse:
        sys.exit("\n".join(worse))


if __name__ == "__main__":
    main()
