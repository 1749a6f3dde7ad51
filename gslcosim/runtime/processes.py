"""Starting, watching and ending the processes of a run, so that none is ever left over."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.bus.port import JOIN_VARIABLE, Join
from gslcosim.errors import UsageError

GRACE_S = 2.0


@dataclass
class Child:
    """A process of the run. It leads its own process group, so that its descendants end with it."""

    name: str
    process: "subprocess.Popen[bytes]"

    @property
    def is_running(self) -> bool:
        """Whether the process has not ended yet."""
        return self.process.poll() is None

    def signal_group(self, number: int) -> None:
        """Send a signal to the process and all its descendants."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, number)


class Children:
    """All processes that the supervisor has started; leaving the context ends them."""

    def __init__(self, on_exit: Callable[[str, int], None]) -> None:
        self._on_exit = on_exit
        self._children: dict[str, Child] = {}

    def __enter__(self) -> "Children":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def start(self, name: str, command: Sequence[str], *, join: Join, log: Path, cwd: Path | None = None) -> None:
        """Start a process with its join data; its output goes to a log file, and its end is reported at once.

        Raises:
            UsageError: the command cannot be started.
        """
        environment = {**os.environ, JOIN_VARIABLE: join.model_dump_json(exclude_none=True)}
        try:
            with log.open("ab") as output:
                process = subprocess.Popen(
                    [*_ending_with_parent(), *command],
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    env=environment,
                    cwd=cwd,
                    start_new_session=True,
                )
        except OSError as error:
            raise UsageError(f"{name}: expected a command that starts, was {list(command)} ({error}).") from error
        self._children[name] = Child(name, process)
        threading.Thread(target=self._wait_for, args=(name, process), daemon=True).start()

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
            child.process.wait()

    def _wait_for(self, name: str, process: "subprocess.Popen[bytes]") -> None:
        self._on_exit(name, process.wait())


def exit_text(code: int) -> str:
    """Return in words how a process ended."""
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"was killed by signal {-code}"


def python_command(*arguments: str) -> list[str]:
    """Return a command line for this Python, without the working directory on its import path."""
    return [sys.executable, "-P", *arguments]


# A supervisor that is killed cannot end its children; Linux can, when told so before the program starts.
def _ending_with_parent() -> list[str]:
    setpriv = shutil.which("setpriv")
    return [setpriv, "--pdeathsig", "KILL"] if sys.platform == "linux" and setpriv else []
