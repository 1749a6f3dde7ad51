"""Print today's speed beside that of another commit, as ratios within one run, interleaved.

Run with `make bench-against`, or `python tests/benchmarks/bench_against.py --base COMMIT [--n 5] [--json]`.
Rows that take minutes each come last and once: `--skip suite cold` leaves them out.
The other commit is checked out into a temporary folder and flies with the same packages, so that both meet the same
machine at the same time. The processor's time counts all processes of a run; what starting costs is left out of figures
"a tick", which come from the difference of a long and a short run.
What other programs took of the processors is printed beside each round. A round in which they took more than
`--max-foreign-cores` counts in no median.
"""

import argparse
import contextlib
import json
import math
import os
import re
import site
import statistics
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SCENARIO = "warehouse_empty"
SHORT_S, LONG_S = 20, 200
# An agent that never finds the source, so that runs last as long as their limit says.
SUITE, N_REPETITIONS = "gsl_bench_2023", 10
BLIND = ["--set", "referee.success.within_m=0.001"]
LOCKSTEP = [*BLIND, "--set", "agents[0].mode=lockstep"]
ONE = ["--in-process"]
QUIET = ["--set", "recording.enabled=false"]
ONE_TICK = ["--set", "referee.stop.time_limit_s=0.1"]
GROUPED = ["--processes", "grouped"]


@dataclass(frozen=True, kw_only=True)
class Code:
    """A version of gslcosim that can be run."""

    name: str
    python: Path
    folder: Path


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What one run took: processor's time of all its processes, and what `result.json` says."""

    cpu_s: float
    result: dict[str, Any]

    @property
    def speed(self) -> float:
        """Simulated time over wall time, start left out."""
        return self.result["sim_time_s"] / self.result["flight_wall_s"]


def note(text: str) -> None:
    """Print a line on how far the benchmark has come."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201


class ForeignLoad:
    """Load of the processors by other programs than this one and those it starts, since the last call.

    Children count when they have ended, so ask when all have.
    """

    def __init__(self) -> None:
        self._before = self._look()

    def take(self) -> float:
        """Return how many processors they kept busy on average since the last call, or since the start."""
        before, self._before = self._before, self._look()
        wall_s, busy_s, own_s = (now - then for now, then in zip(self._before, before, strict=True))
        return max(busy_s - own_s, 0.0) / wall_s

    @staticmethod
    def _look() -> tuple[float, float, float]:
        fields = [int(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
        idle = fields[3] + fields[4]
        own_s = sum(os.times()[:4])
        return time.monotonic(), (sum(fields) - idle) / os.sysconf("SC_CLK_TCK"), own_s


def supports(code: Code, *words: str) -> bool:
    """Return whether a call of gslcosim is understood by a version."""
    call = [code.python, "-m", "gslcosim", *words]
    return subprocess.run(call, cwd=code.folder, capture_output=True, check=False).returncode == 0


@contextlib.contextmanager
def base_code(commit: str) -> Iterator[Code]:
    """Check a commit out and install it beside the packages that are installed here."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "code"
        subprocess.run(
            ["git", "-C", ROOT, "worktree", "add", "--detach", folder, commit], check=True, capture_output=True
        )
        try:
            home = Path(temporary) / "venv"
            venv.create(home, with_pip=False)
            python = home / "bin" / "python"
            packages = next((home / "lib").glob("python*/site-packages"))
            (packages / "base.pth").write_text("\n".join(site.getsitepackages()))
            install = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
            ours = [folder, *(path.parent for path in sorted(folder.glob("extensions/*/pyproject.toml")))]
            subprocess.run([python, *install, *(word for each in ours for word in ("-e", str(each)))], check=True)
            yield Code(name=commit, python=python, folder=folder)
        finally:
            subprocess.run(["git", "-C", ROOT, "worktree", "remove", "--force", folder], check=True)


def fly(code: Code, runs_dir: str, arguments: list[str], scenario: str = SCENARIO) -> Flown:
    """Fly a scenario once, by default the quickstart."""
    call = [code.python, "-m", "gslcosim", "up", scenario, "--json", "--runs-dir", runs_dir, *arguments]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(call, stdout=output, stderr=errors, cwd=runs_dir, env=environment)
        _, _, usage = os.wait4(process.pid, 0)
        output.seek(0)
        errors.seek(0)
        text = output.read()
        if not text.startswith("{"):
            sys.exit(f"{code.name}: expected a flight with {arguments}, got:\n{errors.read()}")
    return Flown(cpu_s=usage.ru_utime + usage.ru_stime, result=json.loads(text))


