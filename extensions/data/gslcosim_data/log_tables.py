"""Logs of robots as tables of comma-separated values."""

import csv
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim.base.files import read_regular_file
from gslcosim.base.frames import quaternion_from_yaw
from gslcosim_data.log_values import Floats, LoggedSensor, LoggedValues, Remarks, RobotLog, find_unit, is_spelling

_TIME = "time_s"
_PLACE = ("x_m", "y_m", "z_m")
_TURN = ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")
_YAW = "yaw_rad"

_BLANK = ("", "-", "--", "na", "n/a", "null", "none", "#n/a")
_DELIMITERS = ",;\t"
# The letter of a part of a vector among the words of a column's name, such as `x`, `vx` or `qw`; letters in order.
_AXIS = re.compile(r"[a-z]?([wxyzuv])")
_AXES = (("x", "y", "z"), ("u", "v", "w"), ("w", "x", "y", "z"))
# How far apart two places of one time may be [m]: clocks that count whole seconds have several.
_LEAST_STEP_M = 0.5


def read_csv_log(path: Path, sensors: Sequence[LoggedSensor]) -> RobotLog:
    """Read a log.

    Columns are `time_s`, `x_m`, `y_m`, `z_m`; `yaw_rad` or `quaternion_w` … `quaternion_z`, else it looks along x; and
    for each sensor those whose names begin with its name and an underscore and with no longer sensor's, as many as its
    readings have numbers. Units at the end of a column's name are converted, and tell columns apart. A row without a
    number in a sensor's columns has no reading of it.
    """
    table = _read_table(path)
    remarks = Remarks(list(table.remarks))
    time_s = table.numbers(*_pose_column(table, _TIME))
    table.check_times(time_s)
    place_m = np.column_stack([_limited(table, remarks, *_pose_column(table, name), limits="m") for name in _PLACE])
    is_placed = np.array(np.isfinite(place_m).all(axis=1))
    rows = np.flatnonzero(is_placed)
    steps_m = np.linalg.norm(np.diff(place_m[rows], axis=0), axis=1)
    is_wrong = (np.diff(time_s[rows]) == 0) & (steps_m > _LEAST_STEP_M)
    if is_wrong.any():
        i = int(np.argmax(is_wrong))
        raise table.error(
            int(rows[i + 1]),
            f"expected one place at {time_s[rows[i]]:g} s, found another, {steps_m[i]:.1f} m away. Import each robot "
            "of several as a file of its own.",
        )
    instruments: dict[str, LoggedValues] = {}
    for sensor in sensors:
        columns = _columns_of(sensor, table, sensors)
        values = np.column_stack(
            [
                _limited(table, remarks, column, factor, limits=limits)
                for (column, factor), limits in zip(columns, sensor.limits, strict=False)
            ]
            or [np.full(len(time_s), np.nan)]
        )
        is_there = np.isfinite(values).all(axis=1)
        if is_there.any():
            instruments[sensor.name] = LoggedValues(time_s=time_s[is_there], values=values[is_there])
            if len(columns) == 1 and not is_spelling(name := table.names[columns[0][0]][len(sensor.name) + 1 :]):
                remarks.texts.append(f"{sensor.name}: read from {sensor.name}_{name}, in {sensor.units}.")
        elif columns:
            names = ", ".join(table.names[column] for column, _ in columns)
            remarks.texts.append(f"{sensor.name}: expected numbers in {names}, found none; it has no readings.")
        elif not sensor.is_estimate:
            remarks.texts.append(
                f"{sensor.name}: expected a column that begins with {sensor.name}_, found none among "
                f"{', '.join(table.names)}; it has no readings."
            )
    return RobotLog(
        time_s=time_s[is_placed],
        position_world_m=place_m[is_placed],
        quaternion_wxyz=_turns(table)[is_placed],
        instruments=instruments,
        remarks=tuple(remarks.texts),
    )


@dataclass(frozen=True, kw_only=True)
class _Table:
    """Cells of a table, and the line of each row; names of columns are as written, without spaces around them."""

    path: Path
    names: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]
    has_decimal_commas: bool
    remarks: tuple[str, ...]

    def place(self, row: int) -> str:
        return f"in line {self.lines[row]}"

    def error(self, row: int, text: str) -> UsageError:
        return UsageError(f"{self.path}: line {self.lines[row]}: {text}")

    def numbers(self, column: int, factor: float = 1.0) -> Floats:
        """Return the (n,) numbers of a column, NaN where it has none."""
        cells = [row[column] for row in self.rows]
        if self.has_decimal_commas:
            cells = [cell.replace(",", ".") for cell in cells]
        try:
            return np.array([np.nan if cell.lower() in _BLANK else float(cell) for cell in cells]) * factor
        except ValueError:
            row = next(i for i, cell in enumerate(cells) if not _is_number(cell))
        raise self.error(row, f"{self.names[column]}: expected a number, was '{self.rows[row][column]}'.")

    def check_times(self, time_s: Floats) -> None:
        if np.isnan(time_s).any():
            raise self.error(int(np.argmax(np.isnan(time_s))), "expected a time, found none. Delete the line.")
        falls = np.diff(time_s) < 0
        if falls.any():
            i = int(np.argmax(falls))
            raise self.error(
                i + 1,
                f"expected times that ascend, {time_s[i + 1]:g} s follows {time_s[i]:g} s. Import each part of a log "
                "that was restarted, and each robot of several, as a file of its own.",
            )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell.lower() in _BLANK
    return True


