"""Starting, watching and ending the processes of a run, so that none is ever left over."""

import contextlib
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from types import MappingProxyType
from typing import Protocol, cast

from gslcosim.bus.port import INHERITED_FILES, JOIN_VARIABLE, Join
from gslcosim.command_lines import ending_with_parent, exit_text
from gslcosim.errors import UsageError
from gslcosim.machine import LACKING, machine_error
from gslcosim.runtime.process_log import ProcessLog
from gslcosim.runtime.sandbox.launching import Confinement, Launch, file_of, is_launcher_possible

EXIT_LIMIT_S = 3.0
GRACE_S = 2.0
# A descendant that has left the process group may hold its output open for ever.
LOG_LIMIT_S = 0.5
# What a process of a run is told in its environment.
OUR_VARIABLES = (JOIN_VARIABLE, "GSLCOSIM_AGENT", "GSLCOSIM_GATEWAY", "GSLCOSIM_TOKEN")


class Process(Protocol):
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
class Child:
    """A process of the run. It leads its own process group, so that its descendants end with it."""

    name: str
    process: Process

    @property
    def is_running(self) -> bool:
        """Whether the process has not ended yet."""
        return self.process.poll() is None

    def signal_group(self, number: int) -> None:
        """Send a signal to the process and all its descendants."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if self.process.pid:
                os.killpg(self.process.pid, number)


class Children:
    """All processes that the supervisor has started; leaving the context ends them.

    Args:
        on_exit: Is told a process that has ended, its exit code, and in words how it ended, on a thread of its own.
    """

    def __init__(self, on_exit: Callable[[str, int, str], object]) -> None:
        self._on_exit = on_exit
        self._children: dict[str, Child] = {}
        self._logs: list[ProcessLog] = []

    def __enter__(self) -> "Children":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def start(
        self,
        name: str,
        command: Sequence[str],
        *,
        join: Join,
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
        inherited = file_of(text) if INHERITED_FILES.is_dir() else None
        place = text if inherited is None else str(INHERITED_FILES / str(inherited))
        variables = {JOIN_VARIABLE: place, **variables}
        keep = () if inherited is None else (inherited,)
        self._start_logged(name, command, variables, log, cwd, confinement=confinement, keep=keep)

    def start_guest(
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
        """Start a process as `start_guest`, but return its standard input and output; only its errors are logged.

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
        around = os.environ if confinement is None else confinement.environment
        environment = {key: value for key, value in around.items() if not key.startswith(OUR_VARIABLES)}
        environment |= variables
        line, descriptors, launch = [*ending_with_parent(), *command], keep, None
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
            if error.errno in LACKING:
                raise machine_error(error, name, "a process that starts") from error
            raise UsageError(f"{name}: expected a command that starts, was {list(command)} ({error}).") from error
        finally:
            for descriptor in descriptors:
                os.close(descriptor)
        self.adopt(name, process, launch)
        return process

    def adopt(self, name: str, process: Process, launch: Launch | None = None) -> None:
        """Watch a process that leads its own process group, and end it with the others."""
        self._children[name] = Child(name, process)
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
            self.wait(GRACE_S)
        for child in self._children.values():
            child.signal_group(signal.SIGKILL)
        # Who forked one may be stopped and not tell its end; it is ended next, and Linux ends the forks with it.
        self.wait(GRACE_S)
        for log in self._logs:
            log.wait(LOG_LIMIT_S)
        self._logs.clear()

    def _log(self, path: Path) -> ProcessLog:
        self._logs.append(ProcessLog(path))
        return self._logs[-1]

    def _wait_for(self, name: str, process: Process, launch: Launch | None) -> None:
        code = process.wait()
        self._on_exit(name, code, (launch.last_words() if launch is not None else "") or exit_text(code))


def check_program(name: str, command: Sequence[str], cwd: Path | None) -> None:
    """Refuse a command line whose program is not there.

    Raises:
        UsageError: it cannot be found, or not be executed.
    """
    program = Path(cwd or ".") / command[0] if "/" in command[0] else shutil.which(command[0])
    if program is None or not os.access(program, os.X_OK) or Path(program).is_dir():
        reason = "no such program" if program is None or not Path(program).exists() else "it cannot be executed"
        raise UsageError(f"{name}: expected a command that starts, was {list(command)} ({reason}).")