@dataclass
class Footprint:
    """The most that all processes of a run have taken at one time."""

    memory_mb: float = math.nan
    n_threads: float = math.nan
    n_descriptors: float = math.nan

    def note(self, pids: list[int]) -> None:
        """Take note of what processes take now; shared pages count once. Those that have ended are passed over."""
        pss_kb = n_threads = n_descriptors = 0
        try:
            for pid in pids:
                pss_kb += int(re.search(r"^Pss:\s+(\d+)", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.M)[1])
                n_threads = max(n_threads, len(list(Path(f"/proc/{pid}/task").iterdir())))
                n_descriptors = max(n_descriptors, len(list(Path(f"/proc/{pid}/fd").iterdir())))
        except (OSError, TypeError):
            return
        self.memory_mb = max(pss_kb / 1024, 0.0 if math.isnan(self.memory_mb) else self.memory_mb)
        self.n_threads = max(n_threads, 0.0 if math.isnan(self.n_threads) else self.n_threads)
        self.n_descriptors = max(n_descriptors, 0.0 if math.isnan(self.n_descriptors) else self.n_descriptors)


def descendants(pid: int) -> list[int]:
    """Return a process and all that come from it."""
    found = [pid]
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text().split():
            found += descendants(int(child))
    return found


def footprint(code: Code, runs_dir: str) -> Footprint:
    """Return what a run with separate processes takes."""
    call = [code.python, "-m", "gslcosim", "up", SCENARIO, "--quiet", "--runs-dir", runs_dir, *BLIND, *until(LONG_S)]
    taken = Footprint()
    process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=runs_dir)
    while process.poll() is None:
        with contextlib.suppress(OSError):
            taken.note(descendants(process.pid))
        time.sleep(0.1)
    return taken


def command_s(code: Code, runs_dir: str) -> float:
    """Return how long a run of one tick takes, from the command to its end."""
    started = time.perf_counter()
    fly(code, runs_dir, ONE_TICK)
    return time.perf_counter() - started


def first_tick_s(code: Code, runs_dir: str, arguments: list[str]) -> float:
    """Return when the command says that it flies, counted from the command."""
    call = [code.python, "-m", "gslcosim", "up", SCENARIO, "--runs-dir", runs_dir, *ONE_TICK, *arguments]
    began, found_s = time.perf_counter(), math.nan
    process = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=runs_dir)
    for line in process.stderr:
        if "flying" in line:
            found_s = time.perf_counter() - began
    process.stderr.close()
    process.wait()
    return found_s


def cold_s(code: Code) -> float:
    """Return how long the quickstart takes where nothing is cached: kernels compiled, wind solved, run."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "GSLCOSIM_CACHE": f"{folder}/cache", "XDG_CACHE_HOME": f"{folder}/cache"}
        environment.pop("NUMBA_CACHE_DIR", None)
        call = [code.python, "-m", "gslcosim", "up", SCENARIO, "--quiet", "--runs-dir", folder]
        began = time.perf_counter()
        subprocess.run(call, check=True, cwd=folder, env=environment)
        return time.perf_counter() - began


def suite_min(code: Code) -> float:
    """Return how long all of the suite would take [min], from the first of its repetitions; preparation is left out.

    Not a number where the suite fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        call = [code.python, "-m", "gslcosim", "bench", "run", SUITE, "--only", "repetition=0", "--no-report", "--json"]
        done = subprocess.run([*call, "--results", f"{folder}/results"], check=False, capture_output=True, text=True)
    if done.returncode:
        note(f"{code.name}: {SUITE} ended with exit code {done.returncode}: {done.stderr[-300:]}")
        return math.nan
    return json.loads(done.stdout)["wall"]["flying_s"] * N_REPETITIONS / 60


def until(limit_s: int) -> list[str]:
    """Return the option for a run of that length."""
    return ["--set", f"referee.stop.time_limit_s={limit_s}"]


def cpu_us_a_tick(code: Code, runs_dir: str, arguments: list[str]) -> tuple[float, Flown]:
    """Return what a tick costs, and the long run."""
    short, long = (fly(code, runs_dir, [*arguments, *until(limit_s)]) for limit_s in (SHORT_S, LONG_S))
    n_ticks = long.result["ticks"] - short.result["ticks"]
    return 1e6 * (long.cpu_s - short.cpu_s) / n_ticks, long


