"""A file that another writer fills through a pipe, so that each write is checked and the first that fails is told.

Rerun writes its files in a thread of its own, and goes on as if nothing had happened where the disk is full.
"""

import contextlib
import os
import sys
import threading
from pathlib import Path

from gslcosim.errors import RecordingWriteError
from gslcosim.machine import machine_text, remedy_of
from gslcosim.safe_files import open_for_writing, write_all

if sys.platform != "win32":
    import fcntl
    import select
    import termios

# A writer that is ahead by more than this waits.
_PIPE_BYTES = 1 << 20
_AT_ONCE_BYTES = 1 << 18
# Whoever opens a file of these folders opens the pipe of that descriptor.
_DESCRIPTORS = next((folder for folder in ("/proc/self/fd", "/dev/fd") if Path(folder).is_dir()), None)
_DO_WITHOUT = "Or do without the recording: --set recording.enabled=false."


class CheckedFile:
    """A file behind a pipe: `entrance` is what the writer opens, fills and closes in place of the file.

    A thread writes what has been sent until the writer closes its end. Once a write has failed the rest is read and
    dropped, so that the writer never hangs.

    Args:
        path: The file; an existing one is replaced.

    Raises:
        RecordingWriteError: it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._n_bytes = 0
        self._failure: str | None = None
        self._is_complete = False
        # Held while bytes are on their way from the pipe to the file.
        self._moved = threading.Condition()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open_for_writing(path.parent, path.name)
        except OSError as error:
            raise RecordingWriteError(_text(error, path, "a file that can be written")) from error
        self._pipe, self._own_end = os.pipe()
        if sys.platform == "linux":
            with contextlib.suppress(OSError):
                fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        self.entrance = Path(f"{_DESCRIPTORS}/{self._own_end}")
        self._copier = threading.Thread(target=self._copy, name=f"writes {path.name}", daemon=True)
        self._copier.start()

    @staticmethod
    def is_possible() -> bool:
        """Whether this system has pipes that can be opened by a name."""
        return sys.platform != "win32" and _DESCRIPTORS is not None

    def leave_to_writer(self) -> None:
        """Close the end that is held open here: from now on the file ends when the writer closes its own."""
        os.close(self._own_end)

    def check(self) -> None:
        """Raise what has failed so far.

        Raises:
            RecordingWriteError: the machine has refused to write.
        """
        if self._failure is not None:
            raise RecordingWriteError(self._failure)

    def wait_until_written(self) -> None:
        """Return when all that the writer has sent is in the file.

        Raises:
            RecordingWriteError: the machine has refused to write.
        """
        with self._moved:
            self._moved.wait_for(lambda: self._is_complete or self._failure is not None or self._n_waiting() == 0)
        self.check()

    def close(self) -> None:
        """Return when the writer has closed its end and the file is complete.

        Raises:
            RecordingWriteError: the machine has refused to write.
        """
        self._copier.join()
        self.check()

    def _n_waiting(self) -> int:
        if sys.platform == "win32":
            return 0
        return int.from_bytes(fcntl.ioctl(self._pipe, termios.FIONREAD, bytes(4)), sys.byteorder)

    def _copy(self) -> None:
        if sys.platform == "win32":
            return
        waiting = select.poll()
        waiting.register(self._pipe, select.POLLIN)
        while not self._is_complete:
            waiting.poll()
            with self._moved:
                data = os.read(self._pipe, _AT_ONCE_BYTES)
                self._is_complete = not data
                if self._is_complete:
                    self._close()
                elif self._failure is None:
                    self._write(data)
                self._moved.notify_all()

    def _write(self, data: bytes) -> None:
        try:
            write_all(self._file, data)
            self._n_bytes += len(data)
        except OSError as error:
            expected = f"to write {_size(len(data))} more after {_size(self._n_bytes)}"
            self._failure = _text(error, self._path, expected)

    # Some file systems tell only here that there was no room.
    def _close(self) -> None:
        os.close(self._pipe)
        try:
            os.close(self._file)
        except OSError as error:
            self._failure = self._failure or _text(error, self._path, f"to write {_size(self._n_bytes)}")


def _text(error: OSError, path: Path, expected: str) -> str:
    return machine_text(error, path.name, expected, path=path, remedy=f"{remedy_of(error)} {_DO_WITHOUT}")


def _size(n_bytes: int) -> str:
    return f"{n_bytes / 1e6:.3g} MB" if n_bytes >= 100_000 else f"{max(n_bytes / 1e3, 0.1):.3g} kB"
