"""Results folder: its journal of rows, its lock, and its tables, which are always whole."""

import base64
import json
import os
import shutil
import sys
import zlib
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Required, TypedDict, cast

import pyarrow as pa
import pyarrow.parquet as pq

from gslcosim.base.errors import MachineError, UsageError
from gslcosim.base.os_errors import build_machine_error, find_remedy
from gslcosim.base.untrusted_json import JsonObject, MalformedFileError, read_json, read_json_lines
from gslcosim.bench.store.columns import (
    REQUIRED_COLUMNS,
    SERIES,
    TRACKS,
    TRIAL_COLUMNS,
    TRIALS,
    pack_tracks,
    unpack_tracks,
)


@dataclass(frozen=True)
class JournalEntry:
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
            raise write_error(path, error) from error

    def __enter__(self) -> "Journal":
        """Return the journal."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        self._file.close()

    def append(self, entry: JournalEntry) -> None:
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
            raise write_error(self._path, error) from error


def read_journal(path: Path) -> Iterator[JournalEntry]:
    """Yield the rows of a journal, in the order in which they came; nothing where there is none.

    Raises:
        MalformedFileError: it cannot be read, or a line is no row of this version.
    """
    if not path.is_file():
        return
    for number, fields in enumerate(read_json_lines(path, _JournalLine, remedy=_FLY_AGAIN), 1):
        try:
            tracks = base64.b64decode(fields["tracks"], validate=True) if fields["tracks"] else None
            if tracks is not None:
                unpack_tracks(tracks)
        except (ValueError, zlib.error) as error:
            raise MalformedFileError(
                f"{path.parent.name}/{path.name}:{number}: tracks: expected packed tracks, was {error}. "
                f"{_FLY_AGAIN}\nFile: {path}"
            ) from error
        yield JournalEntry({**_EMPTY_ROW, **fields["row"]}, tracks)


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


def write_error(path: Path, error: OSError) -> MachineError:
    """Return the error for a person where results cannot be written."""
    remedy = f"{find_remedy(error)} Then give the same command again: what was flown is kept."
    return build_machine_error(error, path.name, "a file that can be written", path=path, remedy=remedy)


if sys.platform != "win32":
    import fcntl

# Maps of hundreds of rooms.
_MAX_BYTES = 1_000_000_000
RESULTS_SCHEMA = "gslcosim/results/1"


class FlownEntryFacts(TypedDict, total=False):
    """Entry of `manifest.json`, as far as it is read."""

    name: Required[str]
    title: str | None
    family: str | None
    language: str | None
    knows: object
    parameters: dict[str, object] | None
    agent_hash: str | None
    submission: str | None
    verified: bool | None


class SessionFacts(TypedDict, total=False):
    """Wall times of one call that ran some of a suite, as far as they are read."""

    started_at: Required[str]
    jobs: Required[int]
    total_s: float | None
    preparing_s: float | None
    flying_s: float | None
    n_trials: int | None
    busy_share: float | None
    flying_share: float | None
    peak_worker_mb: float | None
    reference_loop_s: float | None


class WallFacts(TypedDict, total=False):
    """Wall times of all calls together, as far as they are read."""

    started_at: str | None
    jobs: int | None
    total_s: float | None
    preparing_s: float | None
    flying_s: float | None
    busy_share: float | None


class MachineFacts(TypedDict, total=False):
    """Machine that ran a suite, as far as it is read."""

    cpu: str | None
    cores: int | None
    platform: str | None
    reference_loop_s: float | None


class VerifiedFacts(TypedDict):
    """Numbers of runs of a sample, and of those that came out the same."""

    sample: int
    same: int
    at: str


class DroppedCase(TypedDict):
    """A case that could not be run."""

    case: str
    reason: str


class ResultsManifest(TypedDict, total=False):
    """Manifest of results, as far as it is read."""

    suite: str | None
    title: str | None
    question: str | None
    seed: int | None
    suite_hash: str | None
    software_hash: str | None
    sandbox: str | None
    versions: dict[str, str] | None
    machine: MachineFacts | None
    entries: list[FlownEntryFacts]
    n_planned: int | None
    dropped: list[DroppedCase] | None
    anchors: dict[str, str | None] | None
    wall: WallFacts | None
    sessions: list[SessionFacts]
    verified: VerifiedFacts | None
    merged_from: list[str] | None


class RoomMapFacts(TypedDict):
    """Key of a map in `maps.json`; the rest is read by the report."""

    scenario: str
    varied: str


class RoomMaps(TypedDict, total=False):
    """Maps of `maps.json`, as far as they are read."""

    maps: list[RoomMapFacts]


_KINDS: dict[str, Any] = {"manifest.json": ResultsManifest, "maps.json": RoomMaps}


class ResultsFolder:
    """Paths of a results folder, and how its files are read and written."""

    def __init__(self, path: Path) -> None:
        """Take a folder, which need not be there."""
        self.path = path
        self.suite = path / "suite.yaml"
        self.trials = path / "trials.parquet"
        self.tracks = path / "tracks.parquet"
        self.manifest = path / "manifest.json"
        self.maps = path / "maps.json"
        self.journal = path / "rows.jsonl"
        self.recordings = path / "recordings"

    def check(self) -> None:
        """Refuse a folder without results.

        Raises:
            UsageError: it has none.
        """
        if not self.manifest.is_file() or not (self.trials.is_file() or self.journal.is_file()):
            raise UsageError(
                f"{self.path}: expected a folder of results (manifest.json, trials.parquet), found none. "
                "Fly a suite first: gslcosim bench run SUITE."
            )

    @contextmanager
    def locked(self) -> Generator[None]:
        """Hold the folder against a second run.

        Raises:
            UsageError: another run holds it.
            MachineError: it cannot be written.
        """
        path = self.path / ".lock"
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = path.open("a+")
        except OSError as error:
            raise build_machine_error(
                error,
                str(self.path),
                "a folder that can be written",
                remedy=f"{find_remedy(error)} --results chooses another.",
            ) from error
        with lock:
            try:
                if sys.platform != "win32":
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                holder = path.read_text(encoding="utf-8", errors="replace").strip() or "?"
                raise UsageError(
                    f"{self.path}: expected a folder that no other bench run works in, was one in use by process "
                    f"{holder}. Wait for it, or name another folder with --results."
                ) from error
            lock.truncate(0)
            lock.write(f"{os.getpid()}\n")
            lock.flush()
            yield

    def entries(self) -> dict[str, JournalEntry]:
        """Return all rows that there are by trial: those of the tables, then those of the journal."""
        found: dict[str, JournalEntry] = {}
        if self.trials.is_file():
            tracks = _tracks_by_trial(self.tracks)
            for row in _rows(self.trials, TRIALS):
                found[row["trial"]] = JournalEntry(row, tracks.get(row["trial"]))
        for entry in read_journal(self.journal):
            found[entry.row["trial"]] = entry
        return found

    def rows(self) -> list[dict[str, Any]]:
        """Return all rows that there are, as dicts by column: those of the table, then those of the journal."""
        rows = {row["trial"]: row for row in (_rows(self.trials, TRIALS) if self.trials.is_file() else ())}
        rows |= {entry.row["trial"]: entry.row for entry in read_journal(self.journal)}
        return list(rows.values())

    def write_tables(self, entries: Sequence[JournalEntry]) -> None:
        """Write both tables from rows in the order of the suite; what stood there before is replaced in one go."""
        trials = pa.Table.from_pylist([entry.row for entry in entries], schema=TRIALS)
        tracks = pa.Table.from_pylist(
            [
                {"trial": entry.row["trial"], "agent": agent, **{key: series[key] for key in SERIES}}
                for entry in entries
                if entry.tracks is not None
                for agent, series in unpack_tracks(entry.tracks).items()
            ],
            schema=TRACKS,
        )
        _replace(self.tracks, lambda path: pq.write_table(tracks, path, compression="zstd"))
        _replace(self.trials, lambda path: pq.write_table(trials, path, compression="zstd"))

    def write_json(self, path: Path, content: Mapping[str, Any]) -> None:
        """Write a JSON file of the folder in one go."""
        text = json.dumps(content, indent=None if path == self.maps else 2, ensure_ascii=False) + "\n"
        _replace(path, lambda beside: beside.write_text(text, encoding="utf-8"))

    def read_json(self, path: Path) -> dict[str, Any]:
        """Return a JSON file of the folder; empty where there is none.

        Raises:
            MalformedFileError: it cannot be read, or is something else.
        """
        if not path.is_file():
            return {}
        return cast("dict[str, Any]", read_json(path, _KINDS.get(path.name, JsonObject), max_bytes=_MAX_BYTES))

    def track_table(self, columns: Sequence[str] = TRACKS.names) -> pa.Table | None:
        """Return columns of the tracks; None where there are none.

        Raises:
            UsageError: they cannot be read.
        """
        schema = pa.schema([TRACKS.field(name) for name in columns])
        return _table(self.tracks, schema, required=columns) if self.tracks.is_file() else None

    def put_aside(self) -> Path:
        """Move what is here into a folder of its own, `earlier-1` or the next that is free; return it."""
        number = 1
        while (aside := self.path / f"earlier-{number}").exists():
            number += 1
        aside.mkdir()
        for path in self.path.iterdir():
            if not path.name.startswith(("earlier-", ".lock")):
                shutil.move(str(path), aside / path.name)
        return aside


def _rows(path: Path, schema: pa.Schema) -> list[dict[str, Any]]:
    required = REQUIRED_COLUMNS if schema is TRIALS else schema.names
    return cast("list[dict[str, Any]]", _table(path, schema, required=required).to_pylist())


def _table(path: Path, schema: pa.Schema, *, required: Sequence[str]) -> pa.Table:
    try:
        with pq.ParquetFile(path) as file:
            table = file.read()
    except (OSError, pa.ArrowException, ValueError) as error:
        raise UsageError(
            f"{path}: expected a table of results, was a file that cannot be read ({error}). Take it from a copy."
        ) from error
    if schema is not TRIALS and set(schema.names) <= set(table.schema.names):
        table = table.select(schema.names)
    if table.schema.names != schema.names:
        missing = sorted(set(schema.names) - set(table.schema.names))
        raise UsageError(
            f"{path}: expected the columns of this version, was a table "
            f"{f'without {missing[0]}' if missing else 'with others'}. Fly the suite again, or use the version that "
            "wrote it (manifest.json has it)."
        )
    for field in schema:
        column = table.column(field.name)
        if column.type != field.type or (column.null_count and field.name in required):
            found = "one without a value in each row" if column.type == field.type else f"one of {column.type}"
            raise UsageError(
                f"{path}: {field.name}: expected a column of {field.type}, was {found}. Take the file from a copy."
            )
    return table


def _tracks_by_trial(path: Path) -> dict[str, bytes]:
    if not path.is_file():
        return {}
    import numpy as np

    tracks: dict[str, Any] = {}
    for row in _rows(path, TRACKS):
        tracks.setdefault(row["trial"], {})[row["agent"]] = {
            key: np.asarray([np.nan if v is None else v for v in row[key]], dtype=np.float32) for key in SERIES
        }
    return {trial: pack_tracks(agents) for trial, agents in tracks.items()}


def _replace(path: Path, write: Any) -> None:
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        write(beside)
        with beside.open("rb") as file:
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        raise write_error(path, error) from error
    finally:
        beside.unlink(missing_ok=True)
