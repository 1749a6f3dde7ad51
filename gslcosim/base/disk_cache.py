"""Entries of gslcosim's cache on disk: their sizes, their use, and their eviction.

An entry is in use as long as a process that has marked it lives, or a fork of such a process: each process keeps a
locked file in `leases` with its entries. A folder's modification time is the time of its last use.
"""

import contextlib
import os
import re
import secrets
import sys
import threading
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import GslCosimError, UsageError, build_path_error
from gslcosim.base.files import hold_lock, remove_tree
from gslcosim.base.kernel_cache import get_cache_root

if sys.platform != "win32":
    import fcntl

LIMIT_VARIABLE = "GSLCOSIM_CACHE_LIMIT"
DEFAULT_LIMIT_BYTES = 5_000_000_000
UNUSED_KERNELS_S = 30 * 86400.0
"""Time without use [s] after which kernels of other versions of the code, which nothing loads any more, are evicted."""

FOLDERS = {"room": "environments", "tape": "tapes", "kernels": "numba", "files": "shipped", "program": "agents"}
"""Folder of each kind of entry: rooms with their wind, stored gas, compiled kernels, files of suites from other hosts,
and programs of agents that make has built."""

# Entries that nothing rebuilds by itself are not evicted.
_EVICTED_KINDS = ("room", "tape", "kernels", "files")
_LEASES, _LOCK, _EVICTED = "leases", ".lock", ".evicted."
# An entry under construction has another name, and is a leftover after this time without changes.
_UNFINISHED_S = 86400.0
_FINISHED = re.compile(r"[0-9a-f]{8,}(-\d+)?")
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([KMGT]?)(i?)B?", re.IGNORECASE)
_BLOCK_BYTES = 512


@dataclass(frozen=True, kw_only=True)
class CacheEntry:
    """A folder that can be removed as a whole; its user builds it again."""

    kind: str
    folder: Path
    size_bytes: int
    used_at_s: float
    is_in_use: bool

    @property
    def is_evictable(self) -> bool:
        """True if it may be removed without a user's request."""
        return self.kind in _EVICTED_KINDS and not self.is_in_use


def mark_used(folder: Path) -> None:
    """Mark an entry of the cache as used by this process, for as long as the process and its forks live.

    Folders outside the cache are ignored. A cache that cannot be written needs no marks: nothing can be removed from
    it.
    """
    root = get_cache_root()
    if not folder.absolute().is_relative_to(root.absolute()):
        return
    with contextlib.suppress(OSError):
        _lease.add(root, folder.absolute().relative_to(root.absolute()))
    with contextlib.suppress(OSError):
        os.utime(folder)


def list_entries(root: Path | None = None) -> list[CacheEntry]:
    """Return the entries of the cache, most recently used first."""
    root = root or get_cache_root()
    used = _folders_in_use(root)
    found = [entry for kind, name in FOLDERS.items() for entry in _entries_in(root / name, kind, used)]
    return sorted(found, key=lambda entry: entry.used_at_s, reverse=True)


def remove_entries(
    choose: Callable[[Sequence[CacheEntry]], Sequence[CacheEntry]], root: Path | None = None
) -> list[CacheEntry]:
    """Remove entries of the cache that are not in use, and return them.

    Args:
        choose: Returns the entries to remove, given all; entries in use stay.
        root: The folder of the cache.
    """
    root = root or get_cache_root()
    if not root.is_dir():
        return []
    removed: list[CacheEntry] = []
    doomed: list[Path] = []
    try:
        # A process that begins to use an entry waits until the entry has its other name, under which it cannot be
        # found.
        with hold_lock(root / _LOCK):
            for entry in choose(list_entries(root)):
                if not entry.is_in_use:
                    doomed.append(entry.folder.with_name(f"{_EVICTED}{secrets.token_hex(8)}"))
                    entry.folder.rename(doomed[-1])
                    removed.append(entry)
    except OSError as error:
        raise build_path_error(error, "cache", "a folder that can be written", path=root) from error
    finally:
        for folder in doomed:
            remove_tree(folder, ignore_errors=True)
    return removed


def keep_within_limit() -> list[CacheEntry]:
    """Remove least recently used entries until the cache is within its limit, and kernels of obsolete versions.

    Call this after an addition. It does nothing in a cache that cannot be written.
    """
    limit_bytes = limit_from_environment()
    with contextlib.suppress(GslCosimError):
        return remove_entries(lambda entries: choose_unused(entries, limit_bytes, time.time()))
    return []


