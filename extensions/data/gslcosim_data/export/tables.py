"""Tables of a run's streams as files of Parquet or CSV, with a dictionary of all columns and pictures of cameras."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from gslcosim_data.run import RunData
from gslcosim_data.tables import StreamTable, TableColumn, build_tables, build_vectors, safe_name, to_arrow
from gslcosim_data.text_tables import neutralise_cell, write_csv

DICTIONARY = "dictionary"
_ENDINGS = {"image/png": "png", "image/jpeg": "jpg"}


def write_tables(
    run: RunData, folder: Path, to: Literal["parquet", "csv"], progress: Callable[[str], None]
) -> list[Path]:
    """Write a file for each stream of a run, the pictures of its cameras, and what each column means.

    Args:
        folder: Where; it exists.
        progress: Receives the name of each table before it is written.

    Returns:
        What was written.
    """
    files: list[Path] = []
    written: list[StreamTable] = []
    for table in (*build_tables(run), *_pictures(run, folder, files)):
        progress(table.name)
        path = folder / f"{table.name}.{to}"
        if to == "csv":
            pyarrow.csv.write_csv(_neutralise(to_arrow(table, run.run_id)), path)
        else:
            pyarrow.parquet.write_table(to_arrow(table, run.run_id), path)
        files.append(path)
        written.append(table)
    return [*_write_dictionary(run, folder, to, written), *files]


def _neutralise(table: pa.Table) -> pa.Table:
    columns = [
        pa.array([neutralise_cell(value) for value in column.to_pylist()], pa.string())
        if pa.types.is_string(column.type)
        else column
        for column in table.columns
    ]
    return pa.table(columns, names=[neutralise_cell(name) for name in table.column_names])


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
        from_camera = "world from camera (x right, y down, z ahead)"
        yield StreamTable(
            name,
            f"{what} of {camera.sensor} of {camera.agent}",
            (
                TableColumn("tick", camera.tick, "number of the tick at which it came"),
                TableColumn("time_s", camera.time_s, "simulated time", "s"),
                TableColumn("file", names, "the picture"),
                *build_vectors("", camera.position_world_m, "eye", "m"),
                *build_vectors("quaternion_", camera.quaternion_wxyz, from_camera, parts="wxyz"),
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
        write_csv(file, [[*rows[0]], *(row.values() for row in rows)])
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
