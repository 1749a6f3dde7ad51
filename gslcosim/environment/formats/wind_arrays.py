"""Wind arrays for all cells of a grid: GADEN's component files and results, uniform wind, and numpy arrays.

Cells are numbered x + nx (y + ny z) in all of them but those of our own shape. That holds for AutoGDM+'s and
GSL-Bench's `(t, cells, 3)` as well: AutoGDM+ makes them from GADEN's results without sorting cells, and GSL-Bench's
anemometer looks them up by that number (Herwich012/GSL-Bench, sensors/anemometer.py). Their occupancy, by contrast, is
indexed [z, x, y].
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.formats.data_files import (
    check_velocities,
    data_error,
    load_npy,
    parse_numbers,
    read_content,
    read_lines,
)
from gslcosim.environment.formats.gaden_grid import parse_rows
from gslcosim.environment.grid import Grid

# GADEN's preprocessing begins a binary component file with this number.
BINARY_MARK = 999
# GADEN's results of version 3 begin with two of these, major and minor.
_RESULT_MAJOR = 3
# Frames times cells; what is larger (36 GB) is a fault of the file.
LARGEST_WIND_CELLS = 3 * 10**9


def read_components(paths: tuple[Path, Path, Path], grid: Grid) -> NDArray[np.float32]:
    """Return the (nx, ny, nz, 3) wind of a set `…csv_U`, `…csv_V`, `…csv_W`, text or binary, world frame [m/s].

    Raises:
        EnvironmentDataError: one is missing, truncated, or does not fit the grid.
    """
    return np.stack([_read_component(path, grid) for path in paths], axis=-1)


def read_result(path: Path, grid: Grid) -> NDArray[np.float32]:
    """Return the (nx, ny, nz, 3) wind of one `wind_iteration_i` of GADEN's results, world frame [m/s].

    Raises:
        EnvironmentDataError: the file is missing or does not fit the grid.
    """
    content = read_content(path)
    n = count_cells(grid)
    if len(content) == 24 * n:
        return _as_cells(path, np.frombuffer(content, "<f8").reshape(3, n).T, grid)
    if len(content) != 8 + 12 * n:
        expected = f"{24 * n} bytes (versions 1 and 2) or {8 + 12 * n} (3) for {n} cells"
        raise data_error(path, expected, f"{len(content)}")
    major = int(np.frombuffer(content, "<i4", count=1)[0])
    if major != _RESULT_MAJOR:
        raise data_error(path, f"version {_RESULT_MAJOR} in front of {12 * n} bytes", f"{major}")
    return _as_cells(path, np.frombuffer(content, "<f4", offset=8).reshape(n, 3), grid)


def read_uniform(path: Path, grid: Grid, is_air: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the (t, nx, ny, nz, 3) wind of lines `u,v,w`, one a frame: the same in all air [m/s].

    Raises:
        EnvironmentDataError: a line is not three finite numbers.
    """
    lines = read_lines(path)
    delimiter = "," if lines and "," in lines[0][1] else None
    winds = parse_numbers(path, lines, 3, delimiter=delimiter)
    if not len(winds):
        raise data_error(path, "lines u,v,w", "an empty file")
    check_velocities(path, winds[np.newaxis])
    _check_amount(path, len(winds), grid)
    return is_air[np.newaxis, ..., np.newaxis] * winds[:, None, None, None].astype(np.float32)


def read_array(path: Path, grid: Grid) -> NDArray[np.float32]:
    """Return the (t, nx, ny, nz, 3) wind of a `.npy` file of (t, cells, 3), (cells, 3), or our own shape [m/s].

    Raises:
        EnvironmentDataError: the file is truncated, holds no real numbers, or does not fit the grid.
    """
    frames = _stored_frames(path, grid)
    _check_amount(path, len(frames), grid)
    if frames.ndim == 3:
        return np.stack([_as_cells(path, frame, grid) for frame in frames])
    check_velocities(path, frames)
    return np.array(frames, np.float32)


def read_array_frame(path: Path, grid: Grid, number: int) -> NDArray[np.float32]:
    """Return (nx, ny, nz, 3), one frame of what `read_array` returns; after the last comes the first [m/s].

    Raises:
        EnvironmentDataError: see `read_array`; of the other frames nothing is read.
    """
    frames = _stored_frames(path, grid)
    frame = frames[number % len(frames)]
    if frame.ndim == 2:
        return _as_cells(path, frame, grid)
    check_velocities(path, frame[np.newaxis])
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
        check_velocities(path, values[np.newaxis])
        return values.astype(np.float32)
    n = count_cells(grid)
    if len(content) != 4 + 8 * n:
        raise data_error(path, f"{4 + 8 * n} bytes for {n} cells", f"{len(content)}")
    return _as_cells(path, np.frombuffer(content, "<f8", offset=4), grid)


# Checked before it is narrowed: what would overflow is refused.
def _as_cells(path: Path, values: NDArray[Any], grid: Grid) -> NDArray[np.float32]:
    check_velocities(path, values[np.newaxis])
    nx, ny, nz = grid.shape
    cells = values.reshape(nz, ny, nx, *values.shape[1:])
    return np.ascontiguousarray(np.swapaxes(cells, 0, 2), np.float32)


def _check_amount(path: Path, n_frames: int, grid: Grid) -> None:
    n = n_frames * count_cells(grid)
    if n > LARGEST_WIND_CELLS:
        raise data_error(path, f"at most {LARGEST_WIND_CELLS:.0e} cells in all frames", f"{n}")
