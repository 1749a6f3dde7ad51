"""Random faults of every member of a run, in every phase: who is named, how soon, and whether anything is left.

    make soak-faults N=1000
    python tests/soak/fault_campaign.py --trials 100 --jobs 2 --seed 7 --longest-stop-s 12

Each trial flies a small scenario in a process of its own, sends one signal to one member, and compares what comes of it
with `fault_expectations.py`. Trial n of a seed is always the same fault at the same moment after the same event, so a
wrong one is repeated with `--seed S --only N`. Linux only.
"""

import argparse
import contextlib
import ctypes
import json
import os
import platform
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "tests" / "shared")]

from fault_expectations import (  # noqa: E402 - test folders are no packages
    AGENT_FAILED,
    AGENTS,
    GOES_ON,
    MEMBERS,
    NAMED,
    PHASES,
    SIGNALS,
    TAKEN_ALONG,
    expected,
)
from real_runs import TINY_ROOM, children_of, command_of, is_running, wait_a_moment  # noqa: E402

from gslcosim.base.files import ScratchFolder  # noqa: E402
from gslcosim.base.rng import stream  # noqa: E402
from gslcosim.runtime.processes.stop_detection import STOP_TIMEOUT_S  # noqa: E402
from gslcosim_services.recorder.rerun_cli import is_complete, repair_recording  # noqa: E402

SIM_TIME_S = 120
# After it is certain what happened: at once for a kill, after the limit for a stop.
END_LIMIT_S = 5.0
HANG_LIMIT_S = 120.0
MOST_TRIES = 5
LONGEST_STOP_S = 60.0
_PR_SET_CHILD_SUBREAPER = 36


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One trial: what happens to whom and when, relative to the phase's event."""

    number: int
    member: str
    signal: str
    phase: str
    delay_s: float
    stop_s: float


@dataclass(kw_only=True)
class Ended:
    """How a trial ended; `problems` are what was not as expected."""

    fault: Fault
    is_sent: bool = False
    outcome: str = ""
    exit_code: int = 0
    end_s: float = 0.0
    is_timed: bool = False
    text: str = ""
    problems: list[str] = field(default_factory=list)


def fault_of(seed: int, number: int, longest_stop_s: float) -> Fault:
    """Return trial `number` of a seed: members, signals and phases in turn, their moments at random."""
    rng = stream(seed, f"soak.fault.{number}")
    combinations = [(m, s, p) for m in MEMBERS for s in SIGNALS for p in PHASES]
    # Each combination once before any comes twice.
    round_rng = stream(seed, f"soak.round.{number // len(combinations)}")
    at = round_rng.permutation(len(combinations))[number % len(combinations)]
    member, signal_name, phase = combinations[at]
    stop_s = float(rng.uniform(1.0, 3.0) if signal_name == "stopped 1-3 s" else rng.uniform(8.0, longest_stop_s))
    return Fault(
        number=number, member=member, signal=signal_name, phase=phase,
        delay_s=float(rng.uniform(0.0, 0.25)), stop_s=stop_s,
    )  # fmt: skip


