"""Temporary folders that do not outlive their owner: the next one made removes those of killed processes."""

import contextlib
import os
import secrets
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Self

from gslcosim.base.errors import MachineError
from gslcosim.base.os_errors import build_machine_error

if sys.platform != "win32":
    import fcntl

PREFIX = "gslcosim-"
# Locked by the owner for as long as it lives; the lock ends with its process, however that ends.
OWNER_FILE = ".owner"
# An address of a unix socket has room for so many bytes. Below the parent: a folder, and a name of at most 12 bytes.
SOCKET_BYTES = 103 if sys.platform == "darwin" else 107
_SOCKET_NAME_BYTES = len(f"/{PREFIX}check-12345678/") + 12
_USER_DIRECTORY_VARIABLE = "XDG_RUNTIME_DIR"


class ScratchFolder:
    """A private temporary folder. `close` removes it; if its process is killed, the next one that is made does.

    On Windows what a killed process has left stays.

    Args:
        kind: Part of its name.
        parent: Where it is; by default the temporary directory.

    Raises:
        MachineError: it cannot be made.
    """

    def __init__(self, kind: str = "", *, parent: Path | None = None) -> None:
        try:
            place = parent or Path(tempfile.gettempdir())
            _remove_leftovers(place)
            self.path = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{kind}-" if kind else PREFIX, dir=place))
            self._lock = _mark_as_owned(self.path)
        except OSError as error:
            raise build_temporary_directory_error(error) from error

    @classmethod
    def for_sockets(cls, kind: str = "") -> Self:
        """Make one whose path leaves room for unix sockets in it.

        It is in the temporary directory, and where that has too long a name in the user's folder for such things, or in
        /tmp.

        Raises:
            MachineError: it cannot be made.
        """
        usual = Path(tempfile.gettempdir())
        others = [Path(os.environ[_USER_DIRECTORY_VARIABLE])] if os.environ.get(_USER_DIRECTORY_VARIABLE) else []
        longest = SOCKET_BYTES - _SOCKET_NAME_BYTES
        for place in (usual, *others, Path("/tmp")):
            fits = len(os.fsencode(place.absolute())) <= longest
            if fits and (place == usual or os.access(place, os.W_OK | os.X_OK)):
                return cls(kind, parent=place)
        raise MachineError(
            f"temporary directory: expected a path of at most {longest} bytes, so that unix sockets have room there, "
            f"was one of {len(os.fsencode(usual))}, and neither {_USER_DIRECTORY_VARIABLE} nor /tmp "
            f"helps. Set TMPDIR to a shorter one.\nFolder: {usual}"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Remove the folder with all that is in it."""
        shutil.rmtree(self.path, ignore_errors=True)
        lock, self._lock = self._lock, None
        if lock is not None:
            os.close(lock)


def build_temporary_directory_error(error: OSError) -> Exception:
    """Return the error for a person where nothing can be written to the temporary directory."""
    remedy = "Free room there, or set TMPDIR to a folder that can be written."
    return build_machine_error(error, "temporary directory", "a folder that can be written", remedy=remedy)


# It has its name only once it is locked, so that nobody finds a folder whose owner is just about to lock it.
def _mark_as_owned(folder: Path) -> int | None:
    if sys.platform == "win32":
        return None
    unnamed = folder / f"{OWNER_FILE}.{secrets.token_hex(4)}"
    lock = os.open(unnamed, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        unnamed.rename(folder / OWNER_FILE)
    except OSError:
        os.close(lock)
        raise
    return lock


def _remove_leftovers(place: Path) -> None:
    if sys.platform == "win32":
        return
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(place)):
            if entry.name.startswith(PREFIX) and entry.is_dir(follow_symlinks=False):
                with contextlib.suppress(OSError):
                    _remove_if_stale(Path(entry.path))


def _remove_if_stale(folder: Path) -> None:
    if sys.platform == "win32" or folder.lstat().st_uid != os.getuid():
        return
    lock = os.open(folder / OWNER_FILE, os.O_RDWR | os.O_NOFOLLOW)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(lock)
