"""Starting real flights from tests: the installed command, real processes, real Zenoh."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gslcosim.cli.main import main

# Scripts use these runs, too; pytest finds the folder by its settings.
sys.path.insert(0, str(Path(__file__).resolve().parent))

from deadlines import EVENT_S, KILLED_S, PROCESS_S
from warm_commands import WarmCommand, start_warm

ROOT = Path(__file__).resolve().parents[2]
TINY_ROOM = ROOT / "scenarios" / "tiny_room.yaml"
ON_BOARD = TINY_ROOM.with_name("on_board_sensors.yaml")
SHARED = Path(__file__).resolve().parent
END_TO_END = ROOT / "tests" / "end_to_end"
AGENTS = END_TO_END / "agents"
EVERY_VEHICLE = END_TO_END / "every_vehicle.yaml"
AROUND_A_WALL = END_TO_END / "around_a_wall.yaml"
COMMAND = [sys.executable, "-m", "gslcosim"]
# A recorder is a seventh process; digests do not depend on it.
UNRECORDED = ("--set", "recording.enabled=false")


STARTED: list["Flight"] = []


@dataclass
class Ended:
    """A finished run: exit code, result and what was said on standard error."""

    exit_code: int
    result: dict
    run_dir: Path | None
    errors: str


@dataclass
class Flight:
    """A run going on in a process of its own."""

    process: subprocess.Popen | WarmCommand
    runs_dir: Path
    arguments: list[str] = field(default_factory=list)

    def child(self, name: str, limit_s: float = EVENT_S) -> int:
        """Wait until a participant's process exists and return its number."""
        deadline = time.monotonic() + limit_s
        while time.monotonic() < deadline:
            for pid in children_of(self.process.pid):
                if name in command_of(pid):
                    return pid
            wait_a_moment()
        raise AssertionError(f"no process {name!r} within {limit_s} s")

    def wait_until_flying(self, limit_s: float = EVENT_S) -> None:
        """Wait until the first command has passed an agent's validator."""
        deadline = time.monotonic() + limit_s
        while time.monotonic() < deadline:
            if any(self.runs_dir.glob("*/inputs.log")):
                return
            assert self.process.poll() is None, self.process.communicate()
            wait_a_moment()
        raise AssertionError(f"no command within {limit_s} s")

    def wait_for(self, is_true: Callable[[], bool], limit_s: float = EVENT_S) -> None:
        """Wait until a condition holds."""
        deadline = time.monotonic() + limit_s
        while not is_true():
            assert self.process.poll() is None, self.process.communicate()
            if time.monotonic() > deadline:
                self.process.send_signal(signal.SIGINT)
                raise AssertionError(f"not within {limit_s} s: {self.process.communicate(timeout=limit_s)}")
            wait_a_moment()

    def abandon(self) -> None:
        """End a run whose test has failed, so that it does not disturb the next one."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()

    def end(self, limit_s: float = PROCESS_S) -> Ended:
        """Wait for the end; nothing the run has started may be left."""
        started = children_of(self.process.pid)
        output, errors = self.process.communicate(timeout=limit_s)
        assert_gone(started)
        return _ended(self.process.returncode, self.runs_dir, output, errors)


def start(scenario, runs_dir, *arguments, prefix=(), is_recorded=False, is_fresh=False) -> Flight:
    """Start `gslcosim up` with its output captured; see `start_command`."""
    words = _words(scenario, runs_dir, arguments, is_recorded=is_recorded)
    flight = Flight(start_command(words, prefix=prefix, is_fresh=is_fresh), runs_dir, list(arguments))
    STARTED.append(flight)
    return flight


def start_command(
    words, *, prefix=(), is_fresh=False, cwd: Path | None = None, variables: Mapping[str, str] | None = None
) -> subprocess.Popen | WarmCommand:
    """Start `gslcosim WORDS` with its output captured.

    Args:
        words: The command line without the program's name.
        prefix: Words of a program that starts it, after which it imports what it needs.
        is_fresh: Whether it does so in any case; otherwise it is a fork of a process that has imported everything.
        cwd: Its folder; absent: that of this process.
        variables: Variables that it has beside those of this process.
    """
    if not prefix and not is_fresh and (warm := start_warm(words, cwd or Path.cwd(), variables or {})):
        return warm
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": os.environ | (variables or {})}
    return subprocess.Popen([*prefix, *COMMAND, *words], **pipes, text=True, start_new_session=True, cwd=cwd)


def fly_command(scenario, runs_dir, *arguments, prefix=(), is_recorded=False) -> Ended:
    """Fly to the end by a command that imports what it needs, as do the processes that it starts."""
    return start(scenario, runs_dir, *arguments, prefix=prefix, is_recorded=is_recorded, is_fresh=True).end()


def fly_here(scenario, runs_dir, *arguments, is_recorded=False) -> Ended:
    """Fly to the end with `--in-process`; agents with a command of their own are processes nevertheless."""
    before = children_of(os.getpid())
    words = _words(scenario, runs_dir, (*arguments, "--in-process"), is_recorded=is_recorded)
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        exit_code = main(words)
    assert_gone([pid for pid in children_of(os.getpid()) if pid not in before])
    return _ended(exit_code, runs_dir, output.getvalue(), errors.getvalue())


def fly(scenario, runs_dir, *arguments, is_recorded=False) -> Ended:
    """Fly to the end with services and agents in their processes."""
    return start(scenario, runs_dir, *arguments, is_recorded=is_recorded).end()


def _words(scenario, runs_dir, arguments, *, is_recorded) -> list[str]:
    unrecorded = () if is_recorded else UNRECORDED
    return ["up", str(scenario), "--json", "--runs-dir", str(runs_dir), *unrecorded, *arguments]


def _ended(exit_code, runs_dir, output, errors) -> Ended:
    run_dirs = sorted(runs_dir.glob("*/"))
    run_dir = run_dirs[-1] if run_dirs else None
    result = json.loads(output) if output.strip().startswith("{") else {}
    if not result and run_dir is not None and (run_dir / "result.json").exists():
        result = json.loads((run_dir / "result.json").read_text())
    return Ended(exit_code, result, run_dir, errors)


def assert_gone(pids) -> None:
    """Assert that none of these processes runs; those that Linux kills with their parent end a moment later."""
    deadline = time.monotonic() + KILLED_S
    while (left := [pid for pid in pids if is_running(pid)]) and time.monotonic() < deadline:
        wait_a_moment()
    assert not left, f"left over: {[command_of(pid) for pid in left]}"


def with_agent(agent: str) -> tuple[str, ...]:
    """Return the override that starts one of the test agents instead of the scenario's."""
    path = AGENTS / f"{agent}.py"
    return "--set", f"agents[0].start={{command: [{sys.executable}, {path}]}}"


def children_of(pid: int) -> list[int]:
    """Return the numbers of all descendants of a process."""
    parents: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, IndexError, ValueError):
            fields = stat.read_text().rsplit(")", 1)[1].split()
            parents.setdefault(int(fields[1]), []).append(int(stat.parent.name))
    found, todo = [], [pid]
    while todo:
        children = parents.get(todo.pop(), [])
        found += children
        todo += children
    return found


def command_of(pid: int) -> str:
    """Return a process's command line, empty when it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    except OSError:
        return ""


def is_running(pid: int) -> bool:
    """Return whether a process exists and is not a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except OSError:
        return False


def wait_a_moment() -> None:
    """Give way while waiting on a condition, which is looked at a hundred times a second."""
    time.sleep(0.01)
