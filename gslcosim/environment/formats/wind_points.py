"""Wind at points: csv of ParaView and OpenFOAM, bare columns, and fields of an OpenFOAM time folder.

Columns are found by their names, in any order and among others: the place as `Points:0`, `Points_0`, `x`, `C_x`,
`CellCenters_0` and the like, the velocity as `U:0`, `U_0`, `U_x`, `Ux`, `UMean_0`, `velocity_0`, `u` and the like.
Each point goes to the cell that holds it; the points of a cell are averaged.

`postProcess -func writeCellCentres` writes `C`. Only the inner cells are read, not the boundary.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.formats.data_files import (
    NumberedLines,
    check_velocities,
    data_error,
    parse_numbers,
    read_content,
    read_lines,
)
from gslcosim.environment.grid import Grid, point_text

_AXES = {"0": 0, "1": 1, "2": 2, "x": 0, "y": 1, "z": 2}
_NAME = re.compile(r"(?P<name>[a-z ]*?)[ _:\[(]*(?P<axis>[xyz012])[\])]?(?P<unit>[ _]\(?m\)?|_m_s)?")
# The first that is there in all three axes is taken.
_PLACES = ("points", "point", "cellcenters", "cell centers", "c", "cc", "coords", "coordinates", "")
_VELOCITIES = ("u", "velocity", "wind", "vel", "umean", "u mean")
# How far outside the grid a point may lie by rounding, in cells.
_ROUNDING_CELLS = 1e-4
# What is farther away is a fault of the file.
_FARTHEST_M = 1e9


@dataclass(frozen=True, kw_only=True)
class PointWind:
    """Samples brought to cells: `velocity_m_s` (nx, ny, nz, 3), `is_sampled` (nx, ny, nz), points outside the grid."""

    velocity_m_s: NDArray[np.float32]
    is_sampled: NDArray[np.bool_]
    n_outside: int


def read_points(path: Path, grid: Grid) -> PointWind:
    """Return the wind that a file of points gives to the cells of a grid; cells without a point are still air.

    Raises:
        EnvironmentDataError: columns are missing, a value is no finite number, or no point lies in the grid.
    """
    lines = read_lines(path)
    columns, rows, delimiter, n_columns = _table(path, lines)
    values = parse_numbers(path, rows, n_columns, delimiter=delimiter, columns=columns)
    if not len(values):
        raise data_error(path, "points below the header", "none")
    check_velocities(path, values[np.newaxis, :, 3:])
    return average_points(path, values[:, :3], values[:, 3:], grid)


def is_table_of_points(lines: NumberedLines) -> bool:
    """Return whether a text looks like points with velocities: a header with letters, or six columns."""
    if not lines:
        return False
    first = lines[0][1]
    return first.startswith("#") or any(c.isalpha() and c not in "eE" for c in first) or len(_split(first)[0]) == 6


def average_points(
    path: Path, points_m: NDArray[np.float64], velocity_m_s: NDArray[np.float64], grid: Grid
) -> PointWind:
    """Return the mean velocity of the points in each cell.

    Args:
        path: Where they are from, for errors.
        points_m: (n, 3) places, world frame [m].
        velocity_m_s: (n, 3) wind there, world frame [m/s].
        grid: The cells.

    Raises:
        EnvironmentDataError: no point lies in the grid, or one is farther away than any room.
    """
    if not (np.abs(points_m) <= _FARTHEST_M).all():
        raise data_error(path, f"places up to {_FARTHEST_M:g} m away", f"{np.abs(points_m).max():g} m")
    # Rounded, so that a point on the border of two cells goes to the upper one whatever the last digit says.
    place = np.round((points_m - grid.origin_m) / grid.cell_m, 6)
    is_inside = ((place >= -_ROUNDING_CELLS) & (place <= np.add(grid.shape, _ROUNDING_CELLS))).all(axis=1)
    if not is_inside.any():
        low, high = point_text(points_m.min(axis=0)), point_text(points_m.max(axis=0))
        raise data_error(
            path,
            f"points in the grid, from {point_text(grid.origin_m)} to {point_text(grid.max_m)} m",
            f"{len(points_m)} points from {low} to {high}",
            remedy="Are they in another unit or frame?",
        )
    cells = np.clip(np.floor(place[is_inside]).astype(np.int64), 0, np.subtract(grid.shape, 1))
    flat = np.ravel_multi_index(tuple(cells.T), grid.shape)
    n_cells = grid.shape[0] * grid.shape[1] * grid.shape[2]
    counts = np.bincount(flat, minlength=n_cells)
    sums = [np.bincount(flat, velocity_m_s[is_inside, axis], n_cells) for axis in range(3)]
    mean = np.stack(sums, axis=-1) / np.maximum(counts, 1)[:, None]
    return PointWind(
        velocity_m_s=mean.astype(np.float32).reshape(*grid.shape, 3),
        is_sampled=(counts > 0).reshape(grid.shape),
        n_outside=int((~is_inside).sum()),
    )


# The six columns x, y, z, u, v, w; the rows; what divides values; how many there are in a row.
def _table(path: Path, lines: NumberedLines) -> tuple[list[int], NumberedLines, str | None, int]:
    comments = [line for line in lines if line[1].startswith("#")]
    rows = [line for line in lines if not line[1].startswith("#")]
    if comments and rows:
        words, delimiter = _split(rows[0][1])
        names = _split(comments[-1][1].lstrip("# \t"))[0]
        if len(names) == len(words):
            return _columns(path, names), rows, delimiter, len(words)
        return _six(path, rows), rows, delimiter, 6
    if not rows:
        raise data_error(path, "a header and points", "an empty file")
    words, delimiter = _split(rows[0][1])
    if any(c.isalpha() and c not in "eE" for c in rows[0][1]):
        return _columns(path, words), rows[1:], delimiter, len(words)
    return _six(path, rows), rows, delimiter, 6


def _six(path: Path, rows: NumberedLines) -> list[int]:
    n = len(_split(rows[0][1])[0])
    if n != 6:
        raise data_error(
            path, "six columns x y z u v w, or a header that names more", f"{n} columns in line {rows[0][0]}"
        )
    return list(range(6))


def _split(text: str) -> tuple[list[str], str | None]:
    delimiter = next((mark for mark in (",", ";") if mark in text), None)
    return [word.strip().strip('"').strip() for word in text.split(delimiter)], delimiter


def _columns(path: Path, names: list[str]) -> list[int]:
    found: dict[str, dict[int, int]] = {}
    for column, name in enumerate(names):
        match = _NAME.fullmatch(name.lower())
        if match is not None:
            found.setdefault(match["name"].strip(), {}).setdefault(_AXES[match["axis"]], column)
    single = {axis: names.index(letter) for axis, letter in enumerate("uvw") if letter in names}
    places = next((found[name] for name in _PLACES if len(found.get(name, ())) == 3), None)
    winds = next((found[name] for name in _VELOCITIES if len(found.get(name, ())) == 3), None)
    winds = winds or (single if len(single) == 3 else None)
    if places is None or winds is None:
        missing = (
            "places such as Points:0, Points:1, Points:2" if places is None else "velocities such as U:0, U:1, U:2"
        )
        raise data_error(path, f"columns with {missing}", ", ".join(names)[:200])
    return [places[axis] for axis in range(3)] + [winds[axis] for axis in range(3)]


VELOCITY_FILE, CENTRES_FILE = "U", "C"
_FORMAT = re.compile(rb"\bformat\s+(\w+)\s*;")
_SCALAR_BITS = re.compile(rb"\barch\s+\"[^\"]*scalar=(\d+)")
_LIST = re.compile(rb"\binternalField\s+nonuniform\s+List<vector>\s+(\d+)\s*\(")
_UNIFORM = re.compile(rb"\binternalField\s+uniform\s+\(([^)]*)\)\s*;")
# The shortest vector is `(0 0 0)`.
_LEAST_VECTOR_BYTES = 7


def is_foam_text(content: bytes) -> bool:
    """Return whether bytes are the beginning of a file of OpenFOAM."""
    return b"FoamFile" in content[:4000]


def is_time_folder(folder: Path) -> bool:
    """Return whether a folder holds OpenFOAM's velocities with the centres of their cells."""
    return (folder / VELOCITY_FILE).is_file() and (folder / CENTRES_FILE).is_file()