def loop_s() -> float:
    """Return what a plain loop takes: how fast the machine is today."""
    started = time.process_time()
    total = 0
    for i in range(5_000_000):
        total += i & 7
    return time.process_time() - started


def measure(code: Code, runs_dir: str, *, has_tape: bool, has_groups: bool) -> dict[str, float]:
    """Return one round of figures of a version."""
    separate_us, separate = cpu_us_a_tick(code, runs_dir, BLIND)
    one_us, one = cpu_us_a_tick(code, runs_dir, [*BLIND, *ONE])
    live_us, unrecorded_one = cpu_us_a_tick(code, runs_dir, [*BLIND, *ONE, *QUIET])
    unrecorded = fly(code, runs_dir, [*BLIND, *QUIET, *until(LONG_S)])
    tape = [*BLIND, *ONE, *QUIET, "--set", "gas.tape=true"]
    lockstep = fly(code, runs_dir, [*LOCKSTEP, *until(SHORT_S)])
    taken = footprint(code, runs_dir)
    grouped, lockstep_grouped = math.nan, math.nan
    if has_groups:
        grouped = fly(code, runs_dir, [*BLIND, *GROUPED, *until(LONG_S)]).speed
        lockstep_grouped = fly(code, runs_dir, [*LOCKSTEP, *GROUPED, *until(SHORT_S)]).speed
    return {
        "speed_grouped": grouped,
        "speed_lockstep_grouped": lockstep_grouped,
        "memory_mb": taken.memory_mb,
        "n_threads": taken.n_threads,
        "n_descriptors": taken.n_descriptors,
        "speed_unrecorded": unrecorded.speed,
        "speed_one_unrecorded": unrecorded_one.speed,
        "command_s": command_s(code, runs_dir),
        "first_tick_cold_s": first_tick_s(code, runs_dir, []),
        "speed_separate": separate.speed,
        "speed_one": one.speed,
        "cpu_separate_us": separate_us,
        "cpu_one_us": one_us,
        "cpu_one_unrecorded_us": live_us,
        "cpu_one_tape_us": cpu_us_a_tick(code, runs_dir, tape)[0] if has_tape else float("nan"),
        "first_tick_s": separate.result["start_up_s"],
        "speed_lockstep": lockstep.speed,
        "loop_s": loop_s(),
    }


def share_of_recorder(figures: dict[str, float], key: str) -> float:
    """Return what recording costs of a run's speed, as a share."""
    with_it = figures["speed_one" if key else "speed_separate"]
    return 1 - with_it / figures["speed_one_unrecorded" if key else "speed_unrecorded"]


ROWS = (
    ("separate / one process, speed", lambda own, base: own["speed_separate"] / own["speed_one"]),
    ("separate / one process, CPU a tick", lambda own, base: own["cpu_separate_us"] / own["cpu_one_us"]),
    ("one process, CPU a tick / the base's", lambda own, base: own["cpu_one_us"] / base["cpu_one_us"]),
    ("  the same, recorder off", lambda own, base: own["cpu_one_unrecorded_us"] / base["cpu_one_us"]),
    ("  the same, recorder off, gas from tape", lambda own, base: own["cpu_one_tape_us"] / base["cpu_one_us"]),
    ("separate, speed / the base's", lambda own, base: own["speed_separate"] / base["speed_separate"]),
    ("one process, speed / the base's", lambda own, base: own["speed_one"] / base["speed_one"]),
    ("recorder's cost, separate, 1 - speed with / without", lambda own, base: share_of_recorder(own, "")),
    ("recorder's cost, one process", lambda own, base: share_of_recorder(own, "_one")),
    (
        "first tick / the base's, from the command",
        lambda own, base: own["first_tick_cold_s"] / base["first_tick_cold_s"],
    ),
    ("lockstep agent, separate, x real time", lambda own, base: own["speed_lockstep"]),
    ("  all services in one process", lambda own, base: own["speed_lockstep_grouped"]),
    ("grouped / one process, speed", lambda own, base: own["speed_grouped"] / own["speed_one"]),
    ("all processes together, memory [MB]", lambda own, base: own["memory_mb"]),
    ("  threads of the process with most", lambda own, base: own["n_threads"]),
    ("  descriptors of the process with most", lambda own, base: own["n_descriptors"]),
    ("command to end, a run of one tick [s]", lambda own, base: own["command_s"]),
    ("first tick after the command [s]", lambda own, base: own["first_tick_cold_s"]),
    ("first tick after the scenario is read [s]", lambda own, base: own["first_tick_s"]),
    ("separate, x real time", lambda own, base: own["speed_separate"]),
    ("one process, x real time", lambda own, base: own["speed_one"]),
    ("one process, CPU a tick [us]", lambda own, base: own["cpu_one_us"]),
    ("a plain loop [s]", lambda own, base: own["loop_s"]),
    ("foreign load [cores]", lambda own, base: own["foreign_cores"]),
)


