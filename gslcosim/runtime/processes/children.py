"""Child processes of a run: started, logged, watched for stops, and ended, so that none is ever left over."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from types import MappingProxyType
from typing import Protocol, Self, cast

from gslcosim.base.errors import RESOURCE_ERRNOS, RunFolderError, UsageError, build_machine_error, format_machine_error
from gslcosim.base.files import open_for_writing, write_all
from gslcosim.base.processes import build_parent_death_prefix, describe_exit
from gslcosim.bus.interface import INHERITED_FILES, JOIN_VARIABLE, JoinData
from gslcosim.runtime.processes.sandbox.launcher_client import (
    Confinement,
    Launch,
    is_launcher_possible,
    write_memory_file,
)
from gslcosim.runtime.processes.short_environment import build_short_environment

# Days of talk; and a disk has room for the logs of a swarm.
MAX_LOG_BYTES = 64_000_000
_LOG_READ_BYTES = 1 << 16


class ProcessLog:
    """The standard output of a process on its way to a file. What exceeds the limit is dropped, and the file says so.

    Within the context the process is started with `fileno()`; the file is complete when `wait` returns, or earlier if
    something that the process has started holds its output open. A process that writes more is not stopped by that.

    Args:
        path: The file; what is there stays.
        most_bytes: How much of the output is kept.

    Raises:
        RunFolderError: the file cannot be written.
    """

    def __init__(self, path: Path, *, most_bytes: int = MAX_LOG_BYTES) -> None:
        try:
            self._file = open_for_writing(path.parent, path.name, is_appended=True)
        except OSError as error:
            text = format_machine_error(error, path.name, "a log that can be written", path=path)
            raise RunFolderError(text) from error
        self._most_bytes = most_bytes
        self._from, self._to = os.pipe()
        self._pump = threading.Thread(target=self._copy, name=f"log {path.stem}", daemon=True)

    def __enter__(self) -> "ProcessLog":
        try:
            self._pump.start()
        except RuntimeError:
            # No memory for a thread.
            for fd in (self._file, self._from, self._to):
                os.close(fd)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._to)

    def fileno(self) -> int:
        """Return the descriptor that the process writes to."""
        return self._to

    def wait(self, limit_s: float) -> None:
        """Wait until the process and its descendants have closed their output, or until the limit."""
        if self._pump.is_alive():
            self._pump.join(limit_s)

    def _copy(self) -> None:
        n_kept = n_dropped = 0
        # A disk without room costs the log, not the run: what the run needs itself is reported by its writer.
        with contextlib.suppress(OSError):
            while data := os.read(self._from, _LOG_READ_BYTES):
                kept = data[: self._most_bytes - n_kept]
                if kept:
                    n_kept += len(kept)
                    with contextlib.suppress(OSError):
                        write_all(self._file, kept)
                if len(kept) < len(data):
                    if n_dropped == 0:
                        self._note(f"the log is cut here, after {self._most_bytes / 1e6:g} MB.")
                    n_dropped += len(data) - len(kept)
        if n_dropped:
            self._note(f"{n_dropped / 1e6:,.3f} MB more were dropped.")
        os.close(self._from)
        os.close(self._file)

    def _note(self, text: str) -> None:
        with contextlib.suppress(OSError):
            write_all(self._file, f"\n[gslcosim: {text}]\n".encode())


EXIT_TIMEOUT_S = 3.0
TERM_TIMEOUT_S = 2.0
# A descendant that has left the process group may hold its output open for ever.
LOG_TIMEOUT_S = 0.5
# What a process of a run gets in its environment.
JOIN_VARIABLES = (JOIN_VARIABLE, "GSLCOSIM_AGENT", "GSLCOSIM_GATEWAY", "GSLCOSIM_TOKEN")


class ProcessHandle(Protocol):
    """A process that can be asked whether and how it has ended; `subprocess.Popen` is one."""

    @property
    def pid(self) -> int:
        """Its number, 0 where it has not begun."""
        ...

    def poll(self) -> int | None:
        """Return how it has ended; None while it runs."""
        ...

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end and return how it has ended, or raise `subprocess.TimeoutExpired`."""
        ...