def read_time_folder(folder: Path, grid: Grid) -> PointWind:
    """Return the wind of `U` at the places of `C` in an OpenFOAM time folder, brought to the cells of a grid.

    Raises:
        EnvironmentDataError: a file is missing, truncated, or of another kind, they hold different numbers of cells, or
            none lies in the grid.
    """
    centres_path, velocity_path = folder / CENTRES_FILE, folder / VELOCITY_FILE
    centres_m = _vectors(centres_path)
    velocity_m_s = _vectors(velocity_path)
    if len(velocity_m_s) == 1 and len(centres_m) != 1:
        velocity_m_s = np.broadcast_to(velocity_m_s, centres_m.shape)
    if len(velocity_m_s) != len(centres_m):
        raise data_error(velocity_path, f"{len(centres_m)} vectors, as in {CENTRES_FILE}", f"{len(velocity_m_s)}")
    check_velocities(velocity_path, velocity_m_s[np.newaxis])
    return average_points(velocity_path, centres_m, velocity_m_s, grid)


def _vectors(path: Path) -> NDArray[np.float64]:
    content = read_content(path)
    if not is_foam_text(content):
        raise data_error(path, "a field of OpenFOAM with its FoamFile head", "another file")
    uniform = _UNIFORM.search(content)
    if uniform is not None:
        return _numbers(path, uniform[1], 1)
    found = _LIST.search(content)
    if found is None:
        raise data_error(path, "internalField nonuniform List<vector> or uniform", "none of them")
    kind = _FORMAT.search(content)
    n = int(found[1][:20])
    is_binary = kind is not None and kind[1] == b"binary"
    return _binary(path, content, found.end(), n) if is_binary else _ascii(path, content, found.end(), n)


