"""Storage of trial rows: columns of the tables, and the results folder with its journal and lock.

`trials.parquet` has a row for each trial, in the order of the suite. Columns that begin with `wall_`, and
`sandbox`, depend on the machine and its load; all others are the same to the bit wherever, however often and by however
many workers the suite is run. `tracks.parquet` has a row for each agent of each trial, with a value for each second.
"""

import base64
import hashlib
import json
import os
import re
import shutil
import sys
import zlib
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NotRequired, Required, TypedDict, cast

import msgpack  # pyright: ignore[reportMissingTypeStubs]
import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from gslcosim.base.checksums import check_files, write_checksums
from gslcosim.base.errors import MachineError, UsageError, build_machine_error, find_remedy
from gslcosim.base.files import iterate_tree
from gslcosim.base.untrusted_input import JsonObject, MalformedFileError, read_json, read_json_lines

WALL = "wall_"
SANDBOX = "sandbox"
_TEXT, _WHOLE, _REAL, _FLAG = pa.string(), pa.int64(), pa.float64(), pa.bool_()
REQUIRED_COLUMNS = (
    "trial", "case", "scenario", "family", "varied", "repetition", "entry", "is_control", "seed", "gas_seed",
    "n_robots", "environment_hash", "time_limit_s", "status", "outcome", "success", "time_s", "score",
)  # fmt: skip
"""Those that have a value in each row, of trials without a result too."""
_SERIES = pa.list_(pa.float32())
Tracks = dict[str, dict[str, NDArray[np.float32]]]
"""For each agent its series by the names of `TRACK_COLUMNS`, all of one length."""
_msgpack: Any = msgpack
_FLY_AGAIN = "Delete the line: its trial is flown again by the same bench run."
_PYTHON_TYPES: dict[pa.DataType, Any] = {pa.string(): str, pa.int64(): int, pa.float64(): float, pa.bool_(): bool}
_typed_dict: Any = TypedDict
# Maps of hundreds of rooms.
_MAX_BYTES = 1_000_000_000
# Of a Parquet file, at once.
_READ_BYTES = 1 << 20
# Values of a table: of trials a quarter of a million rows, of tracks days. Equal ones take next to nothing in a file.
_MAX_TRIAL_VALUES, _MAX_TRACK_VALUES = 30_000_000, 500_000_000
RESULTS_SCHEMA = "gslcosim/results/1"
MAPS_SCHEMA = "gslcosim/maps/1"
SHARD_SCHEMA = "gslcosim/shard/1"
# A sandbox hides copies of it, as those of all results.
AGENT_SECRETS_SCHEMA = "gslcosim/results/agent_secrets/1"


@dataclass(frozen=True)
class Column:
    """A column: its type, and what its values are, with unit."""

    name: str
    type: pa.DataType
    meaning: str

    @property
    def unit(self) -> str | None:
        """The unit that the meaning gives in brackets."""
        found = re.search(r"\[([^\]]+)\]", self.meaning)
        return found[1] if found else None


