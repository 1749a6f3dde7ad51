"""Data files of other programs: their errors, lines of numbers, and arrays over the cells of a grid.

GADEN's `OccupancyGrid3D.csv`: four lines of head, then the cells, layer by layer.

#env_min(m) x y z
    #env_max(m) x y z
    #num_cells nx ny nz
    #cell_size(m) s
    one row of ny values for each x, nx rows, then a line `;`: that for each of the nz layers from below

0 is free, 1 an obstacle, 2 an outlet. The text files of wind components have the same rows, without a head.
Source: the readers and writers of MAPIRlab/gaden and MAPIRlab/gaden_core.

Winds for all cells of a grid are GADEN's component files and results, uniform wind, and numpy arrays. Cells are
numbered x + nx (y + ny z) in all of them but those of our own shape. That holds for AutoGDM+'s and
GSL-Bench's `(t, cells, 3)` as well: AutoGDM+ makes them from GADEN's results without sorting cells, and GSL-Bench's
anemometer looks them up by that number (Herwich012/GSL-Bench, sensors/anemometer.py). Their occupancy, by contrast, is
indexed [z, x, y].
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.files import read_regular_file
from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Cell, Grid
from gslcosim.environment.store import data_error, load_npy

# Far above what fits into memory with its wind; what is larger is a fault of the file.
LARGEST_GRID_CELLS = 10**9
# Beyond this [m/s] a velocity is a fault of the file; it is three times the speed of sound.
LARGEST_SPEED_M_S = 1000.0

# What stands for no value: these, NaN, and all from 1e30 on: -1e300 in OpenFOAM's sets, 9.97e36 in netCDF, 1e30 to 1e38
# in VTK and Fluent.
_BLANKS = np.array((99.99, 999.0, 999.9, 999.99, 9999.0, 9999.9, 99999.0, 32767.0, 32768.0), dtype=np.float32)
_LEAST_BLANK = 1e30
BLANK_REMEDY = "Leave samples without a value out, in ParaView by Threshold: cells without a sample are still air."

# Each line with its number in the file, from 1.
NumberedLines = Sequence[tuple[int, str]]
OCCUPANCY_FILE = "OccupancyGrid3D.csv"
_HEAD = (("env_min", 3), ("env_max", 3), ("num_cells", 3), ("cell_size", 1))
# GADEN's preprocessing begins a binary component file with this number.
BINARY_MARK = 999
# GADEN's results begin with two of these, major and minor, from version 2.6 on.
RESULT_MAJORS = (2, 3)
# Frames times cells; what is larger (36 GB) is a fault of the file.
LARGEST_WIND_CELLS = 3 * 10**9


def read_content(path: Path) -> bytes:
    """Return a file's bytes."""
    try:
        return read_regular_file(path)
    except OSError as error:
        raise data_error(path, "a file that can be read", str(error.strerror)) from error


