"""Report data: the contents of a results folder as arrays; the only place of the report that reads files."""

import base64
import json
import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import yaml
from numpy.typing import NDArray

from gslcosim.base.checksums import check_files
from gslcosim.base.errors import UsageError
from gslcosim.base.yaml_core import CoreLoader
from gslcosim_bench.cases.models import SMALLEST_DIFFERENCE_POINTS
from gslcosim_bench.store import ResultsFolder
from gslcosim_bench.verification_marks import VerificationMark, find_mark

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
_TRACK_COLUMNS = (
    "trial", "agent", "t_s", "distance_m", "x_m", "y_m", "belief_distance_m", "belief_mass_near",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ReportEntry:
    """A method under a name.

    Attributes:
        is_blind: Whether its method needs no sensor.
        anchor: `lower` (the oracle), `upper` (the walker) or empty.
        submission: Of merged results, the folder that its runs are of; else empty.
        is_verified: Of merged results, whether a sample of its runs came out the same here; None where that is
        reported
            of all runs together.
    """

    name: str
    title: str
    family: str
    is_blind: bool
    language: str
    knows: str
    parameters: Mapping[str, Any]
    agent_hash: str
    anchor: str
    submission: str
    is_verified: bool | None


@dataclass(frozen=True, kw_only=True)
class EnvironmentMap:
    """A room's plan at one height, and the gas that was there on average.

    Attributes:
        occupied: (nx, ny) whether something solid is there.
        mean_gas_ppm: (nx, ny) mean of the gas [ppm]; None without gas.
        intermittency: (nx, ny) share of time with gas; None without gas.
        wind_toward: (nx, ny, 2) mean over time of the unit vector to which the wind blows; None where it is not told.
        origin_m: Corner of the first cell, world frame, x and y [m].
        sources_m: World frame, xyz [m].
    """

    scenario: str
    varied: str
    height_m: float
    origin_m: tuple[float, float]
    cell_m: float
    occupied: Flags
    mean_gas_ppm: Floats | None
    intermittency: Floats | None
    wind_toward: Floats | None
    sources_m: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, kw_only=True)
class TrialRows:
    """The rows of `trials.parquet` as arrays: nan, "" and False where a value is absent.

    Attributes:
        columns: Array of each column, (n,).
        entry: (n,) index of the entry.
        unit: (n,) index of case, repetition and control: rows of one unit are a pair.
    """

    columns: Mapping[str, NDArray[Any]]
    entry: Ints
    unit: Ints

    @classmethod
    def of_columns(cls, columns: Mapping[str, NDArray[Any]], entries: Sequence[str]) -> Self:
        """Return the rows with some columns, whose `entry` is one of these names."""
        index = {name: i for i, name in enumerate(entries)}
        keys = list(zip(columns["case"], columns["repetition"], columns["is_control"]))
        units = {key: i for i, key in enumerate(dict.fromkeys(keys))}
        return cls(
            columns=columns,
            entry=np.array([index[name] for name in columns["entry"]], dtype=np.int64),
            unit=np.array([units[key] for key in keys], dtype=np.int64),
        )

    def __getitem__(self, column: str) -> NDArray[Any]:
        """Return a column."""
        return self.columns[column]

    def __len__(self) -> int:
        """Return the number of trials."""
        return len(self.entry)

    @cached_property
    def is_control(self) -> Flags:
        """(n,) whether no source gave off gas."""
        return self.columns["is_control"]

    @cached_property
    def score(self) -> Floats:
        """(n,) the score; 0 where there is no result."""
        return np.nan_to_num(self.columns["score"], nan=0.0)

    @cached_property
    def time_s(self) -> Floats:
        """(n,) time as it is counted [s]; the limit where there is no result."""
        times_s = self.columns["time_s"]
        return np.where(np.isfinite(times_s), times_s, self.columns["time_limit_s"])

    @cached_property
    def cells(self) -> Ints:
        """(n,) index of the case."""
        return _codes(self.columns["case"])

    @cached_property
    def rooms(self) -> Ints:
        """(n,) index of the room with its wind."""
        return _codes(self.columns["environment_hash"])

    @cached_property
    def gas(self) -> Ints:
        """(n,) index of the seed of the gas; in one room, rows that share it met the same plume."""
        return _codes(self.columns["gas_seed"])


