"""Processes that outlive the agent that started them: found as children that nobody here has started (Linux)."""

import contextlib
import ctypes
import os
import signal
import sys
import threading
from pathlib import Path

MARK_VARIABLE = "GSLCOSIM_CHECK"
_PR_SET_CHILD_SUBREAPER = 36
_MAX_SHOWN = 80
_PROC = Path("/proc")
# Several checks may share this process: each finds its own by the mark, and one alone those without any, too.
_LOCK = threading.Lock()
_ACTIVE: set[str] = set()


class Orphans:
    """What one start of an agent leaves behind.

    A process whose parent ends becomes a child of the nearest ancestor that asks for such. While an agent lives this
    process asks. A mark in the agent's environment, which its descendants inherit, tells them from others.
    """

    def __init__(self, mark: str) -> None:
        self.variables = {MARK_VARIABLE: mark}
        self._mark = f"{MARK_VARIABLE}={mark}".encode()
        self._before: frozenset[int] = frozenset()

    @staticmethod
    def is_possible() -> bool:
        """Return whether this system tells."""
        return sys.platform == "linux"

    def begin(self) -> None:
        """Ask for descendants that lose their parents; to be called before the agent starts."""
        with _LOCK:
            self._before = frozenset(_children())
            _ACTIVE.add(self._mark.decode())
            _ask_for_orphans(is_asking=True)

    def end(self) -> tuple[str, ...]:
        """End what is left of the agent after its process and its group have ended; return it in words."""
        found: list[str] = []
        while left := self._left():
            for pid in left:
                found.append(f"{_command_of(pid)} (process {pid})")
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)
                with contextlib.suppress(ChildProcessError):
                    os.waitpid(pid, 0)
        with _LOCK:
            _ACTIVE.discard(self._mark.decode())
            _ask_for_orphans(is_asking=bool(_ACTIVE))
        return tuple(found)

    def _left(self) -> list[int]:
        return [pid for pid in _children() if self._is_mine(pid)]

    def _is_mine(self, pid: int) -> bool:
        try:
            variables = (_PROC / str(pid) / "environ").read_bytes().split(b"\0")
        except OSError:
            return False
        if self._mark in variables:
            return True
        is_marked = any(variable.startswith(MARK_VARIABLE.encode()) for variable in variables)
        return not is_marked and len(_ACTIVE) == 1 and pid not in self._before


# Living ones only: what is dead does nothing any more, and its parent's record of it may be somebody else's to read.
def _children() -> list[int]:
    found: list[int] = []
    for folder in _PROC.glob("[0-9]*"):
        try:
            state, parent = (folder / "stat").read_text(errors="replace").rpartition(")")[2].split()[:2]
        except (OSError, ValueError):
            continue
        if int(parent) == os.getpid() and state not in "ZX":
            found.append(int(folder.name))
    return found


def _command_of(pid: int) -> str:
    try:
        words = (_PROC / str(pid) / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
    except OSError:
        words = ""
    return words if len(words) <= _MAX_SHOWN else f"{words[: _MAX_SHOWN - 3]}..."


def _ask_for_orphans(*, is_asking: bool) -> None:
    if Orphans.is_possible():
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, int(is_asking), 0, 0, 0)
