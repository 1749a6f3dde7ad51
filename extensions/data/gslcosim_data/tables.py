"""A run's streams as tables, with units in the names of columns and a meaning for each."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim_data.streams import Recorded, RecordedPoints, RecordedSeries, RecordedShapes, RecordedTexts, RecordedTrack
from gslcosim_services.recorder.stream_table import FILAMENTS, LOGS, MARKS, TABLES, WAYPOINTS, Stream

if TYPE_CHECKING:
    from gslcosim_data.run import RunData

_AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class TableColumn:
    """One column: its values, one for each row, and what they are.

    `values` are numbers or texts; NaN and an empty text stand for what is absent. `unit` is empty where there is none.
    """

    name: str
    values: NDArray[Any] | Sequence[str]
    meaning: str
    unit: str = ""


@dataclass(frozen=True, eq=False)
class StreamTable:
    """One stream as columns of the same length; `name` is a file name without its ending."""

    name: str
    meaning: str
    columns: tuple[TableColumn, ...]

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(self.columns[0].values)


def build_tables(run: "RunData") -> Iterator[StreamTable]:
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


def build_vectors(
    prefix: str, values: NDArray[np.float64], meaning: str, unit: str = "", parts: Sequence[str] = _AXES
) -> tuple[TableColumn, ...]:
    """Return a column for each part of (n, k) values; the unit stands behind the names."""
    suffix = f"_{unit.replace('/', '_')}" if unit else ""
    return tuple(
        TableColumn(f"{prefix}{part}{suffix}", values[:, i], f"{meaning}, {part}", unit) for i, part in enumerate(parts)
    )


def _times(recorded: Recorded, rows: Any = slice(None)) -> tuple[TableColumn, TableColumn]:
    return (
        TableColumn("tick", recorded.tick[rows], "number of the tick at whose end it holds"),
        TableColumn("time_s", recorded.time_s[rows], "simulated time", "s"),
    )


def _places(positions_m: NDArray[np.float64], what: str, prefix: str = "") -> tuple[TableColumn, ...]:
    return build_vectors(prefix, positions_m, f"{what}, world frame", "m")


def _track(track: RecordedTrack) -> StreamTable:
    attitude = "attitude as unit quaternion, world from body"
    return StreamTable(
        f"track_{safe_name(track.agent)}",
        f"where the vehicle of {track.agent} was at the end of each tick",
        (
            *_times(track),
            *_places(track.position_world_m, "place of the body"),
            *build_vectors("quaternion_", track.quaternion_wxyz, attitude, parts=("w", *_AXES)),
        ),
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
            f"{kind}_{safe_name(agent)}" if agent else kind,
            f"{meaning}, of {agent}" if agent else meaning,
            (*_times(Recorded(tick=tick, time_s=time_s)), *columns),
        )


def _columns(series: RecordedSeries, rows: NDArray[np.int64], n_rows: int) -> Iterator[TableColumn]:
    prefix = "_".join(filter(None, (series.sensor, series.gas)))
    of = " of ".join(filter(None, (series.gas, series.sensor)))
    for i, name in enumerate(series.columns):
        values = np.full(n_rows, np.nan)
        values[rows] = series.values[:, i]
        words = name.replace("_", " ")
        yield TableColumn(
            safe_name(f"{prefix}_{name}" if prefix else name),
            values,
            f"{words}: {of}" if of else words,
            "" if series.unit == "1" else series.unit,
        )


def _commands(commands: Mapping[str, Sequence[Command]]) -> StreamTable:
    rows = [(agent, command) for agent, some in commands.items() for command in some]
    rows.sort(key=lambda each: each[1].tick)

    def vectors(pick: Any, prefix: str, what: str, unit: str) -> tuple[TableColumn, ...]:
        values = np.array([pick(command) or (np.nan,) * 3 for _, command in rows], dtype=np.float64).reshape(-1, 3)
        return build_vectors(prefix, values, f"{what}, world frame", unit)

    def numbers(pick: Any) -> NDArray[np.float64]:
        picked = [pick(command) for _, command in rows]
        return np.array([np.nan if number is None else number for number in picked], dtype=np.float64)

    declared = "declared place of the source"
    return StreamTable(
        "commands",
        "the commands of agents that took effect",
        (
            TableColumn(
                "tick",
                np.array([command.tick for _, command in rows], dtype=np.int64),
                "number of the tick whose observation it answers",
            ),
            TableColumn("agent", [agent for agent, _ in rows], "whose command it is"),
            TableColumn("kind", [command.kind for _, command in rows], "kind of the command"),
            *vectors(lambda c: c.position_world_m, "", "waypoint", "m"),
            *vectors(lambda c: c.velocity_world_m_s, "velocity_", "velocity", "m/s"),
            TableColumn("hold_s", numbers(lambda c: c.hold_s), "how long it holds", "s"),
            *vectors(lambda c: c.declaration and c.declaration.position_world_m, "declared_", declared, "m"),
            TableColumn(
                "confidence",
                numbers(lambda c: c.declaration and c.declaration.confidence),
                "how sure the agent is of it, 0 to 1",
            ),
            TableColumn(
                "json",
                [codec.encode_json(command.model_copy(update={"belief": None})).decode() for _, command in rows],
                "the whole command but for its belief, as JSON",
            ),
        ),
    )


def _points(stream: Stream, by_agent: Mapping[str, RecordedPoints]) -> StreamTable:
    agents = [agent for agent, points in by_agent.items() for _ in points.tick]
    every = [*by_agent.values()]
    return StreamTable(
        stream.name,
        stream.meaning,
        (
            *_times(
                Recorded(
                    tick=np.concatenate([points.tick for points in every]),
                    time_s=np.concatenate([points.time_s for points in every]),
                )
            ),
            TableColumn("agent", agents, "whose it is"),
            *_places(np.concatenate([points.position_world_m for points in every]), "place"),
            TableColumn("label", [label for points in every for label in points.label], "what"),
        ),
    )


def _texts(log: Stream, texts: RecordedTexts) -> StreamTable:
    return StreamTable(
        log.name,
        log.meaning,
        (
            *_times(texts),
            TableColumn("level", texts.level, "INFO or WARN"),
            TableColumn("text", texts.text, "what happened"),
        ),
    )


# A row for each cell of each snapshot that is above 0; lower corners (x, y, z) of cells, or at one height (x, y).
def _cells(
    name: str,
    meaning: str,
    recorded: Recorded,
    snapshots: Iterable[tuple[NDArray[Any], Any, float]],
    value: TableColumn,
) -> StreamTable:
    which, centres, found = [], [], []
    for i, (values, origin_m, cell_m) in enumerate(snapshots):
        cells = np.argwhere(values > 0)
        centres_m = np.full((len(cells), 3), float(origin_m[2]))
        n_axes = cells.shape[1]
        centres_m[:, :n_axes] = np.array(origin_m)[:n_axes] + (cells + 0.5) * cell_m
        which.append(np.full(len(cells), i))
        centres.append(centres_m)
        found.append(values[values > 0])
    return StreamTable(
        name,
        meaning,
        (
            *_times(recorded, np.concatenate(which)),
            *_places(np.concatenate(centres), "centre of the cell"),
            replace(value, values=np.concatenate(found)),
        ),
    )


def _beliefs(run: "RunData") -> Iterator[StreamTable]:
    for agent, beliefs in run.beliefs.items():
        yield _cells(
            f"belief_{safe_name(agent)}",
            f"where {agent} believed the source to be, a row for each cell that is not impossible",
            beliefs,
            ((b.probability.to_array().astype(np.float64), b.origin_m, b.cell_m) for b in beliefs.belief),
            TableColumn("probability", (), "probability of the cell"),
        )


def _gas(run: "RunData") -> Iterator[StreamTable]:
    for gas, slices in run.gas_slices.items():
        if len(slices.tick):
            origin_m = (*slices.origin_m, slices.height_m)
            yield _cells(
                f"gas_{safe_name(gas)}",
                f"{gas} in one layer, a row for each cell with at least {slices.min_ppm:g} ppm; within 1.4 %",
                slices,
                ((slices.mixing_ratio_ppm(i), origin_m, slices.cell_m) for i in range(len(slices.tick))),
                TableColumn("mixing_ratio_ppm", (), "mixing ratio", "ppm"),
            )
    cloud = run.filaments
    which = np.repeat(np.arange(len(cloud.tick)), np.diff(cloud.starts))
    yield from _if_any(
        StreamTable(
            FILAMENTS.name,
            FILAMENTS.meaning,
            (
                *_times(cloud, which),
                *_places(cloud.centre_world_m, "centre"),
                TableColumn("sigma_m", cloud.sigma_m, "standard deviation", "m"),
            ),
        )
    )


def _clouds_of_points(shapes: RecordedShapes) -> StreamTable:
    which = np.repeat(np.arange(len(shapes.tick)), np.diff(shapes.starts))
    return StreamTable(
        f"points_{safe_name(shapes.agent)}_{safe_name(shapes.sensor)}",
        f"what {shapes.sensor} of {shapes.agent} saw, a row for each point",
        (*_times(shapes, which), *_places(shapes.points_world_m, "place")),
    )


def _rays(shapes: RecordedShapes) -> StreamTable:
    which = np.repeat(np.arange(len(shapes.tick)), np.diff(shapes.starts))
    starts_m, ends_m = shapes.points_world_m[:, 0], shapes.points_world_m[:, 1]
    return StreamTable(
        f"rays_{safe_name(shapes.agent)}_{safe_name(shapes.sensor)}",
        f"the rays of {shapes.sensor} of {shapes.agent}; one that met nothing has no length",
        (
            *_times(shapes, which),
            *_places(starts_m, "where it starts", "from_"),
            *_places(ends_m, "what it met", "to_"),
        ),
    )


def _if_any(table: StreamTable) -> Iterator[StreamTable]:
    if table.n_rows:
        yield table


def read_table(run: "RunData", name: str) -> pa.Table:
    """Return a stream of a run as an Arrow table: what `RunData.table` promises.

    Raises:
        UsageError: the run has no stream of that name.
    """
    tables = {table.name: table for table in build_tables(run)}
    if name in tables:
        return to_arrow(tables[name], run.run_id)
    of_agents = {agent: tables.get(f"{name}_{safe_name(agent)}") for agent in run.agents}
    parts = [
        arrow.add_column(0, pa.field("agent", pa.string(), metadata={"meaning": "whose it is"}), [[agent] * len(arrow)])
        for agent, table in of_agents.items()
        if table is not None
        for arrow in [to_arrow(table, run.run_id)]
    ]
    if not parts:
        raise UsageError(f"{run.run_id}: expected a table of {', '.join(tables)}, was {name!r}.")
    # Agents with other sensors have other columns: absent ones are null.
    return pa.concat_tables(parts, promote_options="default")


def to_arrow(table: StreamTable, run_id: str) -> pa.Table:
    """Return a stream as an Arrow table whose fields have `meaning` and `unit` as metadata."""
    content = pa.table({column.name: _array(column) for column in table.columns})
    fields = [
        field.with_metadata({"meaning": describe_column(column), **({"unit": column.unit} if column.unit else {})})
        for field, column in zip(content.schema, table.columns, strict=True)
    ]
    return content.cast(pa.schema(fields, metadata={"meaning": table.meaning, "run_id": run_id}))


# Texts that are absent are empty, numbers null.
def _array(column: TableColumn) -> "pa.Array[pa.Scalar]":  # type: ignore[type-arg]
    if isinstance(column.values, np.ndarray):
        return pa.array(column.values, from_pandas=True)
    return pa.array([*column.values], type=pa.string())


def describe_column(column: TableColumn) -> str:
    """Return the meaning of a column, with its unit in brackets."""
    return f"{column.meaning} [{column.unit}]" if column.unit else column.meaning
