"""Wind files of other programs, recognised by content, as frames on a grid.

Wind at points comes from csv of ParaView and OpenFOAM, from bare columns, or from fields of an OpenFOAM time folder.
Columns are found by their names, in any order and among others: the place as `Points:0`, `Points_0`, `x`, `C_x`,
`CellCenters_0` and the like, the velocity as `U:0`, `U_0`, `U_x`, `Ux`, `UMean_0`, `velocity_0`, `u` and the like.
Each point goes to the cell that holds it; the points of a cell are averaged.

`postProcess -func writeCellCentres` writes `C`; one `C` is that of all times of a mesh that stays. Only the inner cells
are read, not the boundary.

A file is one frame, or all that it holds. A folder, or the beginning of a path such as GADEN's `wind_files` parameter,
is a series: files that differ by their last number, frame after frame. What is read:

    uniform       lines `u,v,w`, one a frame
    points        csv of ParaView, csv or raw sets of OpenFOAM: see above
    OpenFOAM      a time folder with `U`, or a case with several, and `C` in one of them or in `constant`
    components    GADEN's `<name>_i.csv_U`, `_V`, `_W`, text or binary
    results       GADEN's `wind_iteration_i` of all versions, `<name>_i.csv_gaden` (2.6) and `<name>_i` (3)
    arrays        `.npy` of (t, cells, 3), as AutoGDM+ and GSL-Bench have it, or (t, nx, ny, nz, 3)
"""

import re
import warnings
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.files import open_regular_file
from gslcosim.environment.model import Cell, Grid, WindFrames, point_text
from gslcosim.environment.store import data_error
from gslcosim_formats.data_files import (
    BINARY_MARK,
    BLANK_REMEDY,
    LARGEST_WIND_CELLS,
    RESULT_MAJORS,
    NumberedLines,
    check_amount,
    check_velocities,
    count_cells,
    number_lines,
    parse_numbers,
    read_array,
    read_components,
    read_content,
    read_lines,
    read_result,
    split_row,
)

_AXES = {"0": 0, "1": 1, "2": 2, "x": 0, "y": 1, "z": 2}
_NAME = re.compile(r"(?P<name>[a-z ]*?)[ _:\[(]*(?P<axis>[xyz012])[\])]?(?P<unit>[ _]\(?m\)?|_m_s)?")
# The first that is there in all three axes is taken.
_PLACES = ("points", "point", "cellcenters", "cell centers", "c", "cc", "coords", "coordinates", "")
_VELOCITIES = ("u", "velocity", "wind", "vel", "umean", "u mean")
# How far outside the grid a point may lie by rounding, in cells.
_ROUNDING_CELLS = 1e-4
# What is farther away is a fault of the file.
_FARTHEST_M = 1e9
_MASK = "vtkValidPointMask"
_N_POINT_COLUMNS = 6
VELOCITY_FILE = "U"
CENTRES_FILES = ("C", "cellCentres")
_FORMAT = re.compile(rb"\bformat\s+(\w+)\s*;")
_ARCH = re.compile(rb"\barch\s+\"(?P<order>[LM]SB)?[^\"]*scalar=(?P<bits>\d+)")
# Either so many vectors, or so many times one.
_LIST = re.compile(rb"^\s*internalField\s+nonuniform\s+List<vector>\s+(\d+)\s*([({])", re.MULTILINE)
_UNIFORM = re.compile(rb"^\s*internalField\s+uniform\s+\(([^)]*)\)\s*;", re.MULTILINE)
# What a compressed field may hold; chosen.
_LARGEST_FIELD_BYTES = 2**32
# The shortest vector is `(0 0 0)`.
_LEAST_VECTOR_BYTES = 7
_COMPONENT = re.compile(r"(?P<name>.*\.csv)_[UVW]")
_NUMBERED = re.compile(
    r"(?P<prefix>.*?)[_.-]?(?P<number>\d+)(?P<suffix>(\.csv(_gaden)?|\.xy|\.raw|\.txt|\.dat|\.npy)?)"
)
_TABLE_SUFFIXES = (".csv", ".xy", ".raw", ".txt", ".dat")
_RESULT_PREFIX, _RESULT_SUFFIX = "wind_iteration", ".csv_gaden"
# With still air in more than this share of the air cells of all frames, a warning says so; chosen.
_MOSTLY = 0.5
POINTS, FOAM = "points with velocities", "time folders of OpenFOAM"
COMPONENTS, RESULTS = "GADEN's component files", "GADEN's results"
UNIFORM, ARRAY = "uniform wind", "a numpy array"
# So much of a file identifies its kind.
_HEAD_BYTES = 2**16
_NPY_MARK = b"\x93NUMPY"
_KNOWN = (
    "a table of points, lines u,v,w, <name>_i.csv_U with _V and _W, wind_iteration_i, <name>_i.csv_gaden, .npy, "
    "or a folder of OpenFOAM with U and C"
)
# Of a file whose content is not recognised: its error is raised when its series is taken.
_UNKNOWN = "unknown"
# What GADEN makes of a series of tables, and leaves beside them, comes before these; in the order of GADEN.
_FIRST_KINDS = (RESULTS, COMPONENTS)
_Numbered = dict[str, list[tuple[int, Path]]]
_CENTRES_REMEDY = "Run postProcess -func writeCellCentres."
_PARTS_REMEDY = "Run reconstructPar."
# Of a case that is solved in parts: the folders of these.
_PART = re.compile(r"processors?\d+(_\d+-\d+)?")
# A time that holds no more than these has no flow.
_MESH_FIELDS = frozenset((*CENTRES_FILES, "Cx", "Cy", "Cz", "ccx", "ccy", "ccz", "V"))


