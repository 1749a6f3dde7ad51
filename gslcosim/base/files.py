"""Files in folders that others can write too, temporary folders that do not outlive their owner, and user state."""

import contextlib
import errno
import os
import secrets
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path, PurePath
from typing import BinaryIO, Self

from gslcosim.base.errors import MachineError, UsageError, build_machine_error, describe_os_error

if sys.platform != "win32":
    import fcntl

# Absent on systems other than Linux and macOS, where links are followed as usual.
_NOFOLLOW = getattr(os, "O_NOFOLLOW", 0)
_DIRECTORY_FLAGS = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | _NOFOLLOW
# Opening a pipe in place of a file must not wait for the pipe's reader.
_NONBLOCK = getattr(os, "O_NONBLOCK", 0)
_SUPPORTS_DIR_FD = os.open in os.supports_dir_fd
PREFIX = "gslcosim-"
# Locked by the owner for its lifetime; the lock ends with the process, however that ends.
OWNER_FILE = ".owner"
# Maximum address of a unix socket [bytes]. Below the parent: a folder, and a name of at most 12 bytes.
SOCKET_BYTES = 103 if sys.platform == "darwin" else 107
_SOCKET_NAME_BYTES = len(f"/{PREFIX}check-12345678/") + 12
_USER_DIRECTORY_VARIABLE = "XDG_RUNTIME_DIR"
_MAX_OWNERLESS_S = 60.0
MAX_FOLDER_LEVELS = 64
"""Depth to which foreign folders may be nested; ours are six deep."""


def write_all(fd: int, data: bytes | memoryview) -> None:
    """Write all of the bytes."""
    left = memoryview(data)
    while left:
        left = left[os.write(fd, left) :]


def open_for_writing(root: Path, name: str, *, is_appended: bool = False) -> int:
    """Open a file below a folder for writing, created if absent, and return its descriptor.

    Args:
        root: The folder.
        name: The file's path below it, with `/`; neither the file nor a folder on the way may be a link.
        is_appended: True to append to the content, False to replace it.
    """
    flags = os.O_WRONLY | os.O_CREAT | (os.O_APPEND if is_appended else 0)
    with _open_folder(root, name) as (folder, last):
        fd = os.open(last, flags | _NOFOLLOW | _NONBLOCK, 0o644, dir_fd=folder)
    try:
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            raise OSError(errno.EEXIST, "something that is no file", str(root / name))
        if not is_appended:
            os.ftruncate(fd, 0)
        if _NONBLOCK:
            os.set_blocking(fd, True)
    except BaseException:
        os.close(fd)
        raise
    return fd


def open_regular_file(path: Path) -> BinaryIO:
    """Open a regular file for reading; a pipe, a device or the like is refused without waiting."""
    check_regular_file(path)
    fd = os.open(path, os.O_RDONLY | _NONBLOCK | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0))
    try:
        # Another file may be in its place by now.
        _check_kind(os.fstat(fd).st_mode, path)
        return os.fdopen(fd, "rb")
    except BaseException:
        os.close(fd)
        raise


def check_regular_file(path: Path) -> None:
    """Refuse a path that is no regular file, for libraries that open it themselves."""
    _check_kind(path.stat().st_mode, path)


def _check_kind(mode: int, path: Path) -> None:
    if not stat.S_ISREG(mode):
        kinds = ((stat.S_ISDIR, "folder"), (stat.S_ISFIFO, "pipe"), (stat.S_ISSOCK, "socket"))
        kind = next((name for is_kind, name in kinds if is_kind(mode)), "device")
        raise OSError(errno.EINVAL, f"a {kind} and no file", str(path))


def read_regular_file(path: Path, *, max_bytes: int | None = None) -> bytes:
    """Return the content of a regular file; a pipe, a device or the like is refused without waiting."""
    with open_regular_file(path) as file:
        content = file.read(-1 if max_bytes is None else max_bytes + 1)
    if max_bytes is not None and len(content) > max_bytes:
        raise OSError(errno.EFBIG, f"more than {max_bytes} bytes", str(path))
    return content


def append_bytes(root: Path, name: str, data: bytes) -> None:
    """Append bytes to a file below a folder."""
    fd = open_for_writing(root, name, is_appended=True)
    try:
        write_all(fd, data)
    finally:
        os.close(fd)


