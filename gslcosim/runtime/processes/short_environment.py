"""Short environment in which programs of other people start: nothing of the user's but what every program needs."""

import os
import sys
from collections.abc import Mapping, Sequence

# Where programs and their libraries are, the user's language and time, private folders, and numbers of threads.
PASSED_ON = frozenset((
    "PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "LANG", "LANGUAGE", "TZ", "HOME", "TMPDIR",
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS", "RAYON_NUM_THREADS", "GOMAXPROCS", "JULIA_NUM_THREADS",
    # Where compiled kernels are: an agent without a sandbox uses the same.
    "GSLCOSIM_CACHE", "XDG_CACHE_HOME",
    # Without these there is no process on Windows.
    "SYSTEMROOT", "PATHEXT", "TEMP", "TMP",
))  # fmt: skip
PASSED_ON_PREFIXES = ("LC_", "NUMBA_")
# Of our own Python: how it finds its packages and writes.
_OF_PYTHON = frozenset((
    "PYTHONPATH", "PYTHONHOME", "PYTHONNOUSERSITE", "PYTHONUSERBASE", "PYTHONUNBUFFERED", "PYTHONDONTWRITEBYTECODE",
    "PYTHONUTF8", "PYTHONIOENCODING", "PYTHONHASHSEED",
))  # fmt: skip


def build_short_environment(command: Sequence[str], surroundings: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the variables with which a program of an agent or participant starts.

    Args:
        command: What starts it; gslcosim's own Python gets Python's variables too.
        surroundings: From which variables are taken; absent: this process's own.
    """
    around = os.environ if surroundings is None else surroundings
    is_ours = bool(command) and command[0] == sys.executable
    return {
        name: value
        for name, value in around.items()
        if name in PASSED_ON or name.startswith(PASSED_ON_PREFIXES) or (is_ours and name in _OF_PYTHON)
    }