@dataclass(frozen=True, kw_only=True)
class ReportData:
    """All that a report is made of; `mark` is what this user has found out by running a sample again."""

    folder: Path
    name: str
    manifest: Mapping[str, Any]
    suite: Mapping[str, Any]
    entries: tuple[ReportEntry, ...]
    rows: TrialRows
    maps: tuple[EnvironmentMap, ...]
    tracks: pa.Table | None
    mark: VerificationMark | None

    @property
    def n_planned(self) -> int | None:
        """Number of planned trials; None where that is unknown, as for merged results."""
        planned = self.manifest.get("n_planned")
        return planned if isinstance(planned, int) and "merged_from" not in self.manifest else None

    @property
    def smallest_difference(self) -> float:
        """The least difference of success that matters, as a share: below it, two entries are equally successful."""
        stated = self.manifest.get("smallest_difference_points", self.suite.get("smallest_difference_points"))
        is_stated = isinstance(stated, int | float) and 0.0 < stated < 100.0
        return (stated if is_stated else SMALLEST_DIFFERENCE_POINTS) / 100.0

    def command_of(self, entry: int) -> str:
        """Return the beginning of the command that runs a trial again, up to its id."""
        folder = self.entries[entry].submission or str(self.folder)
        return f"gslcosim bench show {shlex.quote(folder)} --trial "

    def index_of_anchor(self, which: str) -> int | None:
        """Return the entry that bounds from below (`lower`) or above (`upper`); None where it has not run."""
        return next((i for i, entry in enumerate(self.entries) if entry.anchor == which), None)


def load_report_data(results_dir: Path, mark: VerificationMark | None = None, *, with_gas: bool = False) -> ReportData:
    """Read a folder of results.

    Args:
        mark: What was found out by running a sample again; absent: what this user's state has of it.
        with_gas: Whether the tracks have the gas at the nose too.
    """
    folder = ResultsFolder(results_dir)
    folder.check()
    manifest = folder.read_json(folder.manifest)
    table = folder.trial_table()
    mark = mark if mark is not None else find_mark(results_dir)
    entries = _entries(manifest, table, mark)
    columns = {name: _array(table.column(name)) for name in table.schema.names}
    rows = TrialRows.of_columns(columns, [entry.name for entry in entries])
    tracks = folder.track_table((*_TRACK_COLUMNS, "gas_ppm") if with_gas else _TRACK_COLUMNS)
    del table
    # What decoding the files took goes back to the system.
    pa.default_memory_pool().release_unused()
    return ReportData(
        folder=results_dir,
        name=str(manifest.get("suite") or results_dir.resolve().name),
        manifest=manifest,
        suite=_suite(folder.suite),
        entries=entries,
        rows=rows,
        maps=_maps(folder.read_json(folder.maps), folder.maps),
        tracks=tracks,
        mark=mark,
    )


def read_samples(
    material: ReportData, names: Sequence[str], rows: Iterable[int] | None = None
) -> Mapping[int, Sequence[Floats]]:
    """Return the samples of all agents of each row that has tracks, (len(names), m) each.

    Args:
        names: Columns of the tracks.
        rows: Those wanted; absent: all.
    """
    if material.tracks is None:
        return {}
    trials = material.rows["trial"]
    row_of = {str(trials[row]): row for row in (range(len(trials)) if rows is None else rows)}
    found: dict[int, list[Floats]] = {}
    for batch in material.tracks.select(["trial", *names]).to_batches(max_chunksize=512):
        for k, trial in enumerate(batch.column(0).to_pylist()):
            if trial in row_of:
                lists = (batch.column(i + 1)[k].values for i in range(len(names)))
                series = [np.atleast_1d(np.asarray(each, dtype=np.float64)) for each in lists]
                n = min(map(len, series))
                found.setdefault(row_of[trial], []).append(np.stack([each[:n] for each in series]))
    return found


def _suite(path: Path) -> Mapping[str, Any]:
    if not path.is_file():
        return {}
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=CoreLoader)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise UsageError(f"{path}: expected the suite as YAML, was a damaged file. Take it from a copy.") from error
    check_files(path.parent, path.name)
    return content if isinstance(content, dict) else {}


