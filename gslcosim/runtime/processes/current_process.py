"""Current process as the operating system sees it: its title, its private memory, its usage."""

import contextlib
import ctypes
import sys
from pathlib import Path

_ARG_START, _ARG_END = 48, 49
_PR_SET_DUMPABLE = 4
_KIB = 1024
_ROLLUP = Path("/proc/self/smaps_rollup")
_MADV_DONTNEED = 4


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


def release_code(library: str) -> None:
    """Give back the memory of a library's code; Linux only.

    The system reads it again where it is called.

    Args:
        library: Part of the name of its file.
    """
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/maps").read_text().splitlines():
            places, rights, *_, file = line.split(maxsplit=5)
            if library in file and rights.startswith("r-x"):
                start, end = (int(place, 16) for place in places.split("-"))
                ctypes.CDLL(None).madvise(ctypes.c_void_p(start), ctypes.c_size_t(end - start), _MADV_DONTNEED)


def read_memory_bytes() -> int | None:
    """Return the memory of this process: what it alone holds, and its share of what it has in common with others.

    None where the system does not say.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in _ROLLUP.read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) * _KIB
    return None
