"""Tables of a run's streams as Parquet or CSV, with units in names and a dictionary of all columns."""

import csv
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim.data.run import RunData
from gslcosim.data.streams import RecordedPoints, RecordedSeries, RecordedShapes, RecordedTexts, RecordedTrack
from gslcosim_services.recorder.stream_table import FILAMENTS, LOGS, MARKS, TABLES, WAYPOINTS, Stream

_AXES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True, eq=False)
class TableColumn:
    """One column: its values, one for each row, and what they are.

    `values` are numbers or texts; NaN and an empty text stand for what is absent. `unit` is empty where there is none.
    """

    name: str
    values: NDArray[Any] | Sequence[str]
    meaning: str
    unit: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class StreamTable:
    """One stream as columns of the same length; `name` is a file name without its ending."""

    name: str
    meaning: str
    columns: tuple[TableColumn, ...]

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(self.columns[0].values)


def build_tables(run: RunData) -> Iterator[StreamTable]:
    """Return a table for each stream that a run has, and none for what it lacks.

    Tracks, samples, readings and figures have a row for each tick, one table for each agent; beliefs, slices of gas
    and clouds have a row for each cell or filament that is not empty.
    """
    for track in run.tracks.values():
        yield _track(track)
    numbers = {"samples": run.samples, "readings": run.readings, "figures": run.figures, "services": run.service_curves}
    for kind, meaning in TABLES.items():
        yield from _series(kind, meaning, numbers[kind])
    yield from _if_any(_commands(run.commands))
    yield from _if_any(_points(WAYPOINTS, run.waypoints))
    yield from _if_any(_points(MARKS, run.marks))
    for log, texts in zip(LOGS, (run.events, run.contacts, run.radio, run.faults), strict=True):
        yield from _if_any(_texts(log, texts))
    yield from _beliefs(run)
    yield from _gas(run)
    for shapes in run.point_clouds:
        yield from _if_any(_clouds_of_points(shapes))
    for shapes in run.rays:
        yield from _if_any(_rays(shapes))


def safe_name(name: str) -> str:
    """Return a name as a part of a file's name, or of a topic's."""
    return re.sub(r"\W+", "_", name)


def _times(tick: NDArray[np.int64], time_s: NDArray[np.float64]) -> tuple[TableColumn, TableColumn]:
    return (
        TableColumn(name="tick", values=tick, meaning="number of the tick at whose end it holds"),
        TableColumn(name="time_s", values=time_s, meaning="simulated time", unit="s"),
    )


def _places(positions_m: NDArray[np.float64], what: str, prefix: str = "") -> tuple[TableColumn, ...]:
    return tuple(
        TableColumn(
            name=f"{prefix}{axis}_m", values=positions_m[:, i], meaning=f"{what}, world frame, {axis}", unit="m"
        )
        for i, axis in enumerate(_AXES)
    )


def _track(track: RecordedTrack) -> StreamTable:
    turns = tuple(
        TableColumn(
            name=f"quaternion_{part}",
            values=track.quaternion_wxyz[:, i],
            meaning=f"attitude as unit quaternion, world from body, {part}",
        )
        for i, part in enumerate(("w", *_AXES))
    )
    return StreamTable(
        name=f"track_{safe_name(track.agent)}",
        meaning=f"where the vehicle of {track.agent} was at the end of each tick",
        columns=(*_times(track.tick, track.time_s), *_places(track.position_world_m, "place of the body"), *turns),
    )


# One table for each agent; a series without a value at a tick has NaN there.
def _series(kind: str, meaning: str, all_series: Sequence[RecordedSeries]) -> Iterator[StreamTable]:
    for agent in dict.fromkeys(series.agent for series in all_series):
        some = [series for series in all_series if series.agent == agent]
        tick = np.unique(np.concatenate([series.tick for series in some]))
        time_s = np.full(len(tick), np.nan)
        columns: list[TableColumn] = []
        for series in some:
            rows = np.searchsorted(tick, series.tick)
            time_s[rows] = series.time_s
            columns += _columns(series, rows, len(tick))
        yield StreamTable(
            name=f"{kind}_{safe_name(agent)}" if agent else kind,
            meaning=f"{meaning}, of {agent}" if agent else meaning,
            columns=(*_times(tick, time_s), *columns),
        )