def _read_table(path: Path) -> _Table:
    try:
        content = read_regular_file(path)
    except OSError as error:
        raise UsageError(f"{path}: expected a log that can be read, {error.strerror}.") from error
    text = _decoded(content)
    numbered = _rows(text, path)
    line, header = next(numbered, (1, []))
    names = tuple(name.strip() for name in header)
    for name in names:
        if name and names.count(name) > 1:
            raise UsageError(
                f"{path}: line {line}: {name}: expected one column of that name, found {names.count(name)}."
            )
    rows: list[list[str]] = []
    lines: list[int] = []
    remarks: list[str] = []
    for line, cells in numbered:
        row = [cell.strip() for cell in cells]
        if set(row) & set(filter(None, names)) and not any(map(_is_number, filter(None, row))):
            raise UsageError(
                f"{path}: line {line}: expected numbers, found the names of the columns again: the log was restarted "
                "there. Import each of its parts as a file of its own."
            )
        if len(row) > len(names) and not any(row[len(names) :]):
            row = row[: len(names)]
        rows.append(row)
        lines.append(line)
    for i, row in enumerate(rows):
        if len(row) != len(names):
            is_cut = i == len(rows) - 1 and len(row) < len(names)
            reason = "the log was cut off there. Delete the line." if is_cut else "they stand in its first line."
            raise UsageError(f"{path}: line {lines[i]}: expected {len(names)} values, found {len(row)}; {reason}")
    if rows and not text.endswith(("\n", "\r")):
        remarks.append(f"line {lines[-1]}: the last line has no end; if the log was cut off there, delete the line.")
    return _Table(
        path=path,
        names=names,
        rows=rows,
        lines=lines,
        has_decimal_commas=_has_decimal_commas(rows, lines, path),
        remarks=tuple(remarks),
    )


# Spreadsheets write UTF-8 with a mark, UTF-16 or the system's Latin alphabet.
def _decoded(content: bytes) -> str:
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