def _entries(manifest: Mapping[str, Any], table: pa.Table, mark: VerificationMark | None) -> tuple[ReportEntry, ...]:
    listed = {str(entry.get("name")): entry for entry in manifest.get("entries") or ()}
    flown = dict.fromkeys(table.column("entry").to_pylist())
    anchors = {name: which for which, name in (manifest.get("anchors") or {}).items() if name}
    names = [*(name for name in listed if name in flown), *(name for name in flown if name not in listed)]
    verified = mark.entries if mark is not None else {}
    is_merged = "merged_from" in manifest
    return tuple(
        _entry(name, listed.get(name) or {}, anchors.get(name, ""), verified.get(name, False) if is_merged else None)
        for name in names
    )


def _entry(name: str, listed: Mapping[str, Any], anchor: str, is_verified: bool | None) -> ReportEntry:  # noqa: FBT001 - as it is kept
    return ReportEntry(
        name=name,
        title=str(listed.get("title") or name),
        family=str(listed.get("family") or ""),
        is_blind=bool(listed.get("blind")),
        language=str(listed.get("language") or ""),
        knows=_text(listed.get("knows")),
        parameters=listed.get("parameters") or {},
        agent_hash=str(listed.get("agent_hash") or ""),
        anchor=anchor,
        submission=str(listed.get("submission") or ""),
        is_verified=is_verified,
    )


def _text(value: Any) -> str:
    if isinstance(value, str) or value is None:
        return value or ""
    return "+".join(map(str, value)) if isinstance(value, Sequence) else json.dumps(value)


def _array(column: pa.ChunkedArray) -> NDArray[Any]:
    kind = column.type
    if pa.types.is_string(kind):
        # Each text once, however many rows have it.
        coded = column.fill_null("").combine_chunks().dictionary_encode()
        return np.array(coded.dictionary.to_pylist(), dtype=object)[coded.indices.to_numpy()]
    if pa.types.is_boolean(kind):
        return column.fill_null(False).to_numpy()  # noqa: FBT003 - the value of an absent flag
    # A seed is a whole number of 64 bits: as a float it would lose its last digits.
    if pa.types.is_integer(kind) and not column.null_count:
        return column.to_numpy().astype(np.int64)
    return column.cast(pa.float64()).fill_null(math.nan).to_numpy().astype(np.float64)


def _codes(values: NDArray[Any]) -> Ints:
    index: dict[Any, int] = {}
    return np.array([index.setdefault(value, len(index)) for value in values.tolist()], dtype=np.int64)


def _maps(content: Mapping[str, Any], path: Path) -> tuple[EnvironmentMap, ...]:
    try:
        return tuple(parse_map(listed) for listed in content.get("maps") or ())
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path}: expected maps of the rooms, was a damaged file. Take it from a copy.") from error


def parse_map(listed: Mapping[str, Any]) -> EnvironmentMap:
    """Return a map as `maps.json` has it."""
    nx, ny = (int(n) for n in listed["shape"])
    x_m, y_m = listed["origin_m"][:2]
    return EnvironmentMap(
        scenario=str(listed["scenario"]),
        varied=str(listed.get("varied") or "{}"),
        height_m=float(listed["height_m"]),
        origin_m=(float(x_m), float(y_m)),
        cell_m=float(listed["cell_m"]),
        occupied=_grid(listed["occupied"], np.dtype("u1"), (nx, ny)) > 0,
        mean_gas_ppm=_optional_grid(listed.get("mean_gas_ppm"), (nx, ny)),
        intermittency=_optional_grid(listed.get("intermittency"), (nx, ny)),
        wind_toward=_optional_grid(listed.get("wind_toward"), (nx, ny, 2)),
        sources_m=tuple((float(x), float(y), float(z)) for x, y, z in listed.get("sources_m") or ()),
    )


def _optional_grid(text: str | None, shape: tuple[int, ...]) -> Floats | None:
    return None if text is None else _grid(text, np.dtype("<f4"), shape).astype(np.float64)


def _grid(text: str, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    return np.frombuffer(base64.b64decode(text, validate=True), dtype=dtype).reshape(shape)
