"""Data files of other programs: their errors, lines of numbers, and numpy arrays."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.files import read_regular_file
from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid import Grid

# Far above what fits into memory with its wind; what is larger is a fault of the file.
LARGEST_GRID_CELLS = 10**9
# Beyond this [m/s] a velocity is a fault of the file; it is three times the speed of sound.
LARGEST_SPEED_M_S = 1000.0

# Each line with its number in the file, from 1.
NumberedLines = Sequence[tuple[int, str]]


def data_error(path: Path, expected: str, found: str, *, remedy: str = "") -> EnvironmentDataError:
    """Return the error of a file that is not as expected."""
    tail = f" {remedy}" if remedy else ""
    return EnvironmentDataError(f"{path.name}: expected {expected}, was {found}.{tail}\nFile: {path}")


def read_content(path: Path) -> bytes:
    """Return a file's bytes.

    Raises:
        EnvironmentDataError: it cannot be read.
    """
    try:
        return read_regular_file(path)
    except OSError as error:
        raise data_error(path, "a file that can be read", str(error.strerror)) from error


def read_lines(path: Path) -> list[tuple[int, str]]:
    """Return the lines of a text that hold something, without blanks around them, with their numbers.

    Raises:
        EnvironmentDataError: it cannot be read or is no text.
    """
    try:
        text = read_content(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise data_error(path, "a text", f"other bytes at {error.start}") from error
    stripped = ((number, line.strip()) for number, line in enumerate(text.splitlines(), start=1))
    return [(number, line) for number, line in stripped if line]


def parse_numbers(
    path: Path,
    lines: NumberedLines,
    n_columns: int,
    *,
    delimiter: str | None = None,
    columns: Sequence[int] | None = None,
) -> NDArray[np.float64]:
    """Return lines of numbers as (n, m), all finite.

    Args:
        path: Where they are from, for errors.
        lines: The lines; none is empty.
        n_columns: How many values each line holds.
        delimiter: What stands between values; blanks if absent.
        columns: Which of the values to take, all by default; the others need not be numbers.

    Raises:
        EnvironmentDataError: a line holds another number of values, or one that is no finite number; names line and
            column.
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
        raise _line_error(path, lines, n_columns, delimiter, taken) or data_error(
            path, f"{n_columns} numbers in each line", str(error)
        ) from error
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0].tolist()
        place = f"line {lines[row][0]}, column {taken[column] + 1}"
        raise data_error(path, f"a finite number in {place}", str(values[row, column]))
    return values


# The place of the first value that is wrong; searched only when there is one.
def _line_error(
    path: Path, lines: NumberedLines, n_columns: int, delimiter: str | None, columns: Sequence[int]
) -> EnvironmentDataError | None:
    for number, text in lines:
        words = text.split(delimiter)
        if len(words) != n_columns:
            return data_error(path, f"{n_columns} values in line {number}", f"{len(words)}")
        for column in columns:
            try:
                float(words[column])
            except ValueError:
                return data_error(path, f"a number in line {number}, column {column + 1}", repr(words[column][:40]))
    return None


def load_npy(path: Path) -> NDArray[Any]:
    """Return the array of a `.npy` file, memory-mapped: no memory is asked for what the file does not hold.

    Raises:
        EnvironmentDataError: the file is missing, truncated, or of another kind.
    """
    if not path.is_file():
        raise data_error(path, "an array", "missing")
    try:
        with warnings.catch_warnings(action="ignore"):
            mapped = np.load(path, mmap_mode="r", allow_pickle=False)
    # The head is Python text, and a faulty one raises whatever the tokenizer, the parser or numpy's types do.
    except Exception as error:
        n_bytes = path.stat().st_size
        raise data_error(path, "a whole numpy array", f"{n_bytes} bytes that are not ({error})") from error
    if not isinstance(mapped, np.ndarray):
        raise data_error(path, "one numpy array", "an archive of them")
    # Bytes doubled in the middle shift all that follow, and leave some over.
    n_left = path.stat().st_size - getattr(mapped, "offset", 0) - mapped.nbytes
    if n_left:
        raise data_error(path, "a numpy array and nothing else", f"{n_left} bytes more")
    # A plain view: compiled kernels know arrays, and would take a memmap object's slow path.
    return np.asarray(mapped)


def build_checked_grid(path: Path, *, min_m: Vec3, max_m: Vec3, cell_m: float, shape: tuple[int, int, int]) -> Grid:
    """Return the grid that a file's head describes.

    GADEN rounds the number of cells up and prints six digits, so the corners may miss each other by less than a cell.

    Raises:
        EnvironmentDataError: sizes are not finite or not positive, too many, or the corners do not fit the cells.
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


def check_velocities(path: Path, velocity_m_s: NDArray[Any]) -> None:
    """Refuse velocities that are not finite or faster than anything that blows.

    Raises:
        EnvironmentDataError: there is one.
    """
    for frame in velocity_m_s:
        with np.errstate(all="ignore"):
            highest = np.abs(frame).max(initial=0.0)
        # NaN compares false.
        if not highest <= LARGEST_SPEED_M_S:
            n_wrong = int((~(np.abs(frame) <= LARGEST_SPEED_M_S)).sum())
            raise data_error(path, f"finite velocities up to {LARGEST_SPEED_M_S:g} m/s", f"{n_wrong} that are not")
