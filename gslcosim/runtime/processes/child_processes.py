"""Child processes of a run: started, logged, watched for stops, and ended, so that none is ever left over."""

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from io import FileIO
from pathlib import Path
from typing import TypedDict, Unpack, cast

from gslcosim.base.processes import describe_exit
from gslcosim.base.spawn import Streams, build_short_environment, check_program, signal_group, spawn
from gslcosim.bus.interface import GATEWAY_VARIABLE, JOIN_VARIABLES, TOKEN_VARIABLE, JoinData
from gslcosim.gateway.connections import Listener, PipeStream, Stream
from gslcosim.runtime.processes.fork_server import ForkedProcess
from gslcosim.runtime.processes.process_log import ProcessLog
from gslcosim.runtime.processes.sandbox.launcher_client import Confinement, Launch, is_launcher_possible

EXIT_TIMEOUT_S = 3.0
TERM_TIMEOUT_S = 2.0
# A descendant that has left the process group may hold its output open for ever.
LOG_TIMEOUT_S = 0.5


# It leads its own process group, so that its descendants end with it.
ChildProcess = subprocess.Popen[bytes] | ForkedProcess


class ProcessOptions(TypedDict, total=False):
    """Options of a process to start: absent ones are as in this process, or without effect.

    `cwd` is the working directory, `join` holds the data for joining the bus, `variables` are added to the environment,
    `confinement` restricts a third-party program, `keep` are further descriptors that the process inherits.
    """

    cwd: Path | None
    join: JoinData | None
    variables: Mapping[str, str]
    confinement: Confinement | None
    keep: Sequence[int]


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
        self._logs: dict[str, ProcessLog] = {}

    def __enter__(self) -> "ChildProcesses":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def start(self, name: str, command: Sequence[str], *, log: Path | None, **options: Unpack[ProcessOptions]) -> None:
        """Start a process; its output goes to a log file, and its end is reported at once.

        Without a log it has the standard streams of this process.
        """
        if log is None:
            self._start(name, command, Streams(None, None, None), **options)
            return
        with self._log(name, log) as output:
            self._start(name, command, Streams(stdout=output.fileno()), **options)

    def start_behind_gateway(
        self,
        name: str,
        command: Sequence[str],
        listener: Listener | None,
        on_stream: Callable[[Stream], object],
        *,
        log: Path,
        **options: Unpack[ProcessOptions],
    ) -> None:
        """Start a process that finds a listener of the gateway in its environment, or without one has pipes."""
        if listener is not None:
            gateway = {GATEWAY_VARIABLE: listener.address, TOKEN_VARIABLE: listener.token}
            options["variables"] = {**options.get("variables", {}), **gateway}
            self.start(name, command, log=log, **options)
            return
        # Only its errors are logged.
        with self._log(name, log) as errors:
            process = self._start(name, command, Streams(subprocess.PIPE, subprocess.PIPE, errors.fileno()), **options)
        # Without buffers these are raw files.
        on_stream(PipeStream(cast(FileIO, process.stdin), cast(FileIO, process.stdout)))

    def _start(
        self, name: str, command: Sequence[str], streams: Streams, **options: Unpack[ProcessOptions]
    ) -> "subprocess.Popen[bytes]":
        cwd, confinement = options.get("cwd"), options.get("confinement")
        check_program(name, command, cwd)
        # A participant of one run that starts another run must not pass on its own join data.
        around = build_short_environment(command) if self._are_foreign else os.environ
        around = around if confinement is None else confinement.environment
        environment = {key: value for key, value in around.items() if not key.startswith(JOIN_VARIABLES)}
        join = options.get("join")
        joining, inherited = ({}, options.get("keep", ())) if join is None else join.hand_over()
        environment |= {**joining, **options.get("variables", {})}
        launch = None
        if confinement is not None and is_launcher_possible():
            launch = Launch(
                confinement,
                command,
                environment=environment,
                directory=cwd or Path.cwd(),
                has_pipes=streams.are_pipes,
                keep=inherited,
            )
            command, inherited = launch.command, launch.descriptors
            # Neither the agent's variables nor its folder: both can name libraries, which would be loaded unconfined.
            environment, cwd = build_short_environment(command), Path("/")
        process = spawn(
            name,
            command,
            environment=environment,
            cwd=cwd,
            streams=streams,
            inherited=inherited,
            # The launcher ends with this process, and its descendants end with the launcher.
            ends_with_parent=launch is None,
        )
        self.adopt(name, process, launch)
        return process

    def adopt(self, name: str, process: ChildProcess, launch: Launch | None = None) -> None:
        """Watch a process that leads its own process group, and end it with the others."""
        self._children[name] = process
        threading.Thread(target=self._wait_for, args=(name, process, launch), daemon=True).start()

    @property
    def pids(self) -> dict[str, int]:
        """The numbers of the processes that have not ended, 0 for one that has not begun."""
        # A copy at once: processes are added while another thread asks.
        return {name: process.pid for name, process in list(self._children.items()) if process.poll() is None}

    def wait(self, limit_s: float) -> None:
        """Wait until all processes have ended, or until the limit."""
        deadline = time.monotonic() + limit_s
        for process in self._children.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=max(0.0, deadline - time.monotonic()))

    def end(self) -> None:
        """End all processes that still run: ask, wait a moment, then kill whole process groups."""
        if remaining := self.pids.values():
            for pid in remaining:
                signal_group(pid, signal.SIGTERM)
                signal_group(pid, signal.SIGCONT)
            self.wait(TERM_TIMEOUT_S)
        for process in self._children.values():
            signal_group(process.pid, signal.SIGKILL)
        # A stopped fork server reports no ends of its forks; it is ended next, and Linux ends the forks with it.
        self.wait(TERM_TIMEOUT_S)
        for log in self._logs.values():
            log.wait(LOG_TIMEOUT_S)
        self._logs.clear()

    def _log(self, name: str, path: Path) -> ProcessLog:
        self._logs[name] = ProcessLog(path)
        return self._logs[name]

    def _wait_for(self, name: str, process: ChildProcess, launch: Launch | None) -> None:
        code = process.wait()
        how = (launch.log_tail() if launch is not None else "") or describe_exit(code)
        hint = launch.hidden_files_hint() if launch is not None and code > 0 else ""
        # The report of an end quotes the log, to which the last words may still be on their way.
        if (log := self._logs.get(name)) is not None:
            log.wait(LOG_TIMEOUT_S)
        self._on_exit(name, code, how + hint)
