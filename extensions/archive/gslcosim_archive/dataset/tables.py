"""Tables of a dataset: a row for each flight and one for each sample, of one or several folders of results."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gslcosim.base.errors import UsageError
from gslcosim_archive.sealing import hash_recipe
from gslcosim_archive.signing.signed_results import check_signature
from gslcosim_bench.cases.suite_files import LoadedSuite, load_suite
from gslcosim_bench.results import read_state
from gslcosim_bench.store import (
    SERIES,
    TRACK_COLUMNS,
    TRIAL_COLUMNS,
    Column,
    ResultsFolder,
    ResultsManifest,
    build_schema,
)

_compute: Any = pc

ORIGIN_COLUMNS = (
    Column("results", pa.string(), "name of the folder of results that the flight is from"),
    Column("suite_seed", pa.int64(), "seed of the suite; absent where it was sealed"),
    Column(
        "commitment", pa.string(), "commitment to the sealed seed of the suite, a SHA-256; absent where it was open"
    ),
)
"""Columns that say where a flight is from."""

# Workers may be named after hosts.
LEFT_OUT = ("wall_worker",)
"""Columns of results that are not published."""

# A folder of some machine, up to the last separator; `m/s`, `//` and what follows a bracket are none.
_FOLDER = re.compile(r"""(?<![\w.)\]}/:])/(?:[^\s/:;,'"()<>|\[\]{}]+/)+""")


@dataclass(frozen=True, kw_only=True)
class Origin:
    """A folder of results that a dataset is made of.

    `key` is the fingerprint of the key that has signed it, or None; `n_planned` counts the flights of the suite with
    all its entries.
    """

    name: str
    folder: ResultsFolder
    manifest: ResultsManifest
    suite: LoadedSuite
    key: str | None
    n_planned: int

    @property
    def seed(self) -> int | None:
        """The seed of the suite, or None where it was sealed."""
        return self.manifest.get("seed")

    @property
    def commitment(self) -> str | None:
        """The commitment to the sealed seed, or None where the seed was open."""
        return self.suite.suite.sealed


@dataclass(frozen=True, kw_only=True)
class PublishedTable:
    """A table of a dataset: its name, what a row is, and its columns with their meanings."""

    name: str
    row: str
    columns: tuple[Column, ...]
    table: pa.Table

    @property
    def file(self) -> str:
        """The name of its file."""
        return f"{self.name}.parquet"


def read_origins(folders: Sequence[Path], *, may_be_incomplete: bool = False) -> tuple[Origin, ...]:
    """Return folders of results that can be published together: finished, and of the same cases but for their seeds.

    Args:
        folders: Folders of `bench run`.
        may_be_incomplete: Accept those in which flights of the suite are missing.
    """
    origins = tuple(_read_origin(folder, may_be_incomplete=may_be_incomplete) for folder in folders)
    seen: dict[str, Origin] = {}
    for origin in origins:
        if other := seen.get(origin.name):
            raise UsageError(
                f"{origin.folder.path}: expected folders with different names, which tell their rows apart, was "
                f"{origin.name} as {other.folder.path}. Rename one."
            )
        seen[origin.name] = origin
    _check_suites(origins)
    _check_programs(origins)
    return origins


def _read_origin(folder: Path, *, may_be_incomplete: bool) -> Origin:
    results = ResultsFolder(folder)
    results.check()
    if results.shard.is_file():
        raise UsageError(
            f"{folder}: expected the results of a whole suite, was a shard ({results.shard.name}). Merge the shards "
            "first: gslcosim bench merge."
        )
    state = read_state(folder)
    if state["state"] != "complete" and not may_be_incomplete:
        raise UsageError(
            f"{folder}: expected finished results, {state['n_planned']} trials, were {state['n_rows']}. Give the same "
            "gslcosim bench run again: it flies the rest; or add --incomplete if a part was chosen on purpose."
        )
    if not results.suite.is_file():
        raise UsageError(
            f"{folder}: expected the suite that was run ({results.suite.name}), found none. Give the folders that "
            "bench run wrote, not merged ones."
        )
    signed = check_signature(folder)
    return Origin(
        name=folder.resolve().name,
        folder=results,
        manifest=cast("ResultsManifest", results.read_json(results.manifest)),
        suite=load_suite(results.suite, needs_seed=False),
        key=None if signed is None else signed.key.fingerprint,
        n_planned=state["n_planned"],
    )


def _check_suites(origins: Sequence[Origin]) -> None:
    first = origins[0]
    for other in origins[1:]:
        if (here := hash_recipe(other.suite)) != (there := hash_recipe(first.suite)):
            raise UsageError(
                f"{other.folder.path}: expected the cases of {first.folder.path}, of suite {first.suite.suite.name} "
                f"with the recipe {there[:16]}, was suite {other.suite.suite.name} with the recipe {here[:16]}. "
                "Write a dataset for each suite."
            )


def _check_programs(origins: Sequence[Origin]) -> None:
    programs: dict[str, tuple[object, Origin]] = {}
    for origin in origins:
        for entry in origin.manifest.get("entries", []):
            program = (entry.get("agent_hash"), entry.get("parameters") or {})
            before, place = programs.setdefault(entry["name"], (program, origin))
            if before != program:
                raise UsageError(
                    f"{origin.folder.path}: expected the program and parameters of {entry['name']} as in "
                    f"{place.folder.path}, were others. Rename one of the entries, and fly it again."
                )


def build_published_tables(origins: Sequence[Origin], *, has_tracks: bool = True) -> tuple[PublishedTable, ...]:
    """Return the tables `trials` and `tracks` of all folders, without paths of machines.

    Args:
        has_tracks: Whether tracks are published; else the table of trials is alone.
    """
    columns = tuple(column for column in TRIAL_COLUMNS if column.name not in LEFT_OUT)
    trials, tracks, places = [], [], dict[str, Origin]()
    for origin in origins:
        rows, series = origin.folder.tables()
        for trial in rows["trial"].to_pylist():
            if trial in places:
                raise UsageError(
                    f"{origin.folder.path}: expected trials that are nowhere else, was {trial} of "
                    f"{places[trial].folder.path} too. Leave one of the folders out: flights would count twice."
                )
            places[trial] = origin
        trials.append(_publish_trials(origin, rows, columns))
        if has_tracks:
            tracks.append(_flatten_tracks(origin, series))
    table_of_trials = PublishedTable(
        name="trials", row="a flight", columns=(*ORIGIN_COLUMNS, *columns), table=pa.concat_tables(trials)
    )
    if not has_tracks:
        return (table_of_trials,)
    table_of_tracks = PublishedTable(
        name="tracks",
        row="a sample of a flight, about one a second, for each agent",
        columns=_sample_columns(),
        table=pa.concat_tables(tracks),
    )
    return table_of_trials, table_of_tracks


def _publish_trials(origin: Origin, rows: pa.Table, columns: Iterable[Column]) -> pa.Table:
    values: dict[str, Any] = {
        "results": [origin.name] * rows.num_rows,
        "suite_seed": [origin.seed] * rows.num_rows,
        "commitment": [origin.commitment] * rows.num_rows,
    }
    for column in columns:
        is_text = column.type == pa.string()
        values[column.name] = _map_texts(rows[column.name], remove_folders) if is_text else rows[column.name]
    return pa.table(values, schema=build_schema((*ORIGIN_COLUMNS, *columns)))


def _map_texts(texts: pa.ChunkedArray, change: Callable[[str], str]) -> pa.Array:
    changed = {text: None if text is None else change(text) for text in texts.unique().to_pylist()}
    return pa.array([changed[text] for text in texts.to_pylist()], pa.string())


def remove_folders(text: str) -> str:
    """Return a text whose absolute paths have kept their last part alone."""
    return _FOLDER.sub("", text)


# Lists of samples become rows.
def _sample_columns() -> tuple[Column, ...]:
    return tuple(replace(each, type=pa.float32()) if each.name in SERIES else each for each in TRACK_COLUMNS)


def _flatten_tracks(origin: Origin, tracks: pa.Table) -> pa.Table:
    lengths = [_compute.fill_null(_compute.list_value_length(tracks[name]), 0).to_numpy() for name in SERIES]
    if any(not np.array_equal(lengths[0], others) for others in lengths[1:]):
        raise UsageError(
            f"{origin.folder.tracks}: expected series of one length in each row, were others. Take it from a copy."
        )
    row_of_sample = pa.array(np.repeat(np.arange(tracks.num_rows), lengths[0]))
    values = {
        column.name: _compute.fill_null(_compute.list_flatten(tracks[column.name]), np.float32(np.nan))
        if column.name in SERIES
        else tracks[column.name].take(row_of_sample)
        for column in TRACK_COLUMNS
    }
    return pa.table(values, schema=build_schema(_sample_columns()))
