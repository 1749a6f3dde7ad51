"""What this process has taken of the machine so far."""

import contextlib
import os
import sys
import time
from pathlib import Path

_KIB = 1024
_ROLLUP = Path("/proc/self/smaps_rollup")


def cpu_s() -> float:
    """Return the CPU time of all threads of this process so far [s]."""
    return time.process_time()


def memory_bytes() -> int | None:
    """Return the memory of this process: what it alone holds, and its share of what it has in common with others.

    None where the system does not tell.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in _ROLLUP.read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) * _KIB
    return None


def user_id() -> int:
    """Return the number of the user; 0 where users have none."""
    return 0 if sys.platform == "win32" else os.getuid()