def choose_unused(entries: Sequence[CacheEntry], limit_bytes: float, now_s: float) -> list[CacheEntry]:
    """Return the entries to remove so that the rest is within a limit, least recently used first.

    Args:
        entries: All entries.
        limit_bytes: Limit on the total size [bytes]; entries in use count, but stay.
        now_s: Current time, on the clock of the entries.
    """
    total_bytes = sum(entry.size_bytes for entry in entries)
    chosen: list[CacheEntry] = []
    for entry in sorted(entries, key=lambda entry: entry.used_at_s):
        is_old = entry.kind == "kernels" and now_s - entry.used_at_s > UNUSED_KERNELS_S
        if entry.is_evictable and (is_old or total_bytes > limit_bytes):
            chosen.append(entry)
            total_bytes -= entry.size_bytes
    return chosen


def limit_from_environment() -> float:
    """Return the size limit of the cache [bytes] from `GSLCOSIM_CACHE_LIMIT`; infinite for `none`."""
    text = os.environ.get(LIMIT_VARIABLE, "").strip()
    if not text:
        return DEFAULT_LIMIT_BYTES
    return float("inf") if text.lower() == "none" else parse_size_bytes(text, place=LIMIT_VARIABLE)


def parse_size_bytes(text: str, *, place: str) -> float:
    """Return a size such as 500MB, 2.5GB or 1GiB [bytes]."""
    found = _SIZE.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"{place}: expected a size such as 500MB, 5GB or 1GiB, was {text!r}.")
    number, prefix, is_binary = found.groups()
    return float(number) * (1024.0 if is_binary else 1000.0) ** " KMGT".index(prefix.upper() or " ")


class _Lease:
    """Locked file that lists the entries used by this process."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._pid = 0
        self._root = Path()
        self._descriptor = -1
        self._names: set[Path] = set()

    def add(self, root: Path, name: Path) -> None:
        """Add an entry."""
        if sys.platform == "win32":
            return
        with self._guard:
            if (self._pid, self._root) == (os.getpid(), root) and name in self._names:
                return
            root.mkdir(parents=True, exist_ok=True)
            with hold_lock(root / _LOCK):
                # After a fork, the parent's file stays with the parent, locked by both processes.
                if (self._pid, self._root) != (os.getpid(), root):
                    self._begin(root)
                os.write(self._descriptor, os.fsencode(name) + b"\n")
            self._names.add(name)

    def _begin(self, root: Path) -> None:
        if sys.platform == "win32":
            return
        leases = root / _LEASES
        leases.mkdir(exist_ok=True)
        for path in set(leases.iterdir()).difference(_live_leases(root)):
            path.unlink(missing_ok=True)
        path = leases / f"{os.getpid()}.{secrets.token_hex(4)}"
        descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL, 0o600)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        self._pid, self._root, self._descriptor, self._names = os.getpid(), root, descriptor, set()


_lease = _Lease()


# Leases of processes that have not ended: their locks are held.
def _live_leases(root: Path) -> list[Path]:
    if sys.platform == "win32":
        return []
    live: list[Path] = []
    for path in (root / _LEASES).glob("*"):
        try:
            descriptor = os.open(path, os.O_RDONLY)
        except OSError:
            continue
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            live.append(path)
        finally:
            os.close(descriptor)
    return live


def _folders_in_use(root: Path) -> set[Path]:
    used: set[Path] = set()
    for path in _live_leases(root):
        with contextlib.suppress(OSError):
            used.update(root / os.fsdecode(line) for line in path.read_bytes().splitlines())
    return used


def _entries_in(folder: Path, kind: str, used: set[Path]) -> Generator[CacheEntry]:
    try:
        found = [entry for entry in os.scandir(folder) if entry.is_dir(follow_symlinks=False)]
    except FileNotFoundError:
        return
    except OSError as error:
        raise build_path_error(error, "cache", "a folder that can be read", path=folder) from error
    for entry in found:
        path = Path(entry.path)
        try:
            used_at_s = entry.stat(follow_symlinks=False).st_mtime
            size_bytes = _size_bytes(path)
        except OSError:
            # Another process has removed it.
            continue
        is_made = kind == "program" or _FINISHED.fullmatch(entry.name) is not None
        if is_made or time.time() - used_at_s > _UNFINISHED_S:
            yield CacheEntry(kind=kind, folder=path, size_bytes=size_bytes, used_at_s=used_at_s, is_in_use=path in used)


def _size_bytes(folder: Path) -> int:
    total = 0
    waiting = [folder]
    while waiting:
        for entry in os.scandir(waiting.pop()):
            status = entry.stat(follow_symlinks=False)
            total += getattr(status, "st_blocks", -(-status.st_size // _BLOCK_BYTES)) * _BLOCK_BYTES
            if entry.is_dir(follow_symlinks=False):
                waiting.append(Path(entry.path))
    return total
