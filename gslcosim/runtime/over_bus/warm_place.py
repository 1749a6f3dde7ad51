"""Where a warm server of this user is found, and what it must have in common with those that it flies for."""

import hashlib
import os
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import gslcosim
from gslcosim._kernel_cache import PACKAGE_DIR, cache_root
from gslcosim.runtime.watching.own_process import user_id

# What libraries read once, when they are imported.
_READ_AT_IMPORT = ("NUMBA_", "PYTHON")
_NOT_READ = ("PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED")


def warm_folder() -> Path:
    """Return the private folder of this user's warm server; it need not exist."""
    return Path(tempfile.gettempdir()) / f".gslcosim-server-{user_id()}"


def warm_socket() -> Path:
    """Return the unix socket at which this user's warm server listens; it need not exist."""
    return warm_folder() / "server.sock"


def warm_secret() -> Path:
    """Return the file with what a caller has to know; it is made anew by each server, and hidden from sandboxes."""
    return warm_folder() / "secret"


def identity() -> dict[str, str]:
    """Return what a server has imported or what would be imported now, each part by its name in messages.

    The code counts by name, size and time of each file of the package, whatever kind it is; other packages by the times
    of the folders that they are installed in.
    """
    environ = {key: value for key, value in os.environ.items() if key.startswith(_READ_AT_IMPORT)}
    return {
        "version": gslcosim.__version__,
        "Python": f"{sys.executable} {sys.version}",
        "code": _hash_of(_facts_of(PACKAGE_DIR)),
        "installed packages": _hash_of(
            [(place, _changed_ns(Path(place))) for place in sys.path if place.endswith("-packages")]
        ),
        "cache": str(cache_root()),
        "environment": " ".join(f"{key}={environ[key]}" for key in sorted(environ) if key not in _NOT_READ),
    }


def differences(ours: Mapping[str, str], theirs: Mapping[str, object]) -> list[str]:
    """Return the parts in which a server is another one than those it is to fly for."""
    return [part for part, value in ours.items() if theirs.get(part) != value]


def n_threads() -> int:
    """Return how many threads this process has; Linux only."""
    return sum(1 for _ in Path("/proc/self/task").iterdir())


def _facts_of(folder: Path) -> list[tuple[str, int, int]]:
    facts: list[tuple[str, int, int]] = []
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                facts += _facts_of(Path(entry.path)) if entry.name != "__pycache__" else []
            else:
                facts.append((entry.path, entry.stat().st_size, entry.stat().st_mtime_ns))
    return sorted(facts)


def _changed_ns(place: Path) -> int:
    try:
        return place.stat().st_mtime_ns
    except OSError:
        return 0


def _hash_of(facts: object) -> str:
    return hashlib.blake2b(repr(facts).encode(), digest_size=8).hexdigest()