def replace_file(root: Path, name: str, data: bytes) -> None:
    """Write a file below a folder atomically: a reader sees the old content or the new, never a part."""
    with _open_folder(root, name) as (folder, last):
        beside = str(PurePath(last).with_name(f".{PurePath(last).name}.{secrets.token_hex(4)}"))
        fd = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _NOFOLLOW, 0o644, dir_fd=folder)
        try:
            try:
                write_all(fd, data)
            finally:
                os.close(fd)
            os.replace(beside, last, src_dir_fd=folder, dst_dir_fd=folder)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(beside, dir_fd=folder)
            raise


# The folder as a descriptor and the file's name in it; on systems without such descriptors None and the whole path.
@contextlib.contextmanager
def _open_folder(root: Path, name: str) -> Iterator[tuple[int | None, str]]:
    if not _SUPPORTS_DIR_FD:
        yield None, str(root / name)
        return
    *between, last = name.split("/")
    with contextlib.ExitStack() as stack:
        folder = os.open(root, _DIRECTORY_FLAGS)
        stack.callback(os.close, folder)
        for part in between:
            folder = os.open(part, _DIRECTORY_FLAGS, dir_fd=folder)
            stack.callback(os.close, folder)
        yield folder, last


@contextlib.contextmanager
def hold_lock(path: Path) -> Iterator[None]:
    """Hold the lock of a file, created if absent, against other processes; wait for them."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if sys.platform != "win32":
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


class ScratchFolder:
    """A private temporary folder. `close` removes it; one of a killed process is removed when the next is created.

    On Windows the folders of killed processes stay.

    Args:
        kind: Part of its name.
        parent: Where it is; by default the temporary directory.
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
        """Create one whose path leaves room for unix sockets in it.

        It is in the temporary directory or, if that has too long a path, in the user's runtime directory or in /tmp.
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
        _remove_owner_last(self.path)
        lock, self._lock = self._lock, None
        if lock is not None:
            os.close(lock)


def build_temporary_directory_error(error: OSError) -> Exception:
    """Return the error for a temporary directory that cannot be written."""
    is_place_at_fault = error.errno not in (errno.EMFILE, errno.ENFILE, errno.ENOMEM)
    remedy = "Free room there, or set TMPDIR to a folder that can be written." if is_place_at_fault else ""
    return build_machine_error(error, "temporary directory", "a folder that can be written", remedy=remedy)


# The file gets its name only once it is locked, so that no process finds a folder whose owner is about to lock it.
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
    try:
        lock = os.open(folder / OWNER_FILE, os.O_RDWR | os.O_NOFOLLOW | _NONBLOCK)
    except FileNotFoundError:
        # Its owner was killed right before removing it, or has just created it.
        if time.time() - folder.lstat().st_mtime > _MAX_OWNERLESS_S:
            folder.rmdir()
        return
    except OSError:
        # A program with access to the folder has replaced the lock.
        if time.time() - folder.lstat().st_mtime > _MAX_OWNERLESS_S:
            _remove_owner_last(folder)
        return
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _remove_owner_last(folder)
    finally:
        os.close(lock)


# The file of the owner goes last: a folder whose removal is cut short still has a lock that nothing holds.
def _remove_owner_last(folder: Path) -> None:
    remove_tree(folder, ignore_errors=True, last=OWNER_FILE)


def remove_tree(path: Path, *, ignore_errors: bool = False, last: str = "") -> None:
    """Remove a folder with all its content, however deep; links are removed, and their targets stay.

    Folders without permissions are given them. Entries that cannot be removed stay, and all others go.

    Args:
        path: The folder.
        ignore_errors: True if entries may stay.
        last: Name of an entry that is removed after all others, and only once they are gone.
    """
    if not _SUPPORTS_DIR_FD:
        shutil.rmtree(path, ignore_errors=ignore_errors)
        return
    try:
        with _open_own_folder(path, None) as root:
            if error := _empty_folder(root, last) or _empty_folder(root, ""):
                raise error
        path.rmdir()
    except OSError:
        if not ignore_errors:
            raise


# Subfolders are moved up into the root before they are emptied, under unique names: at any depth this takes a few
# descriptors and no recursion, where paths from the root would be longer than the system accepts.
def _empty_folder(root: int, last: str) -> OSError | None:
    mark, n_moved = secrets.token_hex(8), 0
    stuck: dict[str, OSError] = {}
    has_changed = True
    # Entries that come and go while they are listed may be left out once.
    while has_changed:
        has_changed = False
        for name in _iter_names(root):
            if name == last or name in stuck:
                continue
            try:
                if _is_folder(name, root):
                    with _open_own_folder(name, root) as inner:
                        for below in _iter_names(inner):
                            n_moved += 1
                            _move_or_remove(below, inner, f"{mark}.{n_moved}", root)
                    os.rmdir(name, dir_fd=root)
                else:
                    os.unlink(name, dir_fd=root)
                has_changed = True
            except FileNotFoundError:
                continue
            except OSError as error:
                stuck[name] = error
                has_changed = True
    return next(iter(stuck.values()), None)


# An entry that stays keeps its folder from being removed, which is the error that is reported.
def _move_or_remove(name: str, folder: int, new_name: str, root: int) -> None:
    with contextlib.suppress(OSError):
        if not _is_folder(name, folder):
            os.unlink(name, dir_fd=folder)
            return
        # Moving a folder needs the right to write in it.
        with _open_own_folder(name, folder):
            os.rename(name, new_name, src_dir_fd=folder, dst_dir_fd=root)


def _iter_names(folder: int) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            yield entry.name


def _is_folder(name: str, folder: int) -> bool:
    return stat.S_ISDIR(os.stat(name, dir_fd=folder, follow_symlinks=False).st_mode)


# Also opens a folder that its owner may not list, enter or change.
@contextlib.contextmanager
def _open_own_folder(path: str | Path, parent: int | None) -> Iterator[int]:
    try:
        fd = os.open(path, _DIRECTORY_FLAGS, dir_fd=parent)
    except PermissionError:
        place = os.open(path, _DIRECTORY_FLAGS | getattr(os, "O_PATH", 0), dir_fd=parent)
        try:
            # By its descriptor: the name could be a link by now.
            Path(f"/proc/self/fd/{place}").chmod(stat.S_IRWXU)
        finally:
            os.close(place)
        fd = os.open(path, _DIRECTORY_FLAGS, dir_fd=parent)
    try:
        if stat.S_IMODE(os.fstat(fd).st_mode) & stat.S_IRWXU != stat.S_IRWXU:
            os.fchmod(fd, stat.S_IRWXU)
        yield fd
    finally:
        os.close(fd)


def iterate_tree(folder: Path, *, is_entered: Callable[[Path], bool] = lambda _: True) -> Iterator[Path]:
    """Yield all entries below a folder except the folders that are entered; links are not followed.

    Args:
        folder: A folder that may be foreign.
        is_entered: Returns True for a folder to descend into; others are yielded.
    """
    waiting = [(folder, 0)]
    while waiting:
        inside, level = waiting.pop()
        if level > MAX_FOLDER_LEVELS:
            raise UsageError(f"expected folders at most {MAX_FOLDER_LEVELS} deep, was a deeper one.\nFolder: {folder}")
        try:
            with os.scandir(inside) as entries:
                for entry in entries:
                    path = inside / entry.name
                    if entry.is_dir(follow_symlinks=False) and is_entered(path):
                        waiting.append((path, level + 1))
                    else:
                        yield path
        except OSError as error:
            raise UsageError(
                f"expected a folder that can be read, was {describe_os_error(error)}.\nFolder: {inside}"
            ) from error


def list_files(folder: Path) -> list[Path]:
    """Return the files below a folder, sorted; links to files count, other links, pipes and devices do not."""
    return sorted(path for path in iterate_tree(folder) if path.is_file())


def user_state_folder() -> Path:
    """Return the folder of this user's state; it need not exist, and is outside every sandbox.

    `GSLCOSIM_STATE` overrides it; otherwise `$XDG_STATE_HOME/gslcosim` or `~/.local/state/gslcosim`.
    """
    if chosen := os.environ.get("GSLCOSIM_STATE"):
        return Path(chosen).expanduser().absolute()
    base = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    return Path(base).expanduser() / "gslcosim"
