"""Rerun file being written: the only place that opens, feeds and closes an .rrd file; each write is checked.

Rerun writes its files in a thread of its own, and reports no error when the disk is full.
"""

import contextlib
import os
import sys
import threading
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from gslcosim.base.errors import RecordingError, RecordingWriteError, find_remedy, format_machine_error
from gslcosim.base.files import open_for_writing, write_all

if sys.platform != "win32":
    import fcntl
    import select
    import termios

# A writer that is ahead by more than this waits.
_PIPE_BYTES = 1 << 20
_CHUNK_BYTES = 1 << 18
# Rerun writes a chunk in several pieces: woken for each, the copying thread would take longer than the copying.
_GATHER_S = 0.01
# A file of these folders opens the pipe of that descriptor.
_DESCRIPTOR_FOLDER = next((folder for folder in ("/proc/self/fd", "/dev/fd") if Path(folder).is_dir()), None)
_DISABLE_REMEDY = "Or do without the recording: --set recording.enabled=false."

APPLICATION_ID = "gslcosim"
TICK_TIMELINE = "tick"
TIME_TIMELINE = "sim_time"


class PipedFile:
    """File behind a pipe: `entrance` is the path that the writer opens, fills and closes in place of the file.

    A thread writes what has been sent until the writer closes its end. Once a write has failed the rest is read and
    dropped, so that the writer never hangs.

    Args:
        path: The file; an existing one is replaced.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._n_bytes = 0
        self._failure: str | None = None
        self._is_complete = False
        # Set while a caller waits until all is in the file.
        self._is_awaited = threading.Event()
        # Held while bytes are on their way from the pipe to the file.
        self._moved = threading.Condition()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open_for_writing(path.parent, path.name)
        except OSError as error:
            raise RecordingWriteError(_error_text(error, path, "a file that can be written")) from error
        self._pipe, self._own_end = os.pipe()
        if sys.platform == "linux":
            with contextlib.suppress(OSError):
                fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        self.entrance = Path(f"{_DESCRIPTOR_FOLDER}/{self._own_end}")
        self._copier = threading.Thread(target=self._copy, name=f"writes {path.name}", daemon=True)
        self._copier.start()

    @staticmethod
    def is_possible() -> bool:
        """True where this system has pipes that can be opened by a name."""
        return sys.platform != "win32" and _DESCRIPTOR_FOLDER is not None

    def close_write_end(self) -> None:
        """Close this object's own end: the file then ends when the writer closes its end."""
        os.close(self._own_end)

    def check(self) -> None:
        """Raise the error of an earlier write, if any."""
        if self._failure is not None:
            raise RecordingWriteError(self._failure)

    def wait_until_written(self) -> None:
        """Wait until all that the writer has sent is in the file."""
        self._is_awaited.set()
        with self._moved:
            self._moved.wait_for(lambda: self._is_complete or self._failure is not None or self._n_waiting() == 0)
        self._is_awaited.clear()
        self.check()

    def close(self) -> None:
        """Wait until the writer has closed its end and the file is complete."""
        self._is_awaited.set()
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
        has_more = False
        while not self._is_complete:
            waiting.poll()
            if not has_more:
                self._is_awaited.wait(_GATHER_S)
            with self._moved:
                data = os.read(self._pipe, _CHUNK_BYTES)
                has_more = len(data) == _CHUNK_BYTES
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
            expected = f"to write {_format_size(len(data))} more after {_format_size(self._n_bytes)}"
            self._failure = _error_text(error, self._path, expected)

    # Some file systems report a full disk only here.
    def _close(self) -> None:
        os.close(self._pipe)
        try:
            os.close(self._file)
        except OSError as error:
            self._failure = self._failure or _error_text(error, self._path, f"to write {_format_size(self._n_bytes)}")


def _error_text(error: OSError, path: Path, expected: str) -> str:
    return format_machine_error(error, path.name, expected, path=path, remedy=f"{find_remedy(error)} {_DISABLE_REMEDY}")


def _format_size(n_bytes: int) -> str:
    return f"{n_bytes / 1e6:.3g} MB" if n_bytes >= 100_000 else f"{max(n_bytes / 1e3, 0.1):.3g} kB"


# Most entities have rows at the same ticks.
@lru_cache(maxsize=8)
def _time_columns(ticks: tuple[int, ...], tick_ns: int) -> tuple[rr.TimeColumn, rr.TimeColumn]:
    tick_column = np.array(ticks, dtype=np.int64)
    return (
        rr.TimeColumn(TICK_TIMELINE, sequence=tick_column),
        rr.TimeColumn(TIME_TIMELINE, duration=(tick_column * tick_ns).astype("timedelta64[ns]")),
    )


class RecordingFile:
    """A recording on disk with two timelines: `tick` (whole ticks) and `sim_time` (a duration).

    Nothing in it but the machine's notes comes from a wall clock, so equal runs give equal content otherwise
    (`rerun rrd compare --unordered`). Until `close` has returned the file lacks its footer; see
    `gslcosim_services.recorder.rerun_cli`. The next call of any method raises the error of a failed write. On Windows
    Rerun writes the file itself, and reports nothing.
    """

    def __init__(self, path: Path, *, run_id: str, name: str, tick_ns: int, blueprint: rrb.Blueprint) -> None:
        self._path = path
        self._tick_ns = tick_ns
        # Rerun's own start time of a recording is the wall clock: only the name is written.
        self._stream = rr.RecordingStream(APPLICATION_ID, recording_id=run_id, send_properties=False)
        if not rr.is_enabled(self._stream):
            raise RecordingError(
                "recording: expected Rerun to be enabled, was switched off by the environment variable RERUN. "
                "Unset it, or set recording.enabled to false."
            )
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._file = PipedFile(path) if PipedFile.is_possible() else None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream.save(path if self._file is None else self._file.entrance, default_blueprint=blueprint)
        except (OSError, RuntimeError) as error:
            raise RecordingWriteError(
                f"recording: expected a file that can be written, was {error}.\nFile: {path}"
            ) from error
        finally:
            if self._file is not None:
                self._file.close_write_end()
        self._stream.send_recording_name(name)

    def check(self) -> None:
        """Raise the error of an earlier write, if any."""
        if self._file is not None:
            self._file.check()

    def lay_out(self, blueprint: rrb.Blueprint) -> None:
        """Replace the layout with which the recording opens."""
        self.check()
        self._stream.send_blueprint(blueprint, make_active=True, make_default=True)

    def draw(self, entity: str, *parts: rr.AsComponents) -> None:
        """Write the static parts of an entity."""
        self.check()
        self._stream.log(entity, *parts, static=True, strict=True)

    def send(self, entity: str, ticks: Sequence[int], columns: Iterable[rr.ComponentColumn]) -> None:
        """Write rows of an entity, one for each tick.

        Args:
            entity: Path in the recording, without a leading slash.
            ticks: Tick of each row; the row is valid at the tick's end.
            columns: Columns of the same length.
        """
        self.check()
        rr.send_columns(
            entity, _time_columns(tuple(ticks), self._tick_ns), columns, recording=self._stream, strict=True
        )

    def send_chunks(self, chunks: Iterable[Chunk]) -> None:
        """Write rows of other recordings as they are."""
        self.check()
        rr.send_chunks(chunks, recording=self._stream)

    def flush(self) -> None:
        """Wait until everything sent so far is in the file."""
        self._stream.flush()
        if self._file is not None:
            self._file.wait_until_written()

    def close(self) -> None:
        """Write the rest and the footer, and release the file."""
        self._stream.flush()
        self._stream.disconnect()
        if self._file is not None:
            self._file.close()
