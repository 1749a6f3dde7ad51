"""One Rerun recording being written: the only place that opens, feeds and closes an .rrd file."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from gslcosim.errors import RecordingError, RecordingWriteError
from gslcosim.recording.checked_file import CheckedFile

APPLICATION_ID = "gslcosim"
TICK_TIMELINE = "tick"
TIME_TIMELINE = "sim_time"


class RunFile:
    """A recording on disk with two timelines: `tick` (whole ticks) and `sim_time` (a duration).

    Nothing in it but the machine's notes comes from a wall clock, so equal runs give equal content otherwise
    (`rerun rrd compare --unordered`).
    Until `close` has returned the file lacks its footer; see `gslcosim.recording.repair`. What cannot be written is
    raised by the next call of any method. On Windows Rerun writes the file itself, and tells nobody.

    Raises:
        RecordingWriteError: the file cannot be created, or no longer be written.
        RecordingError: Rerun is switched off by its environment variable.
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
        self._file = CheckedFile(path) if CheckedFile.is_possible() else None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream.save(path if self._file is None else self._file.entrance, default_blueprint=blueprint)
        except (OSError, RuntimeError) as error:
            raise RecordingWriteError(
                f"recording: expected a file that can be written, was {error}.\nFile: {path}"
            ) from error
        finally:
            if self._file is not None:
                self._file.leave_to_writer()
        self._stream.send_recording_name(name)

    def check(self) -> None:
        """Raise what could not be written so far.

        Raises:
            RecordingWriteError: the machine has refused to write.
        """
        if self._file is not None:
            self._file.check()

    def lay_out(self, blueprint: rrb.Blueprint) -> None:
        """Replace the layout with which the recording opens."""
        self.check()
        self._stream.send_blueprint(blueprint, make_active=True, make_default=True)

    def draw(self, entity: str, *parts: rr.AsComponents) -> None:
        """Write what an entity shows at all times."""
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
        tick_column = np.array(ticks, dtype=np.int64)
        times = (
            rr.TimeColumn(TICK_TIMELINE, sequence=tick_column),
            rr.TimeColumn(TIME_TIMELINE, duration=(tick_column * self._tick_ns).astype("timedelta64[ns]")),
        )
        rr.send_columns(entity, times, columns, recording=self._stream, strict=True)

    def send_chunks(self, chunks: Iterable[Chunk]) -> None:
        """Write rows of other recordings as they are."""
        self.check()
        rr.send_chunks(chunks, recording=self._stream)

    def flush(self) -> None:
        """Return when everything sent so far is in the file."""
        self._stream.flush()
        if self._file is not None:
            self._file.wait_until_written()

    def close(self) -> None:
        """Write what is left and the footer, and release the file."""
        self._stream.flush()
        self._stream.disconnect()
        if self._file is not None:
            self._file.close()