# Lines without cells and comments are none.
def _rows(text: str, path: Path) -> Iterator[tuple[int, list[str]]]:
    first = next((line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")), "")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=max(_DELIMITERS, key=first.count))
    try:
        for row in reader:
            if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#"):
                if "\0" in "".join(row):
                    raise csv.Error("line contains NUL")
                yield reader.line_num, row
    except csv.Error as error:
        raise UsageError(
            f"{path}: line {reader.line_num}: expected comma-separated values, {error}. Delete what is no text."
        ) from error


def _has_decimal_commas(rows: list[list[str]], lines: list[int], path: Path) -> bool:
    def first_with(mark: str) -> int | None:
        is_decimal = (any(mark in cell and _is_number(cell.replace(",", ".")) for cell in row) for row in rows)
        return next((line for line, found in zip(lines, is_decimal, strict=True) if found), None)

    comma = first_with(",")
    if comma is not None and (point := first_with(".")) is not None:
        raise UsageError(
            f"{path}: expected decimal points or decimal commas, found commas in line {comma}, points in line {point}."
        )
    return comma is not None


# The column of a part of the pose, also in another unit of the same kind.
def _pose_column(table: _Table, wanted: str) -> tuple[int, float]:
    found = _find_pose_column(table, wanted)
    if found is None:
        lacking = [name for name in (_TIME, *_PLACE) if _find_pose_column(table, name) is None]
        raise UsageError(
            f"{table.path}: expected columns {', '.join((_TIME, *_PLACE))}, lacks {', '.join(lacking)}. "
            f"It has {', '.join(table.names) or 'none'}."
        )
    return found


def _find_pose_column(table: _Table, wanted: str) -> tuple[int, float] | None:
    name, _, words = wanted.partition("_")
    unit = find_unit(words)
    fitting = [
        (column, other[1])
        for column, text in enumerate(map(str.lower, table.names))
        if unit and text.startswith(f"{name}_") and (other := find_unit(text[len(name) + 1 :])) and other[0] == unit[0]
        and text.count("_") == 1
    ]  # fmt: skip
    if len(fitting) > 1:
        names = ", ".join(table.names[column] for column, _ in fitting)
        raise UsageError(f"{table.path}: expected one column {wanted}, found {names}. Rename the others.")
    return fitting[0] if fitting else None


def _limited(table: _Table, remarks: Remarks, column: int, factor: float, *, limits: str) -> Floats:
    return remarks.without_fills(table.names[column], limits, table.numbers(column, factor), table.place)


# An attitude stands until the next.
def _turns(table: _Table) -> Floats:
    n_rows = len(table.rows)
    names = [name.lower() for name in table.names]
    given = [name for name in _TURN if name in names]
    if given and len(given) < len(_TURN):
        lacking = ", ".join(name for name in _TURN if name not in names)
        raise UsageError(f"{table.path}: expected columns {', '.join(_TURN)}, lacks {lacking}.")
    if given:
        turns = np.column_stack([table.numbers(names.index(name)) for name in _TURN])
    else:
        yaw = _find_pose_column(table, _YAW)
        turns = quaternion_from_yaw(np.zeros(n_rows) if yaw is None else table.numbers(*yaw))
    is_known = np.isfinite(turns).all(axis=1)
    if not is_known.any():
        return quaternion_from_yaw(np.zeros(n_rows))
    last = np.maximum.accumulate(np.where(is_known, np.arange(n_rows), np.argmax(is_known)))
    turns = turns[last]
    lengths = np.linalg.norm(turns, axis=1, keepdims=True)
    if not np.all(lengths > 0):
        raise table.error(int(np.argmin(lengths)), "quaternion_w …: expected attitudes, was 0, 0, 0, 0 somewhere.")
    return turns / lengths


def _columns_of(sensor: LoggedSensor, table: _Table, sensors: Sequence[LoggedSensor]) -> list[tuple[int, float]]:
    # Names of sensors that differ in case only are distinguished by it.
    is_exact = len({one.name.lower() for one in sensors}) < len(sensors)
    fold: Callable[[str], str] = str if is_exact else str.lower
    own: dict[int, str] = {}
    for column, name in enumerate(map(fold, table.names)):
        owners = [one for one in sensors if f"{name}_".startswith(f"{fold(one.name)}_")]
        if owners and max(owners, key=lambda one: len(one.name)) is sensor:
            own[column] = name[len(sensor.name) + 1 :]
    return _in_order(sensor, own, table) if own else []


def _in_order(sensor: LoggedSensor, own: Mapping[int, str], table: _Table) -> list[tuple[int, float]]:
    n_parts, found = len(sensor.parts), ", ".join(table.names[column] for column in own)
    # A letter alone is the part of a vector: v is no volt there.
    units = {column: None if n_parts > 1 and len(rest) == 1 else find_unit(rest) for column, rest in own.items()}
    fitting = [column for column, unit in units.items() if unit and unit[0] in sensor.parts]
    unknown = [column for column, unit in units.items() if unit is None]
    if n_parts == 1:
        exact = [column for column in fitting if is_spelling(own[column])]
        chosen = exact if len(exact) == 1 else fitting or unknown
    else:
        chosen = sorted([*fitting, *unknown])
    if len(chosen) < n_parts and len(own) >= n_parts:
        raise UsageError(
            f"{table.path}: {sensor.name}: expected {sensor.units}, found {found}. Convert the values and rename the "
            "columns, or remove them."
        )
    if len(chosen) != n_parts:
        wanted = "1 column that begins" if n_parts == 1 else f"{n_parts} columns that begin"
        raise UsageError(f"{table.path}: {sensor.name}: expected {wanted} with {sensor.name}_, found {found}.")
    ordered: list[int] = []
    for part, group in groupby(sensor.parts):
        left = [column for column in chosen if column not in ordered]
        in_unit = [column for column in left if (unit := units[column]) and unit[0] == part]
        without = [column for column in left if units[column] is None]
        n_wanted = len(list(group))
        ordered += _by_axis(sorted((in_unit + without)[:n_wanted]), own)
    if len(ordered) < n_parts:
        raise UsageError(f"{table.path}: {sensor.name}: expected numbers in {', '.join(sensor.parts)}, found {found}.")
    return [(column, unit[1] if (unit := units[column]) else 1.0) for column in ordered]


def _by_axis(columns: list[int], own: Mapping[int, str]) -> list[int]:
    axes = {
        column: next((found[1] for word in own[column].lower().split("_") if (found := _AXIS.fullmatch(word))), "")
        for column in columns
    }
    order = next((axes_ for axes_ in _AXES if sorted(axes_) == sorted(axes.values())), None)
    return columns if order is None else sorted(columns, key=lambda column: order.index(axes[column]))