@dataclass(frozen=True, kw_only=True)
class PointWind:
    """Samples brought to cells: `velocity_m_s` (nx, ny, nz, 3), `is_sampled` (nx, ny, nz), points outside the grid."""

    velocity_m_s: NDArray[np.float32]
    is_sampled: NDArray[np.bool_]
    n_outside: int


def read_points(path: Path, grid: Grid) -> PointWind:
    """Return the wind that a file of points gives to the cells of a grid; cells without a point are still air."""
    table = _table(path, read_lines(path))
    columns = _columns(path, table)
    values = _numbers_of(path, table, columns)
    if not len(values):
        raise data_error(path, "points below the header", "none")
    if len(columns) > _N_POINT_COLUMNS and not values[:, -1].all():
        line = table.rows[int(np.argmin(values[:, -1] != 0))][0]
        found = f"{int((values[:, -1] == 0).sum())} without one, by {_MASK} 0, the first in line {line}"
        raise data_error(path, "samples with a value", found, remedy=BLANK_REMEDY)
    return average_points(path, values[:, :3], values[:, 3:6], grid)


def read_uniform(path: Path, grid: Grid, is_air: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the (t, nx, ny, nz, 3) wind of lines `u,v,w`, one a frame: the same in all air [m/s]."""
    table = _table(path, read_lines(path))
    columns = list(range(3)) if table.names is None else _vector(table.names, _VELOCITIES)
    if columns is None:
        raise data_error(path, "columns u, v, w", ", ".join(table.names or ())[:200])
    winds = _numbers_of(path, table, [*columns])
    if len(winds) == count_cells(grid) > 1:
        raise data_error(
            path,
            "uniform wind, a line u,v,w for each frame",
            f"{len(winds)} lines, as many as cells",
            remedy="Wind of each cell needs its places, x y z u v w, or is a .npy array.",
        )
    check_amount(path, len(winds), grid)
    return is_air[np.newaxis, ..., np.newaxis] * winds[:, None, None, None].astype(np.float32)


def average_points(
    path: Path, points_m: NDArray[np.float64], velocity_m_s: NDArray[np.float64], grid: Grid
) -> PointWind:
    """Return the mean velocity of the points in each cell.

    Args:
        path: Where they are from, for errors.
        points_m: (n, 3) places, world frame [m].
        velocity_m_s: (n, 3) wind there, world frame [m/s].
        grid: The cells.
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


@dataclass(frozen=True, kw_only=True)
class _Table:
    # Rows of a text, without its comments and header; `names` of the columns where it has them.
    names: list[str] | None
    rows: NumberedLines
    delimiter: str | None
    n_columns: int


def _table(path: Path, lines: NumberedLines) -> _Table:
    comments = [line for line in lines if line[1].startswith("#")]
    rows = [line for line in lines if not line[1].startswith("#")]
    if not rows:
        raise data_error(path, "lines of wind", "an empty file")
    words, delimiter = split_row(rows[0][1])
    names = split_row(comments[-1][1].lstrip("# \t"))[0] if comments else []
    # A remark is no header, even if it has as many words.
    if len(names) != len(words) or _vector(names, _VELOCITIES) is None:
        names = None
    if names is None and not all(map(_is_number, words)):
        names, rows = words, rows[1:]
    return _Table(names=names, rows=rows, delimiter=delimiter, n_columns=len(words))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# The numbers of some columns; those of the velocities, three from the last place or mask, are what blows.
def _numbers_of(path: Path, table: _Table, columns: Sequence[int]) -> NDArray[np.float64]:
    values = parse_numbers(
        path, table.rows, table.n_columns, delimiter=table.delimiter, columns=columns, blank_remedy=BLANK_REMEDY
    )
    first = 0 if len(columns) == 3 else 3

    def place(index: int) -> str:
        row, axis = divmod(index, 3)
        return f"line {table.rows[row][0]}, column {columns[first + axis] + 1}"

    check_velocities(path, values[np.newaxis, :, first : first + 3], place)
    return values


# Where x, y and z of the first known vector are that has all three.
def _vector(names: Sequence[str], known: Sequence[str]) -> list[int] | None:
    found: dict[str, dict[int, int]] = {}
    for column, name in enumerate(names):
        match = _NAME.fullmatch(name.lower())
        if match is not None:
            found.setdefault(match["name"].strip(), {}).setdefault(_AXES[match["axis"]], column)
    axes = next((found[name] for name in known if len(found.get(name, ())) == 3), None)
    if axes is None and known is _VELOCITIES and {*"uvw"} <= {*names}:
        return [names.index(letter) for letter in "uvw"]
    return None if axes is None else [axes[axis] for axis in range(3)]


# Those of x, y, z, u, v, w, and of ParaView's mask where there is one.
def _columns(path: Path, table: _Table) -> list[int]:
    if table.names is None:
        if table.n_columns != _N_POINT_COLUMNS:
            raise data_error(
                path,
                "six columns x y z u v w, or a header that names more",
                f"{table.n_columns} columns in line {table.rows[0][0]}",
            )
        return list(range(_N_POINT_COLUMNS))
    places, winds = _vector(table.names, _PLACES), _vector(table.names, _VELOCITIES)
    if places is None or winds is None:
        missing = (
            "places such as Points:0, Points:1, Points:2" if places is None else "velocities such as U:0, U:1, U:2"
        )
        raise data_error(path, f"columns with {missing}", ", ".join(table.names)[:200])
    return [*places, *winds, *(i for i, name in enumerate(table.names) if name == _MASK)]


def is_foam_text(content: bytes) -> bool:
    """Return whether bytes are the beginning of a file of OpenFOAM."""
    return b"FoamFile" in content[:4000]


def read_time_folder(folder: Path, centres: Path, grid: Grid) -> PointWind:
    """Return the wind of `U` in an OpenFOAM time folder, at the centres of its cells, brought to the cells of a grid.

    Args:
        folder: Holds `U`, or `U.gz`.
        centres: The file of the centres, of this time or of another one of the same mesh.
        grid: The cells.
    """
    velocity_path = _find_field(folder, VELOCITY_FILE)
    assert velocity_path is not None, "checked when the series was found"
    centres_m, velocity_m_s = _vectors(centres), _vectors(velocity_path)
    if len(velocity_m_s) == 1 and len(centres_m) != 1:
        velocity_m_s = np.broadcast_to(velocity_m_s, centres_m.shape)
    if len(velocity_m_s) != len(centres_m):
        raise data_error(velocity_path, f"{len(centres_m)} vectors, as in {centres}", f"{len(velocity_m_s)}")
    check_velocities(velocity_path, velocity_m_s[np.newaxis], lambda i: f"vector {i // 3 + 1} of {len(velocity_m_s)}")
    return average_points(velocity_path, centres_m, velocity_m_s, grid)


def _find_field(folder: Path, *names: str) -> Path | None:
    paths = (folder / f"{name}{suffix}" for name in names for suffix in ("", ".gz"))
    return next((path for path in paths if path.is_file()), None)


def _vectors(path: Path) -> NDArray[np.float64]:
    content = read_content(path)
    if path.suffix == ".gz":
        content = _decompress(path, content)
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
    read = _binary if kind is not None and kind[1] == b"binary" else _ascii
    is_repeated = found[2] == b"{"
    closing, n_written = (b"}", 1) if is_repeated else (b")", n)
    vectors = read(path, content, found.end(), n_written, closing)
    return np.broadcast_to(vectors, (min(n, LARGEST_WIND_CELLS), 3)) if is_repeated else vectors


def _decompress(path: Path, content: bytes) -> bytes:
    unpacker = zlib.decompressobj(wbits=31)
    try:
        unpacked = unpacker.decompress(content, _LARGEST_FIELD_BYTES)
    except zlib.error as error:
        raise data_error(path, "a gzip file", str(error)) from error
    if not unpacker.eof:
        found = "more" if unpacker.unconsumed_tail else "a file that ends early"
        raise data_error(path, f"a whole gzip file of at most {_LARGEST_FIELD_BYTES:.0e} bytes", found)
    return unpacked


def _ascii(path: Path, content: bytes, start: int, n: int, closing: bytes) -> NDArray[np.float64]:
    text = content[start : content.find(b";", start)].rstrip()
    if not text.endswith(closing) or n * _LEAST_VECTOR_BYTES > len(text):
        raise data_error(path, f"{n} vectors and a closing {closing.decode()};", f"{len(content) - start} bytes")
    return _numbers(path, text.removesuffix(closing).replace(b"(", b" ").replace(b")", b" "), n)


def _numbers(path: Path, text: bytes, n: int) -> NDArray[np.float64]:
    words = text.split()
    if len(words) != 3 * n or not n:
        raise data_error(path, f"{max(n, 1)} vectors", f"{len(words)} numbers")
    try:
        return np.array([float(word) for word in words]).reshape(-1, 3)
    except ValueError as error:
        raise data_error(path, f"{n} vectors of numbers", str(error)) from error


def _binary(path: Path, content: bytes, start: int, n: int, closing: bytes) -> NDArray[np.float64]:
    arch = _ARCH.search(content[:start])
    order = ">" if arch is not None and arch["order"] == b"MSB" else "<"
    dtype = np.dtype(f"{order}f{4 if arch is not None and arch['bits'] == b'32' else 8}")
    end = start + 3 * n * dtype.itemsize
    if content[end : end + 1] != closing or not n:
        expected = f"{max(n, 1)} vectors of {dtype.itemsize} bytes a number and a closing {closing.decode()}"
        raise data_error(path, expected, "something else")
    return np.frombuffer(content, dtype, count=3 * n, offset=start).astype(np.float64).reshape(-1, 3)


class NoWindWarning(UserWarning):
    """An imported room has no wind; solve or load it before gas is released in it."""


class WindGapsWarning(UserWarning):
    """Cells of an imported wind have no sample, or most of them no wind: their air is still."""


@dataclass(frozen=True, kw_only=True)
class _Series:
    # Frames of one kind, in order; `centres` are those of each frame of OpenFOAM, `period_s` is there where names say
    # it, and `gaps` are sentences on what was left out.
    kind: str
    paths: tuple[Path, ...]
    centres: tuple[Path, ...] = ()
    period_s: float | None = None
    gaps: tuple[str, ...] = ()


def load_wind(
    path: Path,
    grid: Grid,
    *,
    occupancy: NDArray[np.uint8] | None = None,
    period_s: float | None = None,
    is_looping: bool = True,
) -> WindFrames:
    """Return the wind that a file, a folder, or a series of files holds.

    Args:
        path: The file or folder; or the common beginning of a series' names, without `_` and number.
        grid: The cells it is brought to.
        occupancy: (nx, ny, nz) of `Cell`; tells which cells are air, for uniform wind and for warnings. All are, if
            absent.
        period_s: Seconds from frame to frame; by default what OpenFOAM's time folders say, else 1.
        is_looping: Whether the first frame comes after the last; otherwise the last one stays.

    Warns:
        NoWindWarning: all cells are still air.
        WindGapsWarning: air cells have no sample, most of them have no wind, or samples lie outside the grid.
    """
    is_air = np.ones(grid.shape, np.bool_) if occupancy is None else occupancy != Cell.SOLID
    series = _recognised(path, grid)
    try:
        velocity_m_s, gaps = _frames(series, grid, is_air)
    except EnvironmentDataError as error:
        raise EnvironmentDataError(f"wind, recognised as {series.kind}: {error}") from error
    _warn(path, velocity_m_s, is_air, [*series.gaps, *gaps])
    period_s = period_s or series.period_s or 1.0
    return WindFrames(velocity_m_s=velocity_m_s, period_s=period_s, is_looping=is_looping)


# One file's frames.
_READERS: dict[str, Callable[[Path, Grid, NDArray[np.bool_]], NDArray[np.float32]]] = {
    COMPONENTS: lambda path, grid, _: read_components(_components_of(path), grid)[np.newaxis],
    RESULTS: lambda path, grid, _: read_result(path, grid)[np.newaxis],
    ARRAY: lambda path, grid, _: read_array(path, grid),
    UNIFORM: read_uniform,
}


def _frames(series: _Series, grid: Grid, is_air: NDArray[np.bool_]) -> tuple[NDArray[np.float32], list[str]]:
    check_amount(series.paths[0], len(series.paths), grid)
    if series.kind in (POINTS, FOAM):
        return _point_frames(series, grid, is_air)
    frames = [_READERS[series.kind](path, grid, is_air) for path in series.paths]
    return frames[0] if len(frames) == 1 else np.concatenate(frames), []


def _point_frames(series: _Series, grid: Grid, is_air: NDArray[np.bool_]) -> tuple[NDArray[np.float32], list[str]]:
    velocity_m_s = np.empty((len(series.paths), *grid.shape, 3), np.float32)
    n_missing = n_outside = 0
    for i, path in enumerate(series.paths):
        is_foam = series.kind == FOAM
        wind = read_time_folder(path, series.centres[i], grid) if is_foam else read_points(path, grid)
        velocity_m_s[i] = wind.velocity_m_s
        n_missing = max(n_missing, int((is_air & ~wind.is_sampled).sum()))
        n_outside += wind.n_outside
    gaps = [f"{n_missing} of {int(is_air.sum())} air cells have no sample and are still air"] if n_missing else []
    return velocity_m_s, gaps + ([f"{n_outside} samples lie outside the grid and are left out"] if n_outside else [])


def _warn(path: Path, velocity_m_s: NDArray[np.float32], is_air: NDArray[np.bool_], gaps: list[str]) -> None:
    n_air = int(is_air.sum())
    has_wind = np.zeros(is_air.shape, np.bool_)
    for frame in velocity_m_s:
        has_wind |= frame.any(axis=-1)
    n_still = n_air - int((has_wind & is_air).sum())
    if n_still == n_air:
        warnings.warn(f"{path.name}: no wind at all, all {n_air} air cells are still.", NoWindWarning, stacklevel=3)
    elif n_still > _MOSTLY * n_air:
        gaps = [*gaps, f"{n_still} of {n_air} air cells have no wind in any frame"]
    if gaps:
        warnings.warn(f"{path.name}: {'; '.join(gaps)}.", WindGapsWarning, stacklevel=3)


def _recognised(path: Path, grid: Grid) -> _Series:
    if path.is_dir():
        return _series_in(path, grid)
    if path.is_file():
        return _Series(kind=_kind_of(path, grid), paths=(_base_of(path),))
    return _series_named(path, grid)


# Of a component file that without its letter, as the series has it; others are themselves.
def _base_of(path: Path) -> Path:
    component = _COMPONENT.fullmatch(path.name)
    return path.with_name(component["name"]) if component is not None else path


def _components_of(base: Path) -> tuple[Path, Path, Path]:
    u, v, w = (base.with_name(f"{base.name}_{letter}") for letter in "UVW")
    return u, v, w


def _kind_of(path: Path, grid: Grid) -> str:
    if _COMPONENT.fullmatch(path.name):
        return COMPONENTS
    try:
        with open_regular_file(path) as file:
            head, n_bytes = file.read(_HEAD_BYTES), path.stat().st_size
    except OSError as error:
        raise data_error(path, "a file that can be read", str(error.strerror)) from error
    if head.startswith(_NPY_MARK) or path.suffix == ".npy":
        return ARRAY
    if is_foam_text(head):
        raise data_error(
            path, "a time folder, which holds U and C", "one file of OpenFOAM", remedy="Name the folder instead."
        )
    try:
        # What is cut off in the middle of a letter is a text too.
        text = head.decode("utf-8-sig", errors="strict" if n_bytes <= _HEAD_BYTES else "ignore")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" not in text and not head.startswith(np.int32(BINARY_MARK).tobytes()):
        lines = number_lines(text if n_bytes <= _HEAD_BYTES else text.rpartition("\n")[0])
        return _kind_of_table(path, lines)
    n, major = count_cells(grid), int.from_bytes(head[:4], "little")
    is_result = (n_bytes == 8 + 12 * n and major in RESULT_MAJORS) or n_bytes == 24 * n
    if is_result or path.name.startswith(_RESULT_PREFIX) or path.suffix == _RESULT_SUFFIX:
        return RESULTS
    raise data_error(path, _KNOWN, "binary, with another name")


def _kind_of_table(path: Path, lines: NumberedLines) -> str:
    table = _table(path, lines)
    if table.n_columns == 3:
        return UNIFORM
    if table.names is not None or table.n_columns == _N_POINT_COLUMNS:
        return POINTS
    raise data_error(path, _KNOWN, repr(lines[0][1][:80]))


def _series_named(path: Path, grid: Grid) -> _Series:
    if path.parent.is_dir():
        for prefix, files in _numbered(path.parent, grid).items():
            # GADEN's older parameters end with the underscore.
            if prefix == path.name.rstrip("_"):
                return _series_of(path, files, grid)
    raise data_error(path, "a file, a folder or the beginning of a series of wind", "missing")


def _series_in(folder: Path, grid: Grid, *, is_parent: bool = True) -> _Series:
    if _find_field(folder, VELOCITY_FILE) is not None:
        case = folder.absolute().parent
        return _foam_series(case, _time_folders(case), [(0.0, folder)])
    series = _numbered(folder, grid)
    if len(series) > 1:
        raise data_error(folder, "one series of wind", ", ".join(sorted(series)), remedy="Name one of them.")
    for files in series.values():
        return _series_of(folder, files, grid)
    return _times_in(folder) or _only_in(folder, grid, is_parent=is_parent)


# Files by the common beginning of their names, and by kind, with their numbers.
def _numbered(folder: Path, grid: Grid) -> dict[str, _Numbered]:
    found: dict[str, _Numbered] = {}
    for path in sorted(folder.iterdir()):
        base = _base_of(path)
        match = _NUMBERED.fullmatch(base.name)
        if match is None or not path.is_file():
            continue
        try:
            kind = _kind_of(path, grid)
        except EnvironmentDataError:
            kind = _UNKNOWN
        frame = int(match["number"]), base
        frames = found.setdefault(match["prefix"], {}).setdefault(kind, [])
        # Other programs leave files without an ending beside wind.
        if frame not in frames and (match["suffix"] or kind != _UNKNOWN):
            frames.append(frame)
    return {prefix: files for prefix, kinds in found.items() if (files := {k: v for k, v in kinds.items() if v})}


def _series_of(place: Path, files: _Numbered, grid: Grid) -> _Series:
    kind = next((kind for kind in (*_FIRST_KINDS, _UNKNOWN) if kind in files), next(iter(files)))
    if kind == _UNKNOWN:
        _kind_of(files[_UNKNOWN][0][1], grid)
    if kind not in _FIRST_KINDS and len(files) > 1:
        names = "; ".join(f"{name} in {frames[0][1].name}" for name, frames in files.items())
        raise data_error(place, "a series of one kind of wind", names)
    frames = sorted(files[kind])
    numbers = [number for number, _ in frames]
    double = next((i for i in range(1, len(frames)) if numbers[i] == numbers[i - 1]), None)
    if double is not None:
        names = " and ".join(path.name for _, path in frames[double - 1 : double + 1])
        raise data_error(place, f"one file with number {numbers[double]}", names)
    missing = next((n for n in range(numbers[0], numbers[-1]) if n not in numbers), None)
    if missing is not None:
        raise data_error(place, f"frames {numbers[0]} to {numbers[-1]} without a gap", f"none with number {missing}")
    return _Series(kind=kind, paths=tuple(path for _, path in frames))


# OpenFOAM's case, or its folder of one set: folders named by their time.
def _times_in(folder: Path) -> _Series | None:
    times = _time_folders(folder)
    frames = [(time_s, path) for time_s, path in times if _find_field(path, VELOCITY_FILE)]
    parts = [path for path in sorted(folder.iterdir()) if _PART.fullmatch(path.name) and path.is_dir()]
    solved = {
        time_s: path for part in parts for time_s, path in _time_folders(part) if _find_field(path, VELOCITY_FILE)
    }
    only_in_parts = [path for time_s, path in sorted(solved.items()) if time_s not in dict(frames)]
    if only_in_parts:
        names = ", ".join(path.name for path in only_in_parts[:5])
        found = f"{names} in {only_in_parts[0].parent.name} and others only"
        raise data_error(folder, "times of the whole mesh", found, remedy=_PARTS_REMEDY)
    if frames:
        fields = {path.name: {file.name.removesuffix(".gz") for file in path.iterdir()} for _, path in times}
        left_out = [name for name, found in fields.items() if found - _MESH_FIELDS and VELOCITY_FILE not in found]
        gaps = (f"the times {', '.join(left_out)} have no U and are left out",) if left_out else ()
        return replace(_foam_series(folder, times, frames), gaps=gaps)
    if not times:
        return None
    sets = [(time_s, table) for time_s, path in times for table in _tables_in(path)]
    if [time_s for time_s, _ in sets] != [time_s for time_s, _ in times]:
        names = ", ".join(path.name for _, path in times[:5])
        raise data_error(folder, "time folders with U and C, or with one table each", names, remedy=_CENTRES_REMEDY)
    times_s, paths = zip(*sets, strict=True)
    return _Series(kind=POINTS, paths=paths, period_s=_period_s(times_s))


# Frames of some times of a case. Of a mesh that stays, any C is that of all; one that moves needs C in each time.
def _foam_series(case: Path, times: list[tuple[float, Path]], frames: list[tuple[float, Path]]) -> _Series:
    times_s, folders = zip(*frames, strict=True)
    if any(_PART.fullmatch(path.name) for path in (case, *folders)):
        raise data_error(folders[0], "a time of the whole mesh", f"a part of {case.name}", remedy=_PARTS_REMEDY)
    own = [_find_field(folder, *CENTRES_FILES) for folder in folders]
    without = [folder for folder, centres in zip(folders, own, strict=True) if centres is None]
    shared = [
        path for folder in (case / "constant", *dict(times).values()) if (path := _find_field(folder, *CENTRES_FILES))
    ]
    if without and not shared:
        names = ", ".join(folder.name for folder in without[:5])
        raise data_error(case, "U and C in a time folder", f"U without C in {names}", remedy=_CENTRES_REMEDY)
    is_moving = any(_find_field(folder / "polyMesh", "points") for folder in without)
    if without and (is_moving or not all(np.array_equal(_vectors(path), _vectors(shared[0])) for path in shared[1:])):
        names = ", ".join(folder.name for folder in without[:5])
        found = f"none in {names}, and a mesh that moves"
        raise data_error(case, "C in each time of a mesh that moves", found, remedy=_CENTRES_REMEDY)
    return _Series(
        kind=FOAM,
        paths=folders,
        centres=tuple(centres or shared[0] for centres in own),
        period_s=_period_s(times_s),
    )


def _time_folders(folder: Path) -> list[tuple[float, Path]]:
    times = sorted((float(path.name), path) for path in folder.iterdir() if _is_time(path.name) and path.is_dir())
    for (time_s, path), (next_s, other) in pairwise(times):
        if time_s == next_s:
            raise data_error(folder, f"one folder of the time {time_s:g}", f"{path.name} and {other.name}")
    return times


def _tables_in(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.iterdir()) if path.suffix in _TABLE_SUFFIXES]