def _ascii(path: Path, content: bytes, start: int, n: int) -> NDArray[np.float64]:
    text = content[start : content.find(b";", start)].rstrip()
    if not text.endswith(b")") or n * _LEAST_VECTOR_BYTES > len(text):
        raise data_error(path, f"{n} vectors and a closing );", f"{len(content) - start} bytes")
    return _numbers(path, text.replace(b"(", b" ").replace(b")", b" "), n)


def _numbers(path: Path, text: bytes, n: int) -> NDArray[np.float64]:
    words = text.split()
    if len(words) != 3 * n:
        raise data_error(path, f"{n} vectors", f"{len(words)} numbers")
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise data_error(path, f"{n} vectors of numbers", str(error)) from error
    return _finite(path, values)


def _binary(path: Path, content: bytes, start: int, n: int) -> NDArray[np.float64]:
    bits = _SCALAR_BITS.search(content[:start])
    dtype = np.dtype("<f4" if bits is not None and bits[1] == b"32" else "<f8")
    end = start + 3 * n * dtype.itemsize
    if content[end : end + 1] != b")":
        raise data_error(path, f"{n} vectors of {dtype.itemsize} bytes a number and a closing )", "something else")
    return _finite(path, np.frombuffer(content, dtype, count=3 * n, offset=start).astype(np.float64))


def _finite(path: Path, values: NDArray[np.float64]) -> NDArray[np.float64]:
    if not np.isfinite(values).all() or not len(values):
        raise data_error(
            path, "finite vectors", f"{int((~np.isfinite(values)).sum())} numbers of {len(values)} that are not"
        )
    return values.reshape(-1, 3)