def _columns(series: RecordedSeries, rows: NDArray[np.int64], n_rows: int) -> Iterator[TableColumn]:
    prefix = "_".join(filter(None, (series.sensor, series.gas)))
    of = " of ".join(filter(None, (series.gas, series.sensor)))
    for i, name in enumerate(series.columns):
        values = np.full(n_rows, np.nan)
        values[rows] = series.values[:, i]
        words = name.replace("_", " ")
        yield TableColumn(
            name=safe_name(f"{prefix}_{name}" if prefix else name),
            values=values,
            meaning=f"{words}: {of}" if of else words,
            unit="" if series.unit == "1" else series.unit,
        )


def _commands(commands: Mapping[str, Sequence[Command]]) -> StreamTable:
    rows = [(agent, command) for agent, some in commands.items() for command in some]
    rows.sort(key=lambda each: each[1].tick)

    def vectors(pick: Any, name: str, what: str, unit: str) -> tuple[TableColumn, ...]:
        values = np.array([pick(command) or (np.nan,) * 3 for _, command in rows], dtype=np.float64).reshape(-1, 3)
        suffix = unit.replace("/", "_")
        return tuple(
            TableColumn(
                name=f"{name}{axis}_{suffix}", values=values[:, i], meaning=f"{what}, world frame, {axis}", unit=unit
            )
            for i, axis in enumerate(_AXES)
        )

    def numbers(pick: Any) -> NDArray[np.float64]:
        picked = [pick(command) for _, command in rows]
        return np.array([np.nan if number is None else number for number in picked], dtype=np.float64)

    declared = "declared place of the source"
    return StreamTable(
        name="commands",
        meaning="the commands of agents that took effect",
        columns=(
            TableColumn(
                name="tick",
                values=np.array([command.tick for _, command in rows], dtype=np.int64),
                meaning="number of the tick whose observation it answers",
            ),
            TableColumn(name="agent", values=[agent for agent, _ in rows], meaning="whose command it is"),
            TableColumn(name="kind", values=[command.kind for _, command in rows], meaning="kind of the command"),
            *vectors(lambda c: c.position_world_m, "", "waypoint", "m"),
            *vectors(lambda c: c.velocity_world_m_s, "velocity_", "velocity", "m/s"),
            TableColumn(name="hold_s", values=numbers(lambda c: c.hold_s), meaning="how long it holds", unit="s"),
            *vectors(lambda c: c.declaration and c.declaration.position_world_m, "declared_", declared, "m"),
            TableColumn(
                name="confidence",
                values=numbers(lambda c: c.declaration and c.declaration.confidence),
                meaning="how sure the agent is of it, 0 to 1",
            ),
            TableColumn(
                name="json",
                values=[codec.encode_json(command.model_copy(update={"belief": None})).decode() for _, command in rows],
                meaning="the whole command but for its belief, as JSON",
            ),
        ),
    )


def _points(stream: Stream, by_agent: Mapping[str, RecordedPoints]) -> StreamTable:
    agents = [agent for agent, points in by_agent.items() for _ in points.tick]
    every = [*by_agent.values()]
    return StreamTable(
        name=stream.name,
        meaning=stream.meaning,
        columns=(
            *_times(
                np.concatenate([points.tick for points in every]), np.concatenate([points.time_s for points in every])
            ),
            TableColumn(name="agent", values=agents, meaning="whose it is"),
            *_places(np.concatenate([points.position_world_m for points in every]), "place"),
            TableColumn(name="label", values=[label for points in every for label in points.label], meaning="what"),
        ),
    )


def _texts(log: Stream, texts: RecordedTexts) -> StreamTable:
    return StreamTable(
        name=log.name,
        meaning=log.meaning,
        columns=(
            *_times(texts.tick, texts.time_s),
            TableColumn(name="level", values=texts.level, meaning="INFO or WARN"),
            TableColumn(name="text", values=texts.text, meaning="what happened"),
        ),
    )