@dataclass
class ChildProcess:
    """A process of the run. It leads its own process group, so that its descendants end with it."""

    name: str
    process: ProcessHandle

    @property
    def is_running(self) -> bool:
        """True when the process has not ended yet."""
        return self.process.poll() is None

    def signal_group(self, number: int) -> None:
        """Send a signal to the process and all its descendants."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if self.process.pid:
                os.killpg(self.process.pid, number)


class ChildProcesses:
    """All processes that the supervisor has started; leaving the context ends them.

    Args:
        on_exit: Receives a process that has ended, its exit code, and in words how it ended, on a thread of its own.
        are_foreign: Whether processes that have no confinement are programs of other people, which start in the short
            environment of all agents; otherwise in that of this process.
    """

    def __init__(self, on_exit: Callable[[str, int, str], object], *, are_foreign: bool = False) -> None:
        self._on_exit = on_exit
        self._are_foreign = are_foreign
        self._children: dict[str, ChildProcess] = {}
        self._logs: list[ProcessLog] = []

    def __enter__(self) -> "ChildProcesses":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def start(
        self,
        name: str,
        command: Sequence[str],
        *,
        join: JoinData,
        log: Path,
        cwd: Path | None = None,
        variables: Mapping[str, str] = MappingProxyType({}),
        confinement: Confinement | None = None,
    ) -> None:
        """Start a process with its join data; its output goes to a log file, and its end is reported at once.

        The join data are a file that the process inherits: its environment can be read by others of its user.

        Raises:
            UsageError: the command cannot be started.
        """
        text = join.model_dump_json(exclude_none=True)
        inherited = write_memory_file(text) if INHERITED_FILES.is_dir() else None
        place = text if inherited is None else str(INHERITED_FILES / str(inherited))
        variables = {JOIN_VARIABLE: place, **variables}
        keep = () if inherited is None else (inherited,)
        self._start_logged(name, command, variables, log, cwd, confinement=confinement, keep=keep)

    def start_without_bus(
        self,
        name: str,
        command: Sequence[str],
        *,
        variables: Mapping[str, str],
        log: Path,
        cwd: Path,
        confinement: Confinement | None = None,
    ) -> None:
        """Start a process that joins no bus, with variables added to its environment; otherwise as `start`.

        Raises:
            UsageError: the command cannot be started.
        """
        self._start_logged(name, command, variables, log, cwd, confinement=confinement)

    def start_piped(
        self,
        name: str,
        command: Sequence[str],
        *,
        variables: Mapping[str, str],
        log: Path,
        cwd: Path,
        confinement: Confinement | None = None,
    ) -> tuple[FileIO, FileIO]:
        """Start a process as `start`, but return its standard input and output; only its errors are logged.

        Raises:
            UsageError: the command cannot be started.
        """
        with self._log(log) as errors:
            streams = (subprocess.PIPE, subprocess.PIPE, errors.fileno())
            process = self._start(name, command, variables, cwd, streams=streams, confinement=confinement)
        # Without buffers these are raw files.
        return cast(FileIO, process.stdin), cast(FileIO, process.stdout)

    def _start_logged(
        self,
        name: str,
        command: Sequence[str],
        variables: Mapping[str, str],
        log: Path,
        cwd: Path | None,
        *,
        confinement: Confinement | None,
        keep: tuple[int, ...] = (),
    ) -> None:
        with self._log(log) as output:
            streams = (subprocess.DEVNULL, output.fileno(), subprocess.STDOUT)
            self._start(name, command, variables, cwd, streams=streams, confinement=confinement, keep=keep)

    def _start(
        self,
        name: str,
        command: Sequence[str],
        variables: Mapping[str, str],
        cwd: Path | None,
        *,
        streams: tuple[int, int, int],
        confinement: Confinement | None = None,
        keep: tuple[int, ...] = (),
    ) -> "subprocess.Popen[bytes]":
        check_program(name, command, cwd)
        # Who starts a run from within another one must not hand its own place on.
        around = self._surroundings(command) if confinement is None else confinement.environment
        environment = {key: value for key, value in around.items() if not key.startswith(JOIN_VARIABLES)}
        environment |= variables
        line, descriptors, launch = [*build_parent_death_prefix(), *command], keep, None
        if confinement is not None and is_launcher_possible():
            launch = Launch(confinement, command, has_pipes=streams[0] == subprocess.PIPE, keep=keep)
            line, descriptors = launch.command, launch.descriptors
            environment |= launch.variables
        try:
            process = subprocess.Popen(
                line,
                bufsize=0,
                stdin=streams[0],
                stdout=streams[1],
                stderr=streams[2],
                env=environment,
                cwd=cwd,
                start_new_session=True,
                pass_fds=descriptors,
            )
        except OSError as error:
            if error.errno in RESOURCE_ERRNOS:
                raise build_machine_error(error, name, "a process that starts") from error
            raise UsageError(f"{name}: expected a command that starts, was {list(command)} ({error}).") from error
        finally:
            for descriptor in descriptors:
                os.close(descriptor)
        self.adopt(name, process, launch)
        return process

    def _surroundings(self, command: Sequence[str]) -> Mapping[str, str]:
        return build_short_environment(command) if self._are_foreign else os.environ

    def adopt(self, name: str, process: ProcessHandle, launch: Launch | None = None) -> None:
        """Watch a process that leads its own process group, and end it with the others."""
        self._children[name] = ChildProcess(name, process)
        threading.Thread(target=self._wait_for, args=(name, process, launch), daemon=True).start()

    @property
    def pids(self) -> dict[str, int]:
        """The numbers of the processes that have not ended, 0 where one has not begun."""
        # A copy at once: processes are added while another thread asks.
        return {child.name: child.process.pid for child in list(self._children.values()) if child.is_running}

    @property
    def running(self) -> list[str]:
        """Names of the processes that have not ended."""
        return [child.name for child in self._children.values() if child.is_running]

    def wait(self, limit_s: float) -> None:
        """Wait until all processes have ended, or until the limit."""
        deadline = time.monotonic() + limit_s
        for child in self._children.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.process.wait(timeout=max(0.0, deadline - time.monotonic()))

    def end(self) -> None:
        """End whatever still runs: ask, wait a moment, then kill whole process groups."""
        remaining = [child for child in self._children.values() if child.is_running]
        for child in remaining:
            child.signal_group(signal.SIGTERM)
            child.signal_group(signal.SIGCONT)
        if remaining:
            self.wait(TERM_TIMEOUT_S)
        for child in self._children.values():
            child.signal_group(signal.SIGKILL)
        # Who forked one may be stopped and not report its end; it is ended next, and Linux ends the forks with it.
        self.wait(TERM_TIMEOUT_S)
        for log in self._logs:
            log.wait(LOG_TIMEOUT_S)
        self._logs.clear()

    def _log(self, path: Path) -> ProcessLog:
        self._logs.append(ProcessLog(path))
        return self._logs[-1]

    def _wait_for(self, name: str, process: ProcessHandle, launch: Launch | None) -> None:
        code = process.wait()
        self._on_exit(name, code, (launch.log_tail() if launch is not None else "") or describe_exit(code))


def check_program(name: str, command: Sequence[str], cwd: Path | None) -> None:
    """Refuse a command line whose program is not there.

    Raises:
        UsageError: it cannot be found, or not be executed.
    """
    program = Path(cwd or ".") / command[0] if "/" in command[0] else shutil.which(command[0])
    if program is None or not os.access(program, os.X_OK) or Path(program).is_dir():
        reason = "no such program" if program is None or not Path(program).exists() else "it cannot be executed"
        raise UsageError(f"{name}: expected a command that starts, was {list(command)} ({reason}).")


MIN_PAUSE_S = 1.0


class PauseDetector:
    """Finds from looks that come many times a second which time nobody has lived through.

    What has been waited for meanwhile is not late: holders of deadlines move them by that time. It reads no clock:
    times [s] of a monotonic one are handed in. That clock does not run while a machine is suspended.
    """

    def __init__(self) -> None:
        self._looked_at_s: float | None = None

    def missed_s(self, now_s: float) -> float:
        """Return the time [s] since the last look where it is far longer than usual, else 0."""
        since_s = now_s - self._looked_at_s if self._looked_at_s is not None else 0.0
        self._looked_at_s = now_s
        return since_s if since_s > MIN_PAUSE_S else 0.0


# Who is continued sooner goes on as if nothing had been.
STOP_TIMEOUT_S = 5.0
STOP_POLL_PERIOD_S = 0.25
_STOPPED_STATE = "T"
_MAX_LAUNCHER_DEPTH = 8


def can_detect_stops() -> bool:
    """Return whether this machine shows which processes are stopped."""
    return sys.platform == "linux" and _read_state(os.getpid()) is not None


def is_stopped(pid: int) -> bool:
    """Return whether a process has been stopped by a signal; false where nobody can tell.

    It counts as stopped, too, when its only child is: a launcher, such as a sandbox, just waits for what it has
    started. A process that a debugger holds is not stopped.
    """
    return any(_read_state(each) == _STOPPED_STATE for each in _read_stat(pid))


def is_stopped_itself(pid: int) -> bool:
    """Return whether a process has been stopped by a signal, whatever it has started; false where nobody can tell."""
    return _read_state(pid) == _STOPPED_STATE


def describe_stop() -> str:
    """Return what to say of a process that was stopped for too long, after its name."""
    return f"was stopped by a signal and not continued within {STOP_TIMEOUT_S:g} s"


class StopDetector:
    """Decides who has been stopped for too long. It reads no clock: times [s] of a monotonic one are handed in."""

    def __init__(self, limit_s: float = STOP_TIMEOUT_S) -> None:
        self._limit_s = limit_s
        self._since_s: dict[str, float] = {}
        self._pauses = PauseDetector()

    def look(self, stopped: Collection[str], now_s: float) -> list[str]:
        """Take note of who is stopped now, several times a second; return who has been for longer than the limit."""
        # While this process stood still itself, nobody could see others go on.
        missed_s = self._pauses.missed_s(now_s)
        self._since_s = {name: self._since_s.get(name, now_s - missed_s) + missed_s for name in stopped}
        return [name for name, since_s in self._since_s.items() if now_s - since_s > self._limit_s]


class StopMonitor:
    """Looks a few times a second, on a thread of its own, for processes that are stopped, while it is entered.

    A stopped process neither reads nor ends, so that who sends to it waits, too. After the limit `on_stopped(name)` is
    called, and its process group killed.

    Args:
        pids: Returns the processes by name; 0 stands for one that has not begun.
        on_stopped: Receives a name, on the watch's thread.
    """

    def __init__(self, pids: Callable[[], Mapping[str, int]], on_stopped: Callable[[str], object]) -> None:
        self._pids = pids
        self._on_stopped = on_stopped
        self._stops = StopDetector()
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        if can_detect_stops():
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _watch(self) -> None:
        reported: set[str] = set()
        while not self._is_over.wait(STOP_POLL_PERIOD_S):
            pids = {name: pid for name, pid in self._pids().items() if pid}
            stopped = [name for name, pid in pids.items() if is_stopped(pid)]
            for name in self._stops.look(stopped, time.monotonic()):
                if name not in reported:
                    reported.add(name)
                    self._on_stopped(name)
                _kill(pids[name])


# A launcher's child that was stopped at its beginning may not have been told yet to end with the launcher, and a
# process that has just begun leads no group.
def _kill(pid: int) -> None:
    for each in reversed(_read_stat(pid)):
        for kill in (os.killpg, os.kill):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                kill(each, signal.SIGKILL)


# A process, its only child, the only child of that.
def _read_stat(pid: int) -> list[int]:
    line = [pid]
    while len(line) <= _MAX_LAUNCHER_DEPTH and len(children := _list_children(line[-1])) == 1:
        line += children
    return line


def _read_state(pid: int) -> str | None:
    try:
        # The name before it stands in brackets and may hold anything.
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[0]
    except (OSError, IndexError):
        return None


def _list_children(pid: int) -> list[int]:
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except (OSError, ValueError):
        return []