TRIAL_COLUMNS = (
    # Which run.
    Column("trial", _TEXT, "id: a hash of all that decides the flight"),
    Column("case", _TEXT, "the scenario and what was varied, for people: gsl_bench_1/start=3,3"),
    Column("scenario", _TEXT, "name of the scenario"),
    Column("family", _TEXT, "group of cases that are aggregated together: the suite's label of the scenario"),
    Column("varied", _TEXT, "what was varied, as JSON: path to value"),
    Column("repetition", _WHOLE, "from 0 on"),
    Column("entry", _TEXT, "name of the entry"),
    Column("is_control", _FLAG, "whether no source gives off gas: success is luck, a declaration a false alarm"),
    Column("seed", _WHOLE, "seed of the run: equal for all entries of a case and repetition"),
    Column("gas_seed", _WHOLE, "seed of the gas: runs that share it in a room share one plume"),
    Column("knows", _TEXT, "what the entry was granted beside its sensors: map, plume, source, separated by +"),
    Column("sensors", _TEXT, "models of the first agent's sensors, separated by +"),
    Column("n_robots", _WHOLE, "number of agents"),
    Column("environment_hash", _TEXT, "content of the room and its wind"),
    Column("time_limit_s", _REAL, "T: when every run ends [s]"),
    Column("within_m", _REAL, "success radius r_s [m]"),
    Column(
        "success_of", _TEXT, "the success criterion: source, declaration, all_sources, map, or one of another package"
    ),
    Column("start_x_m", _REAL, "start of the first agent, world frame [m]"),
    Column("start_y_m", _REAL, "start of the first agent, world frame [m]"),
    Column("start_z_m", _REAL, "start of the first agent, world frame [m]"),
    Column("source_x_m", _REAL, "first source, world frame [m]"),
    Column("source_y_m", _REAL, "first source, world frame [m]"),
    Column("source_z_m", _REAL, "first source, world frame [m]"),
    # How it ended.
    Column("status", _TEXT, "flown, or why there is no result: crashed, hung, out_of_memory, fault"),
    Column("fault", _TEXT, "what went wrong in the simulation or worker; empty when nothing did"),
    Column("agent_faults", _TEXT, "what the agents did wrong, one sentence each; empty when nothing"),
    Column("digest", _TEXT, "digest of the run; empty when there is none"),
    Column("outcome", _TEXT, "the referee's end reason: success, time_limit, collision, agent_failed, declared, ..."),
    Column("success", _FLAG, "whether an agent succeeded; false where there is no result"),
    Column("time_to_source_s", _REAL, "first success of any agent [s]; absent without one"),
    Column("time_s", _REAL, "min(time to source, T), and T for every failure, collisions too [s]"),
    Column("end_s", _REAL, "simulated time at the end of the run [s]"),
    Column("score", _REAL, "q = S (1 - 0.5 t / T), halved per false declaration, 0 if a collision ended the run"),
    Column("share_arrived", _REAL, "share of the agents that succeeded"),
    # Ways; of the agent that succeeded first, otherwise the one that came nearest.
    Column("steps", _WHOLE, "commands that took effect"),
    Column("path_length_m", _REAL, "length flown [m]"),
    Column("total_path_length_m", _REAL, "length flown by all agents together [m]"),
    Column("shortest_path_m", _REAL, "shortest collision-free way to the success ball [m]; absent without one"),
    Column("travel_overhead", _REAL, "path / shortest - 1; absent without success"),
    Column("spl", _REAL, "S shortest / max(path, shortest), 0 without success"),
    Column("directness", _REAL, "net progress towards the source / path, after first contact; -1 to 1"),
    Column("nearest_m", _REAL, "smallest distance of any agent to a source [m]"),
    Column("time_within_5_m_s", _REAL, "first time within 5 m of a source [s]; absent if never"),
    Column("time_within_2_m_s", _REAL, "first time within 2 m of a source [s]; absent if never"),
    Column("time_within_1_m_s", _REAL, "first time within 1 m of a source [s]; absent if never"),
    Column("time_within_05_m_s", _REAL, "first time within 0.5 m of a source [s]; absent if never"),
    Column("n_collisions", _WHOLE, "collisions of all agents"),
    Column("n_refusals", _WHOLE, "commands that the vehicle refused or changed"),
    # Gas.
    Column("first_contact_s", _REAL, "first true gas above the sensor's floor at a nose of any agent [s]"),
    Column("tracking_ratio", _REAL, "share of the time from first contact to the end in gas above that floor"),
    # What the figures are worth: docs/validity.md.
    Column("validity", _TEXT, "verdict on the run's figures: yes, with warnings, or no"),
    Column("warnings", _TEXT, "why with warnings, a line each; empty where there are none"),
    Column("wind_settled", _FLAG, "whether the wind had settled; absent where nobody has checked"),
    Column("wind_uncertainty_frac", _REAL, "standard error of the mean wind over its speed, at least"),
    Column("share_refused", _REAL, "share of an agent's commands that were refused, of the agent with the largest"),
    Column("share_saturated", _REAL, "share of the time that a gas sensor was saturated, of the worst"),
    Column("share_warming_up", _REAL, "share of the time that a gas sensor was warming up, of the worst"),
    # Declaration and belief.
    Column("declared", _FLAG, "whether an agent declared a source"),
    Column("first_declared_s", _REAL, "first declaration [s]"),
    Column("declared_confidence", _REAL, "highest confidence of a declaration, 0 to 1; 0 without one"),
    Column("declared_error_m", _REAL, "distance of the first declaration to the nearest source [m]"),
    Column("declared_error_in_plane_m", _REAL, "as declared_error_m, heights apart [m]"),
    Column("n_false_declarations", _WHOLE, "declarations outside the success radius; on a control all of them"),
    Column("belief_distance_m", _REAL, "expected distance of the last belief to the source = earth mover's [m]"),
    Column("belief_error_m", _REAL, "distance of the last belief's mean to the source [m]"),
    Column("belief_mass_near", _REAL, "probability of the last belief within the success radius"),
    Column("belief_entropy_bits", _REAL, "entropy of the last belief [bit]"),
    Column(
        "belief_minus_log_p", _REAL, "-ln of the last belief's probability in the source's cell; absent where that is 0"
    ),
    # The machine's.
    Column("wall_decision_p50_ms", _REAL, "time of a decision, median [ms of wall clock]"),
    Column("wall_decision_p95_ms", _REAL, "time of a decision, 95th percentile [ms of wall clock]"),
    Column("wall_preparing_s", _REAL, "reading the scenario, loading the room [s of wall clock]"),
    Column("wall_starting_s", _REAL, "building cores and starting agents [s of wall clock]"),
    Column("wall_flying_s", _REAL, "flying [s of wall clock]"),
    Column("wall_judging_s", _REAL, "figures of this row [s of wall clock]"),
    Column("wall_storing_s", _REAL, "packing row and track for the file [s of wall clock]"),
    Column("wall_worker", _TEXT, "who flew it"),
    Column(SANDBOX, _TEXT, "what agents were started in: bubblewrap, landlock with its version, none and why"),
)