def measured_once(today: Code, other: Code, skipped: list[str]) -> dict[str, tuple[float, float]]:
    """Return by title the rows that take minutes each, for the base and for today's code."""
    rows: dict[str, tuple[float, float]] = {}
    if "cold" not in skipped:
        before, now = cold_s(other), cold_s(today)
        rows["quickstart with nothing cached / the base's"] = (1.0, now / before)
        rows["  quickstart with nothing cached [s]"] = (before, now)
    if "suite" not in skipped:
        has_suites = (other.folder / "gslcosim" / "benchmark").exists()
        title = f"{SUITE}, all trials [min], {N_REPETITIONS} times the first repetition's"
        rows[title] = (suite_min(other) if has_suites else math.nan, suite_min(today))
    return rows


def medians(rounds: list[dict[str, float]]) -> dict[str, float]:
    """Return the median of each figure."""
    return {key: statistics.median(figures[key] for figures in rounds) for key in rounds[0]}


def main() -> None:
    """Fly both in turns and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base", required=True, help="the commit to compare with")
    parser.add_argument("--n", type=int, default=5, help="how many rounds")
    parser.add_argument("--skip", nargs="+", default=[], choices=("suite", "cold"), help="rows to leave out")
    parser.add_argument(
        "--max-foreign-cores", type=float, default=0.1, help="what others may take of the processors in a round"
    )
    parser.add_argument("--json", action="store_true", help="print all figures as JSON")
    options = parser.parse_args()
    today = Code(name="today", python=Path(sys.executable), folder=ROOT)
    own: list[dict[str, float]] = []
    base: list[dict[str, float]] = []
    with base_code(options.base) as other, tempfile.TemporaryDirectory() as runs_dir:
        has_tape = supports(other, "validate", SCENARIO, "--set", "gas.tape=true")
        has_groups = supports(other, "validate", SCENARIO, "--set", "processes=grouped")
        for code in (today, other):
            for arguments in ([], ONE):
                fly(code, runs_dir, [*arguments, *until(SHORT_S)])  # fills the caches
        fly(today, runs_dir, [*BLIND, *ONE, *QUIET, "--set", "gas.tape=true", *until(LONG_S)])
        os.environ["TMPDIR"] = runs_dir
        load = ForeignLoad()
        for number in range(options.n):
            for code, rounds, has in ((today, own, (True, True)), (other, base, (has_tape, has_groups))):
                rounds.append(measure(code, runs_dir, has_tape=has[0], has_groups=has[1]))
                rounds[-1]["foreign_cores"] = load.take()
            loads = ", ".join(f"{rounds[-1]['foreign_cores']:.2f}" for rounds in (own, base))
            note(f"round {number + 1} of {options.n}: foreign load {loads} cores (today, {options.base[:10]})")
        quiet = [
            pair
            for pair in zip(own, base, strict=True)
            if max(figures["foreign_cores"] for figures in pair) <= options.max_foreign_cores
        ]
        once = measured_once(today, other, options.skip)
    if options.json:
        print(json.dumps({"today": own, options.base: base, "once": once}, indent=2))  # noqa: T201
        return
    if not quiet:
        note(f"No round stayed below {options.max_foreign_cores:g} cores of foreign load; all count.")
    own_counted, base_counted = ([pair[i] for pair in quiet] or (own, base)[i] for i in (0, 1))
    counted = f"medians of {len(own_counted)} of {options.n} rounds in turns"
    print(f"{SCENARIO}, {os.cpu_count()} cores, {counted}")  # noqa: T201
    print(f"{'':52}{options.base[:10]:>12}{'today':>12}")  # noqa: T201
    own_medians, base_medians = medians(own_counted), medians(base_counted)
    for title, figure in ROWS:
        before, now = figure(base_medians, base_medians), figure(own_medians, base_medians)
        print(f"{title:52}{before:12.2f}{now:12.2f}")  # noqa: T201
    for title, (before, now) in once.items():
        print(f"{title:52}{before:12.2f}{now:12.2f}")  # noqa: T201


if __name__ == "__main__":
    main()