def _beliefs(run: RunData) -> Iterator[StreamTable]:
    for agent, beliefs in run.beliefs.items():
        parts: list[tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]] = []
        for i, belief in enumerate(beliefs.belief):
            probability = beliefs.belief[i].probability.to_array()
            cells = np.argwhere(probability > 0)
            centres_m = np.full((len(cells), 3), float(belief.origin_m[2]))
            n_axes = cells.shape[1]
            centres_m[:, :n_axes] = np.array(belief.origin_m)[:n_axes] + (cells + 0.5) * belief.cell_m
            parts.append((np.full(len(cells), i), centres_m, probability[probability > 0].astype(np.float64)))
        which, centres_m, probability = (np.concatenate(some) for some in zip(*parts, strict=True))
        yield StreamTable(
            name=f"belief_{safe_name(agent)}",
            meaning=f"where {agent} believed the source to be, a row for each cell that is not impossible",
            columns=(
                *_times(beliefs.tick[which], beliefs.time_s[which]),
                *_places(centres_m, "centre of the cell"),
                TableColumn(name="probability", values=probability, meaning="probability of the cell"),
            ),
        )


def _gas(run: RunData) -> Iterator[StreamTable]:
    for gas, slices in run.gas_slices.items():
        if not len(slices.tick):
            continue
        parts: list[tuple[NDArray[Any], ...]] = []
        for i in range(len(slices.tick)):
            ppm = slices.mixing_ratio_ppm(i)
            cells = np.argwhere(ppm > 0)
            centres_m = np.full((len(cells), 3), slices.height_m)
            centres_m[:, :2] = np.array(slices.origin_m) + (cells + 0.5) * slices.cell_m
            parts.append((np.full(len(cells), i), centres_m, ppm[ppm > 0]))
        which, centres_m, ppm = (np.concatenate(some) for some in zip(*parts, strict=True))
        yield StreamTable(
            name=f"gas_{safe_name(gas)}",
            meaning=f"{gas} in one layer, a row for each cell with at least {slices.min_ppm:g} ppm; within 1.4 %",
            columns=(
                *_times(slices.tick[which], slices.time_s[which]),
                *_places(centres_m, "centre of the cell"),
                TableColumn(name="mixing_ratio_ppm", values=ppm, meaning="mixing ratio", unit="ppm"),
            ),
        )
    cloud = run.filaments
    which = np.repeat(np.arange(len(cloud.tick)), np.diff(cloud.starts))
    yield from _if_any(
        StreamTable(
            name=FILAMENTS.name,
            meaning=FILAMENTS.meaning,
            columns=(
                *_times(cloud.tick[which], cloud.time_s[which]),
                *_places(cloud.centre_world_m, "centre"),
                TableColumn(name="sigma_m", values=cloud.sigma_m, meaning="standard deviation", unit="m"),
            ),
        )
    )


def _clouds_of_points(shapes: RecordedShapes) -> StreamTable:
    which = np.repeat(np.arange(len(shapes.tick)), np.diff(shapes.starts))
    return StreamTable(
        name=f"points_{safe_name(shapes.agent)}_{safe_name(shapes.sensor)}",
        meaning=f"what {shapes.sensor} of {shapes.agent} saw, a row for each point",
        columns=(*_times(shapes.tick[which], shapes.time_s[which]), *_places(shapes.points_world_m, "place")),
    )


def _rays(shapes: RecordedShapes) -> StreamTable:
    which = np.repeat(np.arange(len(shapes.tick)), np.diff(shapes.starts))
    starts_m, ends_m = shapes.points_world_m[:, 0], shapes.points_world_m[:, 1]
    return StreamTable(
        name=f"rays_{safe_name(shapes.agent)}_{safe_name(shapes.sensor)}",
        meaning=f"the rays of {shapes.sensor} of {shapes.agent}; one that met nothing has no length",
        columns=(
            *_times(shapes.tick[which], shapes.time_s[which]),
            *_places(starts_m, "where it starts", "from_"),
            *_places(ends_m, "what it met", "to_"),
        ),
    )


def _if_any(table: StreamTable) -> Iterator[StreamTable]:
    if table.n_rows:
        yield table


DICTIONARY = "dictionary"
_ENDINGS = {"image/png": "png", "image/jpeg": "jpg"}