TRACK_COLUMNS = (
    Column("trial", _TEXT, "id of the trial"),
    Column("agent", _TEXT, "name of the agent"),
    Column("t_s", _SERIES, "simulated time, about one a second and the last [s]"),
    Column("x_m", _SERIES, "true position, world frame [m]"),
    Column("y_m", _SERIES, "true position, world frame [m]"),
    Column("z_m", _SERIES, "true position, world frame [m]"),
    Column("distance_m", _SERIES, "distance to the nearest source [m]"),
    Column("gas_ppm", _SERIES, "true mixing ratio at the first nose [ppm]"),
    Column("reading", _SERIES, "what the agent's first gas sensor reported, in the sensor's unit"),
    Column("belief_distance_m", _SERIES, "expected distance of the belief to the source [m]; NaN without one"),
    Column("belief_mass_near", _SERIES, "probability of the belief within the success radius; NaN without one"),
)


# As in the tables of a run, `meaning` and `unit` are metadata of the file's fields.
def build_schema(columns: Sequence[Column]) -> pa.Schema:
    """Return the schema of a table with these columns."""
    fields: list[pa.Field[Any]] = []
    for column in columns:
        metadata = {"meaning": column.meaning, **({"unit": column.unit} if column.unit else {})}
        fields.append(pa.field(column.name, column.type, metadata=metadata))
    return pa.schema(fields)


TRIALS = build_schema(TRIAL_COLUMNS)
TRACKS = build_schema(TRACK_COLUMNS)


def is_machine_dependent(column: str) -> bool:
    """Return whether a column's values depend on the machine and its load."""
    return column.startswith(WALL) or column == SANDBOX


SERIES = tuple(column.name for column in TRACK_COLUMNS if column.name not in ("trial", "agent"))


def pack_tracks(tracks: Tracks) -> bytes:
    """Return tracks as compressed bytes."""
    agents = {name: [series[key].astype("<f4").tobytes() for key in SERIES] for name, series in tracks.items()}
    return zlib.compress(_msgpack.packb(agents, use_bin_type=True), level=6)


def unpack_tracks(payload: bytes) -> Tracks:
    """Return the tracks that `pack_tracks` has made bytes of."""
    try:
        agents = msgspec.msgpack.decode(zlib.decompress(payload), type=dict[str, list[bytes]])
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return {
        name: {key: np.frombuffer(part, dtype="<f4") for key, part in zip(SERIES, parts, strict=True)}
        for name, parts in agents.items()
    }


