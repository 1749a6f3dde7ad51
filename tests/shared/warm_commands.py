"""Commands of gslcosim in forks of a process that has imported everything, and has run once.

A fork is a process of its own, with all the processes that a command starts; it only does without seconds of imports.
Commands of pages, and those under limits of the machine, start from nothing instead.
"""

import atexit
import contextlib
import importlib
import io
import itertools
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from gslcosim import __main__ as entry_point
from gslcosim.base.spawn import Streams, spawn
from gslcosim.cli.main import main
from gslcosim.runtime.distributed import service_main
from gslcosim.runtime.processes import fork_server
from gslcosim.runtime.processes.current_process import set_process_title
from gslcosim.runtime.processes.fork_server import FORK_SERVER, ForkedProcess, ForkServer, ForkWork, fork_child

TINY_ROOM = Path(__file__).resolve().parents[2] / "scenarios" / "tiny_room.yaml"
# Variables that a command reads when it needs them, and not when it is imported.
READ_LATE = frozenset(("DISPLAY", "LD_LIBRARY_PATH", "PATH", "TMPDIR", "WAYLAND_DISPLAY"))
_NUMBERS = itertools.count()


class WarmCommand:
    """A command in a fork, used like a `subprocess.Popen` whose output is text."""

    def __init__(self, process: ForkedProcess, outputs: Sequence[Path]) -> None:
        self._process, self._outputs = process, outputs
        while not process.pid:
            assert process.poll() is None, "the server of warm commands has ended"
            time.sleep(0.001)
        self.pid = process.pid
        self.poll, self.wait = process.poll, process.wait

    @property
    def returncode(self) -> int | None:
        return self.poll()

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Wait for the end; return what was written to standard output and standard error."""
        self.wait(timeout)
        output, errors = (path.read_text() for path in self._outputs)
        return output, errors


def start_warm(words: Sequence[str], cwd: Path, variables: Mapping[str, str]) -> WarmCommand | None:
    """Start `gslcosim WORDS` in a fork; None where the server has other variables that are read at imports."""
    if not ForkServer.is_possible():
        return None
    server, wanted = _Server.get(), {**_list_variables(), **variables}
    if {name for name, _ in wanted.items() ^ server.variables.items()} - READ_LATE:
        return None
    outputs = [server.folder / f"{next(_NUMBERS)}.{name}" for name in ("out", "err")]
    request = {"words": list(words), "cwd": str(cwd), "variables": wanted, "output": str(outputs[0])}
    return WarmCommand(server.process.fork(outputs[1].stem, request, log=outputs[1]), outputs)


def _list_variables() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}


@dataclass(frozen=True)
class _Server:
    process: ForkServer
    variables: Mapping[str, str]
    folder: Path

    @staticmethod
    @cache
    def get() -> "_Server":
        # The temporary directory may be that of one test.
        folder = tempfile.TemporaryDirectory(prefix="gsl-warm-", dir="/tmp")
        atexit.register(folder.cleanup)
        server = ForkServer((__file__,))
        atexit.register(server.close)
        return _Server(server, _list_variables(), Path(folder.name))


# All below is the server's.
def _import_everything() -> None:
    service_main.import_shared_modules()
    importlib.import_module("gslcosim.runtime.distributed.process_launch")
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        options = ("--in-process", "--json", "--set", "recording.enabled=false", "--runs-dir", folder)
        assert main(["up", str(TINY_ROOM), *options]) == 0
    fork_server.spawn = _spawn_or_fork
    assert _has_one_thread(), "a process that forks has one thread"


# A thread that was joined may be about to end.
def _has_one_thread() -> bool:
    deadline = time.monotonic() + 1.0
    while (n_threads := len(list(Path("/proc/self/task").iterdir()))) > 1 and time.monotonic() < deadline:
        time.sleep(0.001)
    return n_threads == 1


def _become_command(request: Mapping[str, Any]) -> None:
    with open(request["output"], "w") as output:  # noqa: PTH123 - as a shell does
        os.dup2(output.fileno(), 1)
    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["variables"])
    tempfile.tempdir = None
    signal.signal(signal.SIGINT, signal.default_int_handler)
    set_process_title(f"{sys.executable} -m gslcosim {request['words'][0]}")
    sys.argv = ["gslcosim", *request["words"]]
    sys.exit(entry_point.main())


@dataclass(frozen=True)
class _Child:
    pid: int

    def wait(self) -> int:
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


# The command's own fork server needs the same imports: it is a fork of the command, which has one thread so far.
def _spawn_or_fork(name: str, command: Sequence[str], *, environment: Mapping[str, str], streams: Streams,
                   inherited: Sequence[int]) -> "_Child | subprocess.Popen[bytes]":  # fmt: skip
    if name != FORK_SERVER or not _has_one_thread():
        return spawn(name, command, environment=environment, streams=streams, inherited=inherited)

    def serve() -> None:
        (kept,) = inherited
        log = streams.stdout
        assert log is not None
        for number, source in enumerate((os.open(os.devnull, os.O_RDWR), log, log)):
            os.dup2(source, number)
        others = {int(path.name) for path in Path("/proc/self/fd").iterdir()} - {0, 1, 2, kept}
        for number in others:
            with contextlib.suppress(OSError):
                os.close(number)
        os.environ.clear()
        os.environ.update(environment)
        set_process_title(" ".join(command))
        service_main.main(command[command.index("--fork-server") :])

    pid = fork_child(serve)
    for number in inherited:
        os.close(number)
    return _Child(pid)


if __name__ == "__main__":
    fork_server.serve_forks(int(sys.argv[1]), ForkWork(become=_become_command, preload=_import_everything, early={}))
