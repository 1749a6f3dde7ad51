"""Rows as they come: appended to a file, one line a trial, and on the disk before the next is begun."""

import base64
import json
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from gslcosim.errors import MachineError
from gslcosim.machine import machine_error, remedy_of


@dataclass(frozen=True)
class Entry:
    """A row, as a dict by column, and the packed tracks of its trial; none where there is no result."""

    row: dict[str, Any]
    tracks: bytes | None


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
    """Yield the rows of a journal, in the order in which they came; nothing where there is none."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        for line in file:
            if line.endswith(b"\n"):
                fields = json.loads(line)
                tracks = fields["tracks"]
                yield Entry(fields["row"], tracks and base64.b64decode(tracks))


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