@dataclass(frozen=True)
class JournalEntry:
    """A row, as a dict by column, and the packed tracks of its trial; none where there is no result."""

    row: dict[str, Any]
    tracks: bytes | None


_EMPTY_ROW: dict[str, Any] = dict.fromkeys((column.name for column in TRIAL_COLUMNS), None)
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
_JournalLine = _typed_dict("_JournalLine", {"row": _TrialRow, "tracks": str | None, "check": NotRequired[str]})


# A hash of what a line holds; those of older versions have none.
def _hash_line(fields: Mapping[str, Any]) -> str:
    kept = [fields["row"], fields["tracks"]]
    return hashlib.blake2b(json.dumps(kept, sort_keys=True).encode(), digest_size=8).hexdigest()


class Journal:
    """The file of rows of a run that goes on; a line that is not whole, as after a power cut, is taken for missing."""

    def __init__(self, path: Path) -> None:
        """Open or begin the file."""
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
        """Write a row, and see that it is on the disk."""
        fields = {"row": entry.row, "tracks": entry.tracks and base64.b64encode(entry.tracks).decode()}
        checked = {**fields, "check": _hash_line(fields)}
        line = memoryview(json.dumps(checked, separators=(",", ":")).encode() + b"\n")
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
    """Yield the rows of a journal, in the order in which they came; nothing where there is none."""
    if not path.is_file():
        return
    for number, fields in enumerate(read_json_lines(path, _JournalLine, remedy=_FLY_AGAIN), 1):
        try:
            if fields.get("check", checked := _hash_line(fields)) != checked:
                raise ValueError("changed since it was written")
            tracks = base64.b64decode(fields["tracks"], validate=True) if fields["tracks"] else None
            if tracks is not None:
                unpack_tracks(tracks)
        except (ValueError, zlib.error) as error:
            raise MalformedFileError(
                f"{path.parent.name}/{path.name}:{number}: expected a row with packed tracks, was {error}. "
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


class ManifestEntry(TypedDict, total=False):
    """Entry of `manifest.json`, as far as it is read."""

    name: Required[str]
    title: str | None
    family: str | None
    blind: bool | None
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
    cpu_s: float | None
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
    smallest_difference_points: float | None
    seed: int | None
    suite_hash: str | None
    software_hash: str | None
    sandbox: str | None
    versions: dict[str, str] | None
    machine: MachineFacts | None
    entries: list[ManifestEntry]
    n_planned: int | None
    dropped: list[DroppedCase] | None
    anchors: dict[str, str | None] | None
    wall: WallFacts | None
    sessions: list[SessionFacts]
    verified: VerifiedFacts | None
    merged_from: list[str] | None


class ShardFacts(TypedDict):
    """Content of `shard.json`: which part of a suite a folder holds.

    `only` are the patterns that chose trials for all shards together, `n_chosen` how many those are; `trials` gives the
    place in the suite of each trial of this shard.
    """

    index: int
    count: int
    only: list[tuple[str, list[str]]]
    n_chosen: int
    trials: dict[str, int]


class RoomMapFacts(TypedDict):
    """Key of a map in `maps.json`; the rest is read by the report."""

    scenario: str
    varied: str


class RoomMaps(TypedDict, total=False):
    """Maps of `maps.json`, as far as they are read."""

    maps: list[RoomMapFacts]


class RunStatusFacts(TypedDict):
    """State of a run that works in a folder, as `.status.json` has it; see `RunSummary` for what comes of it."""

    phase: str
    done: int
    total: int
    elapsed_s: float
    left_s: float | None
    cpu_s: float
    n_without_result: int
    process: int


_KINDS: dict[str, Any] = {
    "manifest.json": ResultsManifest, "maps.json": RoomMaps, "shard.json": ShardFacts, ".status.json": RunStatusFacts,
}  # fmt: skip


class ResultsFolder:
    """Paths of a results folder, and how its files are read and written."""

    def __init__(self, path: Path, *, is_checked: bool = True) -> None:
        """Take a folder, which need not be there.

        Args:
            is_checked: Whether what is read is compared with the checksums of the folder.
        """
        self.path = path
        self._is_checked = is_checked
        self.suite = path / "suite.yaml"
        self.trials = path / "trials.parquet"
        self.tracks = path / "tracks.parquet"
        self.manifest = path / "manifest.json"
        self.maps = path / "maps.json"
        self.shard = path / "shard.json"
        self.agent_secrets = path / "agent_secrets.json"
        self.status = path / ".status.json"
        self.journal = path / "rows.jsonl"
        self.recordings = path / "recordings"

    def check(self) -> None:
        """Refuse a folder without results."""
        if not self.manifest.is_file() or not (self.trials.is_file() or self.journal.is_file()):
            raise UsageError(
                f"{self.path}: expected a folder of results (manifest.json, trials.parquet), found none. "
                "Fly a suite first: gslcosim bench run SUITE."
            )

    def check_writable_entries(self) -> None:
        """Refuse a folder with something in it through which a write would change or wait for something elsewhere."""
        if not self.path.exists():
            return
        for path in iterate_tree(self.path, is_entered=lambda path: path != self.recordings):
            is_plain = (path.is_dir() or path.is_file()) and not path.is_symlink()
            if path != self.recordings and not is_plain:
                raise UsageError(
                    f"{path}: expected a file or folder of these results, which are about to be written, was "
                    f"{'a link' if path.is_symlink() else 'a pipe, a socket or a device'}. Remove it."
                )

    @contextmanager
    def locked(self) -> Generator[None]:
        """Hold the folder against a second run."""
        path = self.path / ".lock"
        self.check_writable_entries()
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

    @property
    def is_in_use(self) -> bool:
        """True while a run holds the folder."""
        path = self.path / ".lock"
        if sys.platform == "win32" or not path.is_file():
            return False
        with path.open() as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
        return False

    def entries(self) -> dict[str, JournalEntry]:
        """Return all rows that there are by trial: those of the tables, then those of the journal."""
        found: dict[str, JournalEntry] = {}
        if self.trials.is_file():
            self._check(self.trials)
            self._check(self.tracks)
            tracks = _tracks_by_trial(self.tracks)
            for row in _rows(self.trials, TRIALS):
                found[row["trial"]] = JournalEntry(row, tracks.get(row["trial"]))
        for entry in read_journal(self.journal):
            found[entry.row["trial"]] = entry
        return found

    def read_agent_secrets(self) -> dict[str, str]:
        """Return by trial the random text from which the seeds of its agents follow, of trials that have one."""
        found = self.read_json(self.agent_secrets).get("secrets") if self.agent_secrets.is_file() else None
        return dict(found) if isinstance(found, dict) else {}  # pyright: ignore[reportUnknownArgumentType]

    def write_agent_secrets(self, secrets: Mapping[str, str]) -> None:
        """Write what `read_agent_secrets` returns, where there is anything."""
        if secrets:
            self.write_json(self.agent_secrets, {"schema": AGENT_SECRETS_SCHEMA, "secrets": dict(secrets)})

    def rows(self) -> list[dict[str, Any]]:
        """Return all rows that there are, as dicts by column: those of the table, then those of the journal."""
        self._check(self.trials)
        rows = {row["trial"]: row for row in (_rows(self.trials, TRIALS) if self.trials.is_file() else ())}
        rows |= {entry.row["trial"]: entry.row for entry in read_journal(self.journal)}
        return list(rows.values())

    def trial_table(self) -> pa.Table:
        """Return the rows as `rows` has them, as a table: a hundred thousand of them take 0.1 GB."""
        if not self.trials.is_file() or any(True for _ in read_journal(self.journal)):
            return pa.Table.from_pylist(self.rows(), schema=TRIALS)
        self._check(self.trials)
        table = _table(self.trials, TRIALS, required=REQUIRED_COLUMNS)
        # Somebody else's table may have a trial twice.
        is_unique = len(table.column("trial").unique()) == table.num_rows
        return table if is_unique else pa.Table.from_pylist(self.rows(), schema=TRIALS)

    def tables(self) -> tuple[pa.Table, pa.Table]:
        """Return all rows that there are, those of the journal too, and their tracks."""
        if self.journal.is_file():
            return build_tables(list(self.entries().values()))
        tracks = self.track_table()
        return self.trial_table(), TRACKS.empty_table() if tracks is None else tracks

    def write_tables(self, trials: pa.Table, tracks: pa.Table) -> None:
        """Write both tables, in the order of the suite; what stood there before is replaced in one go."""
        # A table that was read calls the items of its lists otherwise.
        named = tracks.cast(TRACKS)
        self._write(self.tracks, lambda path: pq.write_table(named, path, compression="zstd"))
        self._write(self.trials, lambda path: pq.write_table(trials, path, compression="zstd"))

    def _write(self, path: Path, write: Callable[[Path], object]) -> None:
        def write_with_checksum(beside: Path) -> None:
            write(beside)
            write_checksums(self.path, path.name, written={path.name: beside})

        write_at_once(path, write if path == self.status else write_with_checksum)

    def write_json(self, path: Path, content: Mapping[str, Any]) -> None:
        """Write a JSON file of the folder in one go."""
        is_long = path in (self.maps, self.shard)
        text = json.dumps(content, indent=None if is_long else 2, ensure_ascii=False) + "\n"
        self._write(path, lambda beside: beside.write_text(text, encoding="utf-8"))

    def read_json(self, path: Path) -> dict[str, Any]:
        """Return a JSON file of the folder; empty where there is none."""
        if not path.is_file():
            return {}
        content = read_json(path, _KINDS.get(path.name, JsonObject), max_bytes=_MAX_BYTES)
        self._check(path)
        return cast("dict[str, Any]", content)

    def _check(self, path: Path) -> None:
        if self._is_checked:
            check_files(self.path, path.name)

    def track_table(self, columns: Sequence[str] = TRACKS.names) -> pa.Table | None:
        """Return columns of the tracks; None where there are none."""
        self._check(self.tracks)
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


def build_tables(entries: Sequence[JournalEntry]) -> tuple[pa.Table, pa.Table]:
    """Return rows and their tracks as tables."""
    trials = pa.Table.from_pylist([entry.row for entry in entries], schema=TRIALS)
    tracks = [
        {"trial": entry.row["trial"], "agent": agent, **{key: series[key] for key in SERIES}}
        for entry in entries
        if entry.tracks is not None
        for agent, series in unpack_tracks(entry.tracks).items()
    ]
    return trials, pa.Table.from_pylist(tracks, schema=TRACKS)


def _rows(path: Path, schema: pa.Schema) -> list[dict[str, Any]]:
    required = REQUIRED_COLUMNS if schema is TRIALS else schema.names
    return cast("list[dict[str, Any]]", _table(path, schema, required=required).to_pylist())


def _table(path: Path, schema: pa.Schema, *, required: Sequence[str]) -> pa.Table:
    try:
        # A column at a time, without read-ahead: all at once take twice the memory, and longer.
        with pq.ParquetFile(path, pre_buffer=False, buffer_size=_READ_BYTES) as file:
            there = file.schema_arrow.names
            if len(set(there)) < len(there):
                raise ValueError("a column is there twice")
            most = _MAX_TRIAL_VALUES if schema is TRIALS else _MAX_TRACK_VALUES
            if (n_values := _count_values(file.metadata)) > most:
                raise ValueError(f"it unpacks to {n_values} values, and {most} are the most")
            is_part = schema is not TRIALS and set(schema.names) <= set(there)
            names = schema.names if is_part else there
            table = pa.table({name: file.read([name], use_threads=False).column(name) for name in names})
    except (OSError, pa.ArrowException, ValueError) as error:
        raise UsageError(
            f"{path}: expected a table of results, was a file that cannot be read ({error}). Take it from a copy."
        ) from error
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
    # With the meanings and units of the fields, which a column alone does not bring.
    return table.cast(schema)


def _count_values(metadata: pq.FileMetaData) -> int:
    groups = (metadata.row_group(i) for i in range(metadata.num_row_groups))
    return sum(group.column(i).num_values for group in groups for i in range(group.num_columns))


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


def write_at_once(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file of the results so that a reader sees the old one or the new one, never a part.

    Args:
        write: Writes another file, which then takes its place.
    """
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
