"""Rows as they come: appended to a file, one line a trial, and on the disk before the next is begun."""

import base64
import json
import os
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Required, TypedDict

import pyarrow as pa

from gslcosim.benchmark.store.columns import REQUIRED_COLUMNS, TRIAL_COLUMNS
from gslcosim.benchmark.store.tracks import unpacked
from gslcosim.errors import MachineError
from gslcosim.foreign_json import ForeignFileError, read_json_lines
from gslcosim.machine import machine_error, remedy_of


@dataclass(frozen=True)
class Entry:
    """A row, as a dict by column, and the packed tracks of its trial; none where there is no result."""

    row: dict[str, Any]
    tracks: bytes | None


_FLY_AGAIN = "Delete the line: its trial is flown again by the same bench run."
_PYTHON_TYPES: dict[pa.DataType, Any] = {pa.string(): str, pa.int64(): int, pa.float64(): float, pa.bool_(): bool}
_EMPTY_ROW: dict[str, Any] = dict.fromkeys((column.name for column in TRIAL_COLUMNS), None)
_typed_dict: Any = TypedDict
_TrialRow = _typed_dict(
    "_TrialRow",
    {
        column.name: Required[_PYTHON_TYPES[column.type]]
        if column.name in REQUIRED_COLUMNS
        else _PYTHON_TYPES[column.type] | None
        for column in TRIAL_COLUMNS
    },
    total=False,
)
_JournalLine = _typed_dict("_JournalLine", {"row": _TrialRow, "tracks": str | None})


class Journal:
    """The file of rows of a run that goes on; a line that is not whole, as after a power cut, is taken for missing."""

    def __init__(self, path: Path) -> None:
        """Open or begin the file.

        Raises:
            MachineError: it cannot be written.
        """
        self._path = path
        try:
            _drop_torn_line(path)
            self._file = path.open("ab", buffering=0)
        except OSError as error:
            raise cannot_write(path, error) from error

    def __enter__(self) -> "Journal":
        """Return the journal."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        self._file.close()

    def append(self, entry: Entry) -> None:
        """Write a row, and see that it is on the disk.

        Raises:
            MachineError: it cannot be written; the rows before it stay whole.
        """
        fields = {"row": entry.row, "tracks": entry.tracks and base64.b64encode(entry.tracks).decode()}
        line = memoryview(json.dumps(fields, separators=(",", ":")).encode() + b"\n")
        size = self._path.stat().st_size
        try:
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(size)
            raise cannot_write(self._path, error) from error


def read_journal(path: Path) -> Iterator[Entry]:
    """Yield the rows of a journal, in the order in which they came; nothing where there is none.

    Raises:
        ForeignFileError: it cannot be read, or a line is no row of this version.
    """
    if not path.is_file():
        return
    for number, fields in enumerate(read_json_lines(path, _JournalLine, remedy=_FLY_AGAIN), 1):
        try:
            tracks = base64.b64decode(fields["tracks"], validate=True) if fields["tracks"] else None
            if tracks is not None:
                unpacked(tracks)
        except (ValueError, zlib.error) as error:
            raise ForeignFileError(
                f"{path.parent.name}/{path.name}:{number}: tracks: expected packed tracks, was {error}. "
                f"{_FLY_AGAIN}\nFile: {path}"
            ) from error
        yield Entry({**_EMPTY_ROW, **fields["row"]}, tracks)


def _drop_torn_line(path: Path) -> None:
    if not path.is_file():
        return
    content_end = 0
    with path.open("rb") as file:
        for line in file:
            if line.endswith(b"\n"):
                content_end += len(line)
    if content_end < path.stat().st_size:
        os.truncate(path, content_end)


def cannot_write(path: Path, error: OSError) -> MachineError:
    """Return the error for a person where results cannot be written."""
    remedy = f"{remedy_of(error)} Then give the same command again: what was flown is kept."
    return machine_error(error, path.name, "a file that can be written", path=path, remedy=remedy)
