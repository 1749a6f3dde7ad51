"""Detection of processes that a signal has stopped, and of pauses of this one."""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Self

MIN_PAUSE_S = 1.0
# A process that is continued sooner goes on without consequences.
STOP_TIMEOUT_S = 5.0
STOP_POLL_PERIOD_S = 0.25
_STOPPED_STATE = "T"
_MAX_LAUNCHER_DEPTH = 8


class PauseDetector:
    """Detector of pauses of this process, from calls that come many times a second.

    Anything awaited during a pause is not late: holders of deadlines move them by the length of the pause. The
    detector reads no clock: times [s] of a monotonic clock are passed in. That clock does not run while a machine is
    suspended.
    """

    def __init__(self) -> None:
        self._looked_at_s: float | None = None

    def missed_s(self, now_s: float) -> float:
        """Return the time [s] since the last call if it is far longer than usual, else 0."""
        since_s = now_s - self._looked_at_s if self._looked_at_s is not None else 0.0
        self._looked_at_s = now_s
        return since_s if since_s > MIN_PAUSE_S else 0.0


def can_detect_stops() -> bool:
    """Return whether this machine shows which processes are stopped."""
    return sys.platform == "linux" and _read_state(os.getpid()) is not None


def is_stopped(pid: int) -> bool:
    """Return whether a process has been stopped by a signal; False if unknown.

    A process also counts as stopped when its only child is: a launcher, such as a sandbox, only waits for its child. A
    process that a debugger holds is not stopped.
    """
    return any(_read_state(each) == _STOPPED_STATE for each in _follow_only_children(pid))


def is_stopped_itself(pid: int) -> bool:
    """Return whether a process itself has been stopped by a signal, whatever its children; False if unknown."""
    return _read_state(pid) == _STOPPED_STATE


def describe_stop() -> str:
    """Return the text for a process that was stopped for too long, to follow its name."""
    return f"was stopped by a signal and not continued within {STOP_TIMEOUT_S:g} s"


class StopDetector:
    """Detector of processes stopped for too long. It reads no clock: times [s] of a monotonic one are passed in."""

    def __init__(self, limit_s: float = STOP_TIMEOUT_S) -> None:
        self._limit_s = limit_s
        self._since_s: dict[str, float] = {}
        self._pauses = PauseDetector()

    def look(self, stopped: Collection[str], now_s: float) -> list[str]:
        """Record the processes stopped now, several times a second; return those stopped for longer than the limit."""
        # While this process itself was paused, it could not see others go on.
        missed_s = self._pauses.missed_s(now_s)
        self._since_s = {name: self._since_s.get(name, now_s - missed_s) + missed_s for name in stopped}
        return [name for name, since_s in self._since_s.items() if now_s - since_s > self._limit_s]


class StopMonitor:
    """Monitor that looks for stopped processes a few times a second, on a thread of its own, while it is entered.

    A stopped process neither reads nor ends, so its senders wait too. After the limit `on_stopped(name)` is called, and
    the process group of the process is killed.

    Args:
        pids: Returns the processes by name; 0 stands for one that has not begun.
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


# The child of a launcher, stopped at its beginning, may not be set yet to end with the launcher, and a process that has
# just begun leads no group.
def _kill(pid: int) -> None:
    for each in reversed(_follow_only_children(pid)):
        for kill in (os.killpg, os.kill):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                kill(each, signal.SIGKILL)


# A process, its only child, the only child of that child, and so on.
def _follow_only_children(pid: int) -> list[int]:
    line = [pid]
    while len(line) <= _MAX_LAUNCHER_DEPTH and len(children := _list_children(line[-1])) == 1:
        line += children
    return line


def _read_state(pid: int) -> str | None:
    try:
        # The name before it is in brackets and may contain any characters.
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[0]
    except (OSError, IndexError):
        return None


def _list_children(pid: int) -> list[int]:
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except (OSError, ValueError):
        return []