def write_tables(
    run: RunData, folder: Path, to: Literal["parquet", "csv"], progress: Callable[[str], None]
) -> list[Path]:
    """Write a file for each stream of a run, the pictures of its cameras, and what each column means.

    Args:
        run: What to write.
        folder: Where; it exists.
        to: The format.
        progress: Receives the name of each table before it is written.

    Returns:
        What was written.

    Raises:
        OSError: the machine refuses.
    """
    files: list[Path] = []
    written: list[StreamTable] = []
    for table in (*build_tables(run), *_pictures(run, folder, files)):
        progress(table.name)
        path = folder / f"{table.name}.{to}"
        content = pa.table({column.name: _array(column) for column in table.columns})
        if to == "csv":
            pyarrow.csv.write_csv(content, path)
        else:
            meanings = {column.name: _meaning(column) for column in table.columns}
            fields = [field.with_metadata({"meaning": meanings[field.name]}) for field in content.schema]
            metadata = {"meaning": table.meaning, "run_id": run.run_id}
            pyarrow.parquet.write_table(content.cast(pa.schema(fields, metadata=metadata)), path)
        files.append(path)
        written.append(table)
    return [*_write_dictionary(run, folder, to, written), *files]


# Texts that are absent are empty, numbers null.
def _array(column: TableColumn) -> "pa.Array[pa.Scalar]":  # type: ignore[type-arg]
    if isinstance(column.values, np.ndarray):
        return pa.array(column.values, from_pandas=True)
    return pa.array([*column.values], type=pa.string())


def _meaning(column: TableColumn) -> str:
    return f"{column.meaning} [{column.unit}]" if column.unit else column.meaning


def _pictures(run: RunData, folder: Path, files: list[Path]) -> Iterable[StreamTable]:
    for camera in run.pictures:
        name = f"pictures_{safe_name(camera.agent)}_{safe_name(camera.sensor)}"
        (folder / name).mkdir()
        ending = _ENDINGS[camera.media_type]
        names = [f"{name}/{tick:08d}.{ending}" for tick in camera.tick]
        for path, data in zip(names, camera.data, strict=True):
            (folder / path).write_bytes(data)
            files.append(folder / path)
        what = "depths [mm]" if camera.is_depth else "pictures"
        places = [
            TableColumn(name=f"{axis}_m", values=camera.position_world_m[:, i], meaning=f"eye, {axis}", unit="m")
            for i, axis in enumerate("xyz")
        ]
        turns = [
            TableColumn(
                name=f"quaternion_{part}",
                values=camera.quaternion_wxyz[:, i],
                meaning=f"world from camera (x right, y down, z ahead), {part}",
            )
            for i, part in enumerate("wxyz")
        ]
        yield StreamTable(
            name=name,
            meaning=f"{what} of {camera.sensor} of {camera.agent}",
            columns=(
                TableColumn(name="tick", values=camera.tick, meaning="number of the tick at which it came"),
                TableColumn(name="time_s", values=camera.time_s, meaning="simulated time", unit="s"),
                TableColumn(name="file", values=names, meaning="the picture"),
                *places,
                *turns,
            ),
        )


def _write_dictionary(run: RunData, folder: Path, to: str, tables: Iterable[StreamTable]) -> list[Path]:
    tables = [*tables]
    rows = [
        {
            "file": f"{table.name}.{to}",
            "column": column.name,
            "unit": column.unit,
            "type": "number" if isinstance(column.values, np.ndarray) else "text",
            "meaning": column.meaning,
        }
        for table in tables
        for column in table.columns
    ]
    as_csv, as_json = folder / f"{DICTIONARY}.csv", folder / f"{DICTIONARY}.json"
    with as_csv.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=[*rows[0]])
        writer.writeheader()
        writer.writerows(rows)
    dictionary = {
        "run_id": run.run_id,
        "scenario": run.scenario.name,
        "seed": run.scenario.seed,
        "tick_s": run.tick_s,
        "tables": [
            {
                "file": f"{table.name}.{to}",
                "meaning": table.meaning,
                "n_rows": table.n_rows,
                "columns": [
                    {"name": row["column"], "unit": row["unit"], "meaning": row["meaning"]}
                    for row in rows
                    if row["file"] == f"{table.name}.{to}"
                ],
            }
            for table in tables
        ],
    }
    as_json.write_text(json.dumps(dictionary, indent=2) + "\n", encoding="utf-8")
    return [as_csv, as_json]