class Trial:
    """A run in a process of its own with everything it says, in folders of its own."""

    def __init__(self, folder: Path, member: str) -> None:
        self.runs_dir = folder / "runs"
        self.temp_dir = folder / "t"
        self.temp_dir.mkdir(parents=True)
        self.lines: list[str] = []
        self.flight_began_s: float | None = None
        agent = ROOT / "tests" / "end_to_end" / "agents" / "holding.py"
        start = f"{{command: [{sys.executable}, {agent}]}}"
        if member == "agent behind stdio":
            start = f"{{command: [{sys.executable}, {agent}], door: stdio}}"
        call = [sys.executable, "-m", "gslcosim", "up", str(TINY_ROOM), "--runs-dir", str(self.runs_dir)]
        for change in (f"agents[0].start={start}", f"referee.stop.time_limit_s={SIM_TIME_S}"):
            call += ["--set", change]
        self.began_s = time.monotonic()
        self.process = subprocess.Popen(
            call, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
            env={**os.environ, "TMPDIR": str(self.temp_dir)},
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            if not self.lines:
                self.flight_began_s = time.monotonic()
            self.lines.append(line.rstrip())

    @property
    def errors(self) -> str:
        return "\n".join(self.lines)

    def has_said(self, state: str) -> bool:
        return any(f": {state}" in line for line in list(self.lines))

    def wait_for(self, is_true: Callable[[], object], limit_s: float = 60) -> bool:
        """Wait for a condition; return whether it came true before the run was over."""
        deadline_s = time.monotonic() + limit_s
        while not is_true():
            if self.process.poll() is not None or time.monotonic() > deadline_s:
                return bool(is_true())
            wait_a_moment()
        return True

    def pid_of(self, member: str) -> int:
        """Return a member's process, 0 where there is none."""
        if member == "supervisor":
            return self.process.pid
        name = {"fork_server": "gslcosim_services --fork-server"}.get(member, f"gslcosim_services {member}")
        name = "agents/holding" if member in AGENTS else name
        # A fork of the supervisor's has its command line for a moment, in which the agent is named.
        commands = {pid: command_of(pid) for pid in children_of(self.process.pid)}
        pids = [pid for pid, command in commands.items() if name in command and "--runs-dir" not in command]
        # What a sandbox or launcher has started counts, not the launcher.
        return pids[-1] if pids else 0

    @property
    def result(self) -> dict:
        found = list(self.runs_dir.glob("*/result.json"))
        return json.loads(found[0].read_text()) if found else {}

    @property
    def recording(self) -> Path | None:
        return next(self.runs_dir.glob("*/recording.rrd"), None)

    def wait_for_phase(self, phase: str, member: str) -> bool:
        """Wait for the event with which a phase begins; return whether it came."""
        if phase == "before join":
            return self.wait_for(lambda: self.pid_of(member))
        if phase == "start":
            # Agents are started after the services: who is to be signalled is waited for, too.
            return self.wait_for(lambda: all(self.pid_of(name) for name in ("world", "recorder", member)))
        return self.wait_for(lambda: self.has_said("flying" if phase == "flight" else "closing"))


def fly_with(fault: Fault, baseline: dict | None) -> Ended:
    """Fly one trial and return how it ended; without a baseline no fault happens."""
    for _ in range(MOST_TRIES):
        ended = _fly_once(fault, baseline)
        # On a busy machine a short run may be over before the fault: that proves nothing.
        if ended.is_sent or baseline is None or fault.phase == "ending":
            break
    return ended


def _fly_once(fault: Fault, baseline: dict | None) -> Ended:
    folder = Path(tempfile.mkdtemp(prefix="gf", dir="/tmp"))
    try:
        trial = Trial(folder, fault.member)
        try:
            return _fly(trial, fault, baseline)
        finally:
            _end_all()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _fly(trial: Trial, fault: Fault, baseline: dict | None) -> Ended:
    ended = Ended(fault=fault)
    pid = 0
    if baseline is not None and trial.wait_for_phase(fault.phase, fault.member):
        time.sleep(fault.delay_s)  # the moment is what is tried
        pid = trial.pid_of(fault.member)
    signalled_s = time.monotonic()
    certain_s, allowed = signalled_s, (GOES_ON,) if fault.phase == "ending" else ()
    if pid and _send(pid, signal.SIGKILL if fault.signal == "killed" else signal.SIGSTOP):
        ended.is_sent = True
        allowed = expected(fault.member, fault.signal, fault.phase)
        certain_s = _go_on(trial, fault, pid, signalled_s)
    try:
        ended.exit_code = trial.process.wait(HANG_LIMIT_S)
    except subprocess.TimeoutExpired:
        ended.problems.append(f"not over {HANG_LIMIT_S:g} s later")
        ended.text = trial.errors
        return ended
    ended_s = time.monotonic()
    _judge(trial, ended, allowed, baseline)
    # A run that goes on ends when it has run, and one whose agent fails begins when all others are there.
    ended.is_timed = ended.outcome in (NAMED, TAKEN_ALONG) or (
        ended.outcome == AGENT_FAILED and fault.phase == "flight"
    )
    ended.end_s = max(0.0, ended_s - certain_s) if ended.is_timed else 0.0
    if ended.end_s > END_LIMIT_S:
        ended.problems.append(f"ended {ended.end_s:.1f} s after it was certain")
    return ended


# Returns when it was certain what happened.
def _go_on(trial: Trial, fault: Fault, pid: int, signalled_s: float) -> float:
    if fault.signal == "killed":
        return signalled_s
    if fault.signal == "stopped for ever":
        if fault.member != "supervisor":
            return _watched_from(trial, signalled_s) + STOP_TIMEOUT_S
        trial.wait_for(lambda: time.monotonic() - signalled_s > STOP_TIMEOUT_S + 1)
        _send(pid, signal.SIGKILL)
        return time.monotonic()
    trial.wait_for(lambda: time.monotonic() - signalled_s > fault.stop_s, fault.stop_s + 5)
    if is_running(pid):
        _send(pid, signal.SIGCONT)
    return _watched_from(trial, signalled_s) + STOP_TIMEOUT_S


# The fork server is there before the scenario has been read; who could miss it comes later.
def _watched_from(trial: Trial, signalled_s: float) -> float:
    trial.wait_for(lambda: trial.flight_began_s is not None)
    return max(signalled_s, trial.flight_began_s or 0.0)


def _judge(trial: Trial, ended: Ended, allowed: tuple[str, ...], baseline: dict | None) -> None:
    result, fault = trial.result, ended.fault
    faults = result.get("faults", [])
    first = faults[0] if faults else {}
    ended.text = str(first.get("text", trial.errors[-500:]))[:500]
    word = "SIGKILL" if fault.signal == "killed" else "stopped by a signal"
    culprit = "agent beetle" if fault.member in AGENTS else fault.member
    is_named = first.get("participant") == culprit and word in ended.text
    if baseline is None or _is_as(result, baseline, ended.exit_code, culprit, faults):
        ended.outcome = GOES_ON
    elif ended.exit_code == -signal.SIGKILL and (not result or _has_same_result(result, baseline)):
        # Its last act may have been to write the result, which then is that of a run without a fault.
        ended.outcome = TAKEN_ALONG
    elif ended.exit_code == 3 and result.get("valid") is False and is_named:
        ended.outcome = NAMED
    elif ended.exit_code == 1 and result.get("end_reason") == "agent_failed" and result.get("valid") and is_named:
        ended.outcome = AGENT_FAILED
    else:
        ended.outcome = "wrong"
    if ended.outcome not in allowed:
        who, reason = first.get("participant"), result.get("end_reason")
        ended.problems.append(
            f"expected {' or '.join(allowed)}, was {ended.outcome}: exit code {ended.exit_code}, {reason}, names {who}"
        )
    ended.problems += _leftovers(trial, is_supervisor_gone=ended.outcome == TAKEN_ALONG)
    ended.problems += _recording_problems(trial, ended.outcome)


# At the end an agent may be gone already, which is reported and changes nothing.
def _is_as(result: dict, baseline: dict, exit_code: int, culprit: str, faults: list[dict]) -> bool:
    is_same = exit_code == baseline["exit_code"] and _has_same_result(result, baseline)
    return is_same and all(each["participant"] == culprit for each in faults)


def _has_same_result(result: dict, baseline: dict) -> bool:
    return all(result.get(key) == baseline[key] for key in ("valid", "end_reason", "digest", "ticks"))


def _leftovers(trial: Trial, *, is_supervisor_gone: bool) -> Iterator[str]:
    # This process adopts whatever loses its parent.
    left = [pid for pid in children_of(os.getpid()) if is_running(pid)]
    if is_supervisor_gone:
        deadline_s = time.monotonic() + END_LIMIT_S
        while left and time.monotonic() < deadline_s:
            wait_a_moment()
            left = [pid for pid in left if is_running(pid)]
    if left:
        yield f"left over: {[command_of(pid) for pid in left]}"
    if is_supervisor_gone:
        # It cannot tidy up; the next run does.
        ScratchFolder(parent=trial.temp_dir).close()
    # The folder of the user's runs stays, with nothing in it where the supervisor could tidy up.
    windows = list(trial.temp_dir.glob(".gslcosim-flights-*/*"))
    folders = [path.name for path in trial.temp_dir.iterdir() if not path.name.startswith(".gslcosim-flights-")]
    folders += [] if is_supervisor_gone else [path.name for path in windows]
    if folders:
        yield f"left over: {folders}"


def _recording_problems(trial: Trial, outcome: str) -> Iterator[str]:
    recording = trial.recording
    if recording is None or (outcome != GOES_ON and "recording cannot be read" in trial.errors.lower()):
        # The recorder had not come as far as its first bytes; the fault says so.
        if outcome == GOES_ON:
            yield "no recording"
        return
    if outcome == TAKEN_ALONG:
        if recording.stat().st_size > 100_000:
            repair_recording(recording)
    elif not is_complete(recording):
        yield "the recording does not open"


def _send(pid: int, number: int) -> bool:
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return False
    return True


def _end_all() -> None:
    for pid in children_of(os.getpid()):
        if "multiprocessing" not in command_of(pid):
            _send(pid, signal.SIGKILL)
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def _adopt_orphans() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)


