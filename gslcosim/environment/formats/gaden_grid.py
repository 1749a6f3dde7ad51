"""GADEN's `OccupancyGrid3D.csv`: four lines of head, then the cells, layer by layer.

    #env_min(m) x y z
    #env_max(m) x y z
    #num_cells nx ny nz
    #cell_size(m) s
    one row of ny values for each x, nx rows, then a line `;`: that for each of the nz layers from below

0 is free, 1 an obstacle, 2 an outlet. The text files of wind components have the same rows, without a head.
Source: the readers and writers of MAPIRlab/gaden and MAPIRlab/gaden_core.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.formats.data_files import (
    NumberedLines,
    build_checked_grid,
    data_error,
    parse_numbers,
    read_lines,
)
from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Cell

OCCUPANCY_FILE = "OccupancyGrid3D.csv"
_HEAD = (("env_min", 3), ("env_max", 3), ("num_cells", 3), ("cell_size", 1))


def read_occupancy(path: Path) -> tuple[Grid, NDArray[np.uint8]]:
    """Return the grid and the (nx, ny, nz) cells of an `OccupancyGrid3D.csv`.

    Raises:
        EnvironmentDataError: the file is not of this kind, or its cells do not fit its head; names line and column.
    """
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
    """Return the (nx, ny, nz) values of a file's rows.

    Raises:
        EnvironmentDataError: layers, rows or values are too few or too many, or no numbers; names line and column.
    """
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
