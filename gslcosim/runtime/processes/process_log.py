"""Log of a process: its output on the way to a file, up to a limit."""

import contextlib
import os
import threading
from pathlib import Path

from gslcosim.base.errors import RunFolderError, format_machine_error
from gslcosim.base.files import open_for_writing, write_all

# Days of talk; and a disk has room for the logs of a swarm.
MAX_LOG_BYTES = 64_000_000
_LOG_READ_BYTES = 1 << 16


class ProcessLog:
    """The standard output of a process on its way to a file; output beyond the limit is dropped, and a note written.

    Within the context the process is started with `fileno()`; the file is complete when `wait` returns, unless a child
    of the process still holds its output open. A process that writes more than the limit goes on undisturbed.

    Args:
        path: The file; its present content stays.
    """

    def __init__(self, path: Path, *, most_bytes: int = MAX_LOG_BYTES) -> None:
        try:
            self._file = open_for_writing(path.parent, path.name, is_appended=True)
        except OSError as error:
            text = format_machine_error(error, path.name, "a log that can be written", path=path)
            raise RunFolderError(text) from error
        self._most_bytes = most_bytes
        self._from, self._to = os.pipe()
        self._pump = threading.Thread(target=self._copy, name=f"log {path.stem}", daemon=True)

    def __enter__(self) -> "ProcessLog":
        try:
            self._pump.start()
        except RuntimeError:
            # No memory for a thread.
            for fd in (self._file, self._from, self._to):
                os.close(fd)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._to)

    def fileno(self) -> int:
        """Return the descriptor that the process writes to."""
        return self._to

    def wait(self, limit_s: float) -> None:
        """Wait until the process and its descendants have closed their output, or until the limit."""
        if self._pump.is_alive():
            self._pump.join(limit_s)

    def _copy(self) -> None:
        n_kept = n_dropped = 0
        # A disk without room costs the log, not the run: what the run needs itself is reported by its writer.
        with contextlib.suppress(OSError):
            while data := os.read(self._from, _LOG_READ_BYTES):
                kept = data[: self._most_bytes - n_kept]
                if kept:
                    n_kept += len(kept)
                    with contextlib.suppress(OSError):
                        write_all(self._file, kept)
                if len(kept) < len(data):
                    if n_dropped == 0:
                        self._note(f"the log is cut here, after {self._most_bytes / 1e6:g} MB.")
                    n_dropped += len(data) - len(kept)
        if n_dropped:
            self._note(f"{n_dropped / 1e6:,.3f} MB more were dropped.")
        os.close(self._from)
        os.close(self._file)

    def _note(self, text: str) -> None:
        with contextlib.suppress(OSError):
            write_all(self._file, f"\n[gslcosim: {text}]\n".encode())