def read_lines(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a text that hold something, without blanks around them, with their numbers."""
    try:
        text = read_content(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise data_error(path, "a text", f"other bytes at {error.start}") from error
    return number_lines(text)


def number_lines(text: str) -> list[tuple[int, str]]:
    """Return the lines of a text that hold something, without blanks around them, with their numbers."""
    stripped = ((number, line.strip()) for number, line in enumerate(text.splitlines(), start=1))
    return [(number, line) for number, line in stripped if line]


def split_row(text: str) -> tuple[list[str], str | None]:
    """Return the words of a row of a table, without quotes, and what stands between them; blanks if absent."""
    delimiter = next((mark for mark in (";", ",") if mark in text), None)
    return [word.strip().strip('"').strip() for word in text.split(delimiter)], delimiter


def parse_numbers(
    path: Path,
    lines: NumberedLines,
    n_columns: int,
    *,
    delimiter: str | None = None,
    columns: Sequence[int] | None = None,
    blank_remedy: str = "",
) -> NDArray[np.float64]:
    """Return lines of numbers as (n, m), all finite.

    Args:
        path: Where they are from, for errors.
        lines: The lines; none is empty.
        n_columns: How many values each line holds.
        delimiter: What stands between values; blanks if absent.
        columns: Which of the values to take, all by default; the others need not be numbers.
        blank_remedy: What to do where a value is missing, for errors.
    """
    taken = tuple(range(n_columns)) if columns is None else tuple(columns)
    if not lines:
        return np.empty((0, len(taken)))
    try:
        if any(len(text.split(delimiter)) != n_columns for _, text in lines):
            raise ValueError("lines of different lengths")
        texts = (text for _, text in lines)
        values = np.loadtxt(texts, delimiter=delimiter, comments=None, ndmin=2, usecols=taken)
    except ValueError as error:
        raise _line_error(path, lines, n_columns, delimiter, taken, blank_remedy) or data_error(
            path, f"{n_columns} numbers in each line", str(error)
        ) from error
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0].tolist()
        place = f"line {lines[row][0]}, column {taken[column] + 1}"
        found = f"{values[row, column]}, which is no value"
        raise data_error(path, f"a finite number in {place}", found, remedy=blank_remedy)
    return values


# The place of the first value that is wrong; searched only when there is one.
def _line_error(
    path: Path,
    lines: NumberedLines,
    n_columns: int,
    delimiter: str | None,
    columns: Sequence[int],
    blank_remedy: str,
) -> EnvironmentDataError | None:
    for number, text in lines:
        words = text.split(delimiter)
        if len(words) != n_columns:
            return data_error(path, f"{n_columns} values in line {number}", f"{len(words)}")
        for column in columns:
            try:
                float(words[column])
            except ValueError:
                is_blank = not any(c.isdigit() for c in words[column])
                expected = f"a number in line {number}, column {column + 1}"
                return data_error(path, expected, repr(words[column][:40]), remedy=blank_remedy if is_blank else "")
    return None


def build_checked_grid(path: Path, *, min_m: Vec3, max_m: Vec3, cell_m: float, shape: tuple[int, int, int]) -> Grid:
    """Return the grid that a file's head describes.

    GADEN rounds the number of cells up and prints six digits, so the corners may miss each other by less than a cell.
    """
    is_sound = bool(np.isfinite([*min_m, *max_m, cell_m]).all()) and cell_m > 0 and min(shape) > 0
    n_cells = shape[0] * shape[1] * shape[2]
    if not is_sound or n_cells > LARGEST_GRID_CELLS or max(map(abs, (*min_m, *max_m))) > 1e9:
        found = f"{shape} cells of {cell_m} m from {min_m} to {max_m} m"
        raise data_error(path, f"a grid of finite, positive size and at most {LARGEST_GRID_CELLS:.0e} cells", found)
    sides_m = np.subtract(max_m, min_m)
    if not (abs(sides_m - np.multiply(shape, cell_m)) < cell_m).all():
        found = f"{shape} cells of {cell_m:g} m between {min_m} and {max_m} m"
        raise data_error(path, "cells that fill the space between the corners", found)
    return Grid(origin_m=min_m, cell_m=cell_m, shape=shape)


def check_velocities(
    path: Path, velocity_m_s: NDArray[Any], place: Callable[[int], str] = lambda index: f"number {index + 1}"
) -> None:
    """Refuse velocities that are not finite, that stand for no value, or faster than anything that blows.

    Args:
        path: Where they are from, for errors.
        velocity_m_s: (t, …) [m/s].
        place: Where in the file a number of a frame stands, by its index in C order.
    """
    for i, frame in enumerate(velocity_m_s):
        with np.errstate(all="ignore"):
            highest = np.abs(frame).max(initial=0.0)
            # NaN compares false.
            if highest < _BLANKS[0]:
                continue
            speeds = np.abs(frame)
            is_wrong = ~(speeds <= LARGEST_SPEED_M_S) | np.isin(speeds.astype(np.float32), _BLANKS)
        if is_wrong.any():
            index = int(np.argmax(is_wrong))
            value, speed = float(frame.flat[index]), float(speeds.flat[index])
            is_blank = not speed < _LEAST_BLANK or np.float32(speed) in _BLANKS
            where = place(index) if len(velocity_m_s) == 1 else f"{place(index)} of frame {i}"
            found = f"{int(is_wrong.sum())} that are not, the first {value:g} in {where}"
            expected = f"finite velocities up to {LARGEST_SPEED_M_S:g} m/s"
            raise data_error(
                path,
                expected,
                f"{found}, which is no value" if is_blank else found,
                remedy=BLANK_REMEDY if is_blank else "Are they in another unit?",
            )


def read_occupancy(path: Path) -> tuple[Grid, NDArray[np.uint8]]:
    """Return the grid and the (nx, ny, nz) cells of an `OccupancyGrid3D.csv`."""
    lines = read_lines(path)
    min_m, max_m, cells, (cell_m, *_) = _head(path, lines)
    if any(not abs(n) < 1e10 or n != int(n) for n in cells):
        raise data_error(path, "whole numbers of cells in line 3", str(cells))
    shape = (int(cells[0]), int(cells[1]), int(cells[2]))
    grid = build_checked_grid(path, min_m=min_m, max_m=max_m, cell_m=cell_m, shape=shape)
    codes = parse_rows(path, lines[len(_HEAD) :], grid)
    is_unknown = ~np.isin(codes, [cell.value for cell in Cell])
    if is_unknown.any():
        x, y, z = np.argwhere(is_unknown)[0].tolist()
        place = f"line {_row_lines(lines[len(_HEAD) :])[z * shape[0] + x][0]}, column {y + 1}"
        raise data_error(path, f"0 free, 1 obstacle or 2 outlet in {place}", f"{codes[x, y, z]:g}")
    return grid, codes.astype(np.uint8)


def parse_rows(path: Path, lines: NumberedLines, grid: Grid) -> NDArray[np.float64]:
    """Return the (nx, ny, nz) values of a file's rows."""
    nx, ny, nz = grid.shape
    _check_layers(path, lines, nx, nz)
    values = parse_numbers(path, _row_lines(lines), ny)
    return np.moveaxis(values.reshape(nz, nx, ny), 0, 2)


def format_rows(values: NDArray[np.generic], form: str) -> str:
    """Return (nx, ny, nz) values as rows of text; each number is written in the given printf form."""
    nx, ny, nz = values.shape
    row = " ".join([form] * ny) + " \n"
    return "".join((row * nx + ";\n") % tuple(values[:, :, k].ravel().tolist()) for k in range(nz))


def format_occupancy(grid: Grid, occupancy: NDArray[np.uint8]) -> str:
    """Return the content of an `OccupancyGrid3D.csv`."""
    corners = ("#env_min(m)", grid.origin_m), ("#env_max(m)", grid.max_m), ("#num_cells", grid.shape)
    head = "".join(f"{name} {' '.join(f'{x:.12g}' for x in point)}\n" for name, point in corners)
    return f"{head}#cell_size(m) {grid.cell_m:.12g}\n{format_rows(occupancy, '%d')}"


def _head(path: Path, lines: NumberedLines) -> tuple[Vec3, Vec3, Vec3, tuple[float, ...]]:
    if len(lines) < len(_HEAD):
        names = ", ".join(f"#{name}" for name, _ in _HEAD)
        raise data_error(path, f"{len(_HEAD)} lines of head: {names}", f"{len(lines)} lines")
    (min_m, max_m, cells, size) = (
        _numbers_after(path, line, name, n) for line, (name, n) in zip(lines, _HEAD, strict=False)
    )
    return _triple(min_m), _triple(max_m), _triple(cells), size


def _triple(values: tuple[float, ...]) -> Vec3:
    x, y, z = values
    return (x, y, z)


def _numbers_after(path: Path, line: tuple[int, str], name: str, n: int) -> tuple[float, ...]:
    number, text = line
    word, *words = text.split()
    if not word.startswith(f"#{name}") or len(words) != n:
        raise data_error(path, f"#{name} and {n} numbers in line {number}, one of 4 lines of head", repr(text[:80]))
    return tuple(parse_numbers(path, [(number, " ".join(words))], n)[0].tolist())


def _row_lines(lines: NumberedLines) -> list[tuple[int, str]]:
    return [line for line in lines if line[1] != ";"]


# Rows are counted before their numbers are read, so that what a head promises costs no memory.
def _check_layers(path: Path, lines: NumberedLines, nx: int, nz: int) -> None:
    n_rows, n_layers = 0, 0
    for number, text in lines:
        if text != ";":
            n_rows += 1
        if (text == ";" and n_rows != nx) or n_rows > nx or n_layers == nz:
            expected = f"{nz} layers of {nx} rows, each layer ended by ;"
            raise data_error(path, expected, f"row {n_rows} of layer {n_layers + 1} at line {number}: {text[:20]!r}")
        if text == ";":
            n_layers, n_rows = n_layers + 1, 0
    n_layers += n_rows == nx
    if n_layers != nz or n_rows not in (0, nx):
        raise data_error(path, f"{nz} layers of {nx} rows", f"{n_layers} layers and {n_rows % nx} rows")


def read_components(paths: tuple[Path, Path, Path], grid: Grid) -> NDArray[np.float32]:
    """Return the (nx, ny, nz, 3) wind of a set `…csv_U`, `…csv_V`, `…csv_W`, text or binary, world frame [m/s]."""
    return np.stack([_read_component(path, grid) for path in paths], axis=-1)


def read_result(path: Path, grid: Grid) -> NDArray[np.float32]:
    """Return the (nx, ny, nz, 3) wind of one `wind_iteration_i` or `.csv_gaden` of GADEN, world frame [m/s]."""
    content = read_content(path)
    n = count_cells(grid)
    if len(content) == 24 * n:
        return _as_cells(path, np.frombuffer(content, "<f8").reshape(3, n).T, grid)
    if len(content) != 8 + 12 * n:
        expected = f"{24 * n} bytes (until version 2.5) or {8 + 12 * n} (from 2.6 on) for {n} cells"
        raise data_error(path, expected, f"{len(content)}")
    major = int(np.frombuffer(content, "<i4", count=1)[0])
    if major not in RESULT_MAJORS:
        raise data_error(path, f"version 2 or version 3 in front of {12 * n} bytes", f"{major}")
    return _as_cells(path, np.frombuffer(content, "<f4", offset=8).reshape(n, 3), grid)


def read_array(path: Path, grid: Grid) -> NDArray[np.float32]:
    """Return the (t, nx, ny, nz, 3) wind of a `.npy` file of (t, cells, 3), (cells, 3), or our own shape [m/s]."""
    frames = _stored_frames(path, grid)
    check_amount(path, len(frames), grid)
    if frames.ndim == 3:
        return np.stack([_as_cells(path, frame, grid) for frame in frames])
    check_velocities(path, frames, _cell_place(grid.shape))
    return np.array(frames, np.float32)


def read_array_frame(path: Path, grid: Grid, number: int) -> NDArray[np.float32]:
    """Return (nx, ny, nz, 3), one frame of what `read_array` returns; after the last comes the first [m/s]."""
    frames = _stored_frames(path, grid)
    frame = frames[number % len(frames)]
    if frame.ndim == 2:
        return _as_cells(path, frame, grid)
    check_velocities(path, frame[np.newaxis], _cell_place(grid.shape))
    return np.array(frame, np.float32)


# (t, cells, 3) or (t, nx, ny, nz, 3) as they lie in the file, mapped into memory.
def _stored_frames(path: Path, grid: Grid) -> NDArray[Any]:
    array = load_npy(path)
    n = count_cells(grid)
    frames = array[np.newaxis] if array.ndim in (2, 4) else array
    is_flat = frames.ndim == 3 and frames.shape[1:] == (n, 3)
    if array.dtype.kind != "f" or not (is_flat or frames.shape[1:] == (*grid.shape, 3)) or not len(frames):
        expected = f"real numbers of (t, {n}, 3) or (t, {', '.join(map(str, grid.shape))}, 3)"
        raise data_error(path, expected, f"{array.dtype} {array.shape}")
    return frames


def cells_in_order(values: NDArray[Any]) -> NDArray[Any]:
    """Return (nx, ny, nz, …) values as (cells, …), cell x + nx (y + ny z) at that place."""
    return np.swapaxes(values, 0, 2).reshape(-1, *values.shape[3:])


def count_cells(grid: Grid) -> int:
    """Return how many cells a grid has."""
    return grid.shape[0] * grid.shape[1] * grid.shape[2]


def _read_component(path: Path, grid: Grid) -> NDArray[np.float32]:
    content = read_content(path)
    if content[:4] != np.int32(BINARY_MARK).tobytes():
        values = parse_rows(path, read_lines(path), grid)
        check_velocities(path, values[np.newaxis], _cell_place(grid.shape, 1))
        return values.astype(np.float32)
    n = count_cells(grid)
    if len(content) != 4 + 8 * n:
        raise data_error(path, f"{4 + 8 * n} bytes for {n} cells", f"{len(content)}")
    return _as_cells(path, np.frombuffer(content, "<f8", offset=4), grid)


# Of numbers in C order over cells; those of other programs run over x first.
def _cell_place(shape: tuple[int, int, int], n_components: int = 3, *, step: int = 1) -> Callable[[int], str]:
    return lambda index: f"cell {[int(i) for i in np.unravel_index(index // n_components, shape)][::step]}"


# Checked before it is narrowed: what would overflow is refused.
def _as_cells(path: Path, values: NDArray[Any], grid: Grid) -> NDArray[np.float32]:
    nx, ny, nz = grid.shape
    check_velocities(path, values[np.newaxis], _cell_place((nz, ny, nx), values.size // (nx * ny * nz), step=-1))
    cells = values.reshape(nz, ny, nx, *values.shape[1:])
    return np.ascontiguousarray(np.swapaxes(cells, 0, 2), np.float32)


def check_amount(path: Path, n_frames: int, grid: Grid) -> None:
    """Refuse more frames than any memory holds."""
    n = n_frames * count_cells(grid)
    if n > LARGEST_WIND_CELLS:
        raise data_error(path, f"at most {LARGEST_WIND_CELLS:.0e} cells in all frames", f"{n}")
