"""Current process as the operating system sees it: its title, its private memory, its usage."""

import contextlib
import ctypes
import sys
from pathlib import Path

_ARG_START, _ARG_END = 48, 49
_PR_SET_DUMPABLE = 4
_KIB = 1024
_ROLLUP = Path("/proc/self/smaps_rollup")


def set_process_title(title: str) -> None:
    """Show a command line in place of the one that the process was started with, as far as it fits; Linux only.

    Tools read it from where the kernel has put the program's arguments, so it is overwritten there.
    """
    if sys.platform != "linux":
        return
    try:
        fields = Path("/proc/self/stat").read_text().rsplit(")", 1)[1].split()
        start, end = (int(fields[number - 3]) for number in (_ARG_START, _ARG_END))
    except (OSError, ValueError, IndexError):
        return
    if 0 < start < end:
        words = title.encode().replace(b" ", b"\0")[: end - start - 1]
        ctypes.memmove(start, words.ljust(end - start, b"\0"), end - start)


def keep_memory_private() -> None:
    """Let no other process of this user read this one's memory or environment, where the run's passwords are.

    Linux only, and not against root; elsewhere nothing is changed. Ends the possibility of core dumps and of attaching
    a debugger.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_DUMPABLE, 0)


def read_memory_bytes() -> int | None:
    """Return the memory of this process: what it alone holds, and its share of what it has in common with others.

    None where the system does not say.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in _ROLLUP.read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) * _KIB
    return None
