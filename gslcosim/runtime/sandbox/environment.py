"""Environment of an agent's process: what every program needs, and what the scenario names."""

import os
import sys
from collections.abc import Mapping, Sequence

from gslcosim.errors import UsageError
from gslcosim.runtime.sandbox.choosing import Confined

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


def environment_for(
    agent: Confined, command: Sequence[str], surroundings: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return the variables with which the process of an agent or participant starts; those of the run come on top.

    Args:
        agent: The agent or participant.
        command: What starts it.
        surroundings: From which variables are taken; absent: this process's own.

    Raises:
        UsageError: the scenario passes on a variable that is not set.
    """
    around = os.environ if surroundings is None else surroundings
    is_ours = command[0] == sys.executable
    passed_on = {
        name: value
        for name, value in around.items()
        if name in PASSED_ON or name.startswith(PASSED_ON_PREFIXES) or (is_ours and name in _OF_PYTHON)
    }
    return passed_on | {name: _value(agent, name, value, around) for name, value in (agent.environment or {}).items()}


def _value(agent: Confined, name: str, value: str | None, around: Mapping[str, str]) -> str:
    if value is not None:
        return value
    if name not in around:
        raise UsageError(
            f"{agent.place}.environment.{name}: expected a variable that is set where gslcosim starts, since it has "
            "no value here, was unset. Set it, or write its value."
        )
    return around[name]