def _is_time(name: str) -> bool:
    return re.fullmatch(r"-?\d+(\.\d+)?(e[-+]?\d+)?", name) is not None


def _period_s(times_s: Sequence[float]) -> float | None:
    steps_s = np.diff(times_s)
    if not len(steps_s):
        return None
    if not np.allclose(steps_s, steps_s[0], rtol=1e-3, atol=0):
        warnings.warn(
            f"The times {', '.join(f'{t:g}' for t in times_s[:6])} s are not evenly spaced; "
            f"frames are taken to be {steps_s.mean():g} s apart, their mean.",
            WindGapsWarning,
            stacklevel=6,
        )
    return float(steps_s.mean())


def _only_in(folder: Path, grid: Grid, *, is_parent: bool) -> _Series:
    files = [path for path in sorted(folder.iterdir()) if path.suffix in (".npy", *_TABLE_SUFFIXES)]
    folders = [path for path in sorted(folder.iterdir()) if path.is_dir()]
    if is_parent and not files and len(folders) == 1:
        return _series_in(folders[0], grid, is_parent=False)
    if len(files) != 1:
        names = ", ".join(path.name for path in (files or folders)[:5]) or "none of them"
        raise data_error(folder, f"one file or series of wind: {_KNOWN}", names, remedy="Name the one to take.")
    return _Series(kind=_kind_of(files[0], grid), paths=(files[0],))