def baseline_of(member: str) -> dict:
    """Return the result of a run in which nothing happens, with its exit code."""
    folder = Path(tempfile.mkdtemp(prefix="gf", dir="/tmp"))
    try:
        trial = Trial(folder, member)
        exit_code = trial.process.wait(HANG_LIMIT_S)
        return {**trial.result, "exit_code": exit_code}
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def table_of(all_ended: list[Ended]) -> str:
    """Return the campaign as a table in Markdown: a row for each member and signal, a column for each phase."""
    lines = [f"| member | signal | {' | '.join(PHASES)} |", "|---" * (2 + len(PHASES)) + "|"]
    for member in MEMBERS:
        for signal_name in SIGNALS:
            cells = [_cell(all_ended, (member, signal_name, phase)) for phase in PHASES]
            lines.append(f"| {member} | {signal_name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(all_ended: list[Ended], what: tuple[str, str, str]) -> str:
    cell = [e for e in all_ended if (e.fault.member, e.fault.signal, e.fault.phase) == what]
    if not cell:
        return ""
    outcomes = Counter("**wrong**" if ended.problems else ended.outcome for ended in cell)
    text = ", ".join(f"{n} {outcome}" for outcome, n in sorted(outcomes.items()))
    times_s = [ended.end_s for ended in cell if ended.is_timed]
    return f"{text} ({statistics.median(times_s):.1f}, {max(times_s):.1f} s)" if times_s else text


def main() -> int:
    """Fly the campaign and print its table; the exit code says whether anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="trials at a time")
    parser.add_argument("--only", type=int, help="fly this trial alone")
    parser.add_argument("--from", dest="first", type=int, default=0, help="the first trial")
    parser.add_argument("--longest-stop-s", type=float, default=LONGEST_STOP_S, help="at least 8")
    parser.add_argument("--log", type=Path, help="append each trial as a line of JSON")
    parser.add_argument("--table", type=Path, help="print the table of such a file, and fly nothing")
    arguments = parser.parse_args()
    if arguments.table is not None:
        return _conclude([_from_line(line) for line in arguments.table.read_text().splitlines()])
    numbers = range(arguments.first, arguments.first + arguments.trials)
    numbers = [arguments.only] if arguments.only is not None else list(numbers)
    faults = [fault_of(arguments.seed, n, arguments.longest_stop_s) for n in numbers]
    baselines = {member: baseline_of(member) for member in (MEMBERS[0], "agent behind stdio")}
    all_ended: list[Ended] = []
    with ProcessPoolExecutor(arguments.jobs, initializer=_adopt_orphans) as pool:
        futures = [pool.submit(fly_with, f, baselines.get(f.member, baselines[MEMBERS[0]])) for f in faults]
        for future in as_completed(futures):
            ended = future.result()
            all_ended.append(ended)
            _tell(ended, len(all_ended), len(faults), arguments.log)
    return _conclude(all_ended)


def _from_line(line: str) -> Ended:
    fields = json.loads(line)
    return Ended(**{**fields, "fault": Fault(**fields["fault"])})


def _conclude(all_ended: list[Ended]) -> int:
    n_wrong = sum(bool(ended.problems) for ended in all_ended)
    _write(f"{datetime.now(UTC):%Y-%m-%d}, {os.cpu_count()} cores, {platform.system()}\n")
    _write(table_of(all_ended))
    times_s = [ended.end_s for ended in all_ended if ended.is_timed]
    figures = f"median {statistics.median(times_s):.1f} s, worst {max(times_s):.1f} s" if times_s else ""
    _write(f"\n{len(all_ended)} trials, {n_wrong} wrong; after it was certain the run ended within: {figures}")
    return 1 if n_wrong else 0


def _tell(ended: Ended, n: int, n_all: int, log: Path | None) -> None:
    fault = ended.fault
    what = f"{fault.number}: {fault.member}, {fault.signal}, {fault.phase} + {fault.delay_s:.2f} s"
    _write(f"{n}/{n_all} {what}: {ended.outcome}, {ended.end_s:.1f} s {'; '.join(ended.problems)}")
    if ended.problems:
        _write(f"      {ended.text}")
    if log is not None:
        with log.open("a") as file:
            file.write(json.dumps(asdict(ended)) + "\n")


def _write(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
