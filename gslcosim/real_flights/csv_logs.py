"""Logs as text: one row for each moment, with the units in the names of columns."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from gslcosim.errors import UsageError
from gslcosim.real_flights.flight_log import FlightLog, Floats, LoggedValues, n_values_of

_TIME = "time_s"
_PLACE = ("x_m", "y_m", "z_m")
_TURN = ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")
_YAW = "yaw_rad"


def read_csv_log(path: Path, sensors: Mapping[str, str]) -> FlightLog:
    """Read a log.

    Columns are `time_s`, `x_m`, `y_m`, `z_m`; `yaw_rad` or `quaternion_w` … `quaternion_z`, else it looks along x; and
    for each sensor those whose names begin with its name and an underscore, as many as its readings have numbers, in
    the order of these. A row without a number in a sensor's columns has no reading of it.

    Args:
        path: The file.
        sensors: By the sensors' names the units of their readings.

    Raises:
        UsageError: it cannot be read, a column is missing, or times do not ascend.
    """
    try:
        table = pyarrow.csv.read_csv(path)
    except (OSError, pa.ArrowException) as error:
        raise UsageError(f"{path}: expected a table of comma-separated values, {error}") from error
    columns = {name: _numbers(table, name, path) for name in table.column_names if _is_wanted(name, sensors)}
    missing = [name for name in (_TIME, *_PLACE) if name not in columns]
    if missing:
        raise UsageError(
            f"{path}: expected columns {', '.join((_TIME, *_PLACE))}, lacks {', '.join(missing)}. "
            f"It has {', '.join(table.column_names)}."
        )
    time_s, place_m = columns[_TIME], np.column_stack([columns[name] for name in _PLACE])
    is_placed = np.isfinite(time_s) & np.isfinite(place_m).all(axis=1)
    return FlightLog(
        time_s=time_s[is_placed],
        position_world_m=place_m[is_placed],
        quaternion_wxyz=_turns(columns, path)[is_placed],
        instruments={
            name: logged
            for name, unit in sensors.items()
            if (logged := _logged(columns, time_s, name, n_values_of(unit), path)) is not None
        },
    )


def _is_wanted(name: str, sensors: Mapping[str, str]) -> bool:
    is_pose = name in (_TIME, _YAW, *_PLACE, *_TURN)
    return is_pose or any(name.startswith(f"{sensor}_") for sensor in sensors)


def _numbers(table: pa.Table, name: str, path: Path) -> Floats:
    try:
        return table.column(name).cast(pa.float64()).to_numpy().astype(np.float64)
    except pa.ArrowException as error:
        raise UsageError(f"{path}: {name}: expected numbers, {error}") from error


def _turns(columns: Mapping[str, Floats], path: Path) -> Floats:
    n_rows = len(columns[_TIME])
    if all(name in columns for name in _TURN):
        turns = np.column_stack([columns[name] for name in _TURN])
        lengths = np.linalg.norm(turns, axis=1, keepdims=True)
        if not np.all(lengths[np.isfinite(lengths)] > 0):
            raise UsageError(f"{path}: quaternion_w …: expected attitudes, was 0, 0, 0, 0 somewhere.")
        return turns / lengths
    yaw_rad = columns.get(_YAW, np.zeros(n_rows))
    nothing = np.zeros(n_rows)
    return np.column_stack([np.cos(yaw_rad / 2), nothing, nothing, np.sin(yaw_rad / 2)])


def _logged(
    columns: Mapping[str, Floats], time_s: Floats, sensor: str, n_values: int, path: Path
) -> LoggedValues | None:
    own = [name for name in columns if name.startswith(f"{sensor}_")]
    if not own:
        return None
    if len(own) < n_values:
        raise UsageError(
            f"{path}: {sensor}: expected {n_values} columns that begin with {sensor}_, found {', '.join(own)}."
        )
    values = np.column_stack([columns[name] for name in own[:n_values]])
    is_there = np.isfinite(time_s) & np.isfinite(values).all(axis=1)
    return LoggedValues(time_s=time_s[is_there], values=values[is_there])
