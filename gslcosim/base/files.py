"""Files written where others can write too: no link is followed, and no reader sees one half written."""

import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import BinaryIO

# Absent on systems other than Linux and macOS, where links are followed as everywhere.
_NOFOLLOW = getattr(os, "O_NOFOLLOW", 0)
_DIRECTORY_FLAGS = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | _NOFOLLOW
# Opening a pipe that somebody has put there must not wait for its reader.
_NONBLOCK = getattr(os, "O_NONBLOCK", 0)
_SUPPORTS_DIR_FD = os.open in os.supports_dir_fd


def write_all(fd: int, data: bytes | memoryview) -> None:
    """Write all of the bytes.

    Raises:
        OSError: the machine refuses some of them.
    """
    left = memoryview(data)
    while left:
        left = left[os.write(fd, left) :]


def open_for_writing(root: Path, name: str, *, is_appended: bool = False) -> int:
    """Open a file below a folder, made where there is none, and return its descriptor.

    Args:
        root: The folder.
        name: The file's path below it, with `/`; neither it nor a folder on the way may be a link.
        is_appended: Whether to write behind what is there, in place of it.

    Raises:
        OSError: it cannot be opened, is a link, or is no plain file.
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
    """Open a file for reading; what is no file, such as a pipe or a device, is never waited for.

    Raises:
        OSError: it cannot be opened, or is no file.
    """
    fd = os.open(path, os.O_RDONLY | _NONBLOCK | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0))
    try:
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            raise OSError(errno.EINVAL, "something that is no file", str(path))
        return os.fdopen(fd, "rb")
    except BaseException:
        os.close(fd)
        raise


def read_regular_file(path: Path, *, max_bytes: int | None = None) -> bytes:
    """Return the content of a file; what is no file, such as a pipe or a device, is never waited for.

    Raises:
        OSError: it cannot be read, is no file, or is larger than `max_bytes`.
    """
    with open_regular_file(path) as file:
        content = file.read(-1 if max_bytes is None else max_bytes + 1)
    if max_bytes is not None and len(content) > max_bytes:
        raise OSError(errno.EFBIG, f"more than {max_bytes} bytes", str(path))
    return content


def append_bytes(root: Path, name: str, data: bytes) -> None:
    """Write bytes behind what a file below a folder holds.

    Raises:
        OSError: as `open_for_writing` and `write_all`.
    """
    fd = open_for_writing(root, name, is_appended=True)
    try:
        write_all(fd, data)
    finally:
        os.close(fd)


def replace_file(root: Path, name: str, data: bytes) -> None:
    """Write a file below a folder at once: a reader sees the old one or the new one, never a part.

    Raises:
        OSError: it cannot be written; then nothing is changed.
    """
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


# The folder as a descriptor and the file's name in it; where there are no such descriptors None and the whole path.
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
