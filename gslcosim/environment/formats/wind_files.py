"""Wind files of other programs, recognised by content and name, as frames on a grid.

Wind at points comes from csv of ParaView and OpenFOAM, from bare columns, or from fields of an OpenFOAM time folder.
Columns are found by their names, in any order and among others: the place as `Points:0`, `Points_0`, `x`, `C_x`,
`CellCenters_0` and the like, the velocity as `U:0`, `U_0`, `U_x`, `Ux`, `UMean_0`, `velocity_0`, `u` and the like.
Each point goes to the cell that holds it; the points of a cell are averaged.

`postProcess -func writeCellCentres` writes `C`. Only the inner cells are read, not the boundary.

A file is one frame, or all that it holds. A folder, or the beginning of a path such as GADEN's `wind_files` parameter,
is a series: files that differ by their last number, frame after frame. What is read:

    uniform       lines `u,v,w`, one a frame
    points        csv of ParaView, csv or raw sets of OpenFOAM: see above
    OpenFOAM      a time folder with `U` and `C`, or a case with several
    components    GADEN's `<name>_i.csv_U`, `_V`, `_W`, text or binary
    results       GADEN's `wind_iteration_i`, versions 1 to 3
    arrays        `.npy` of (t, cells, 3), as AutoGDM+ and GSL-Bench have it, or (t, nx, ny, nz, 3)
"""

import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.formats.data_files import (
    BINARY_MARK,
    LARGEST_WIND_CELLS,
    NumberedLines,
    check_velocities,
    count_cells,
    data_error,
    parse_numbers,
    read_array,
    read_components,
    read_content,
    read_lines,
    read_result,
    read_uniform,
)
from gslcosim.environment.model import Cell, Grid, WindFrames, point_text

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


_COMPONENT = re.compile(r"(?P<name>.*\.csv)_[UVW]")
_NUMBERED = re.compile(r"(?P<prefix>.*?)_?(?P<number>\d+)(?P<suffix>(\.csv|\.xy|\.raw|\.txt|\.dat)?)")
_TABLE_SUFFIXES = (".csv", ".xy", ".raw", ".txt", ".dat")
_RESULT_PREFIX = "wind_iteration"
# With still air in more than this share of the air cells of all frames, a warning says so; chosen.
_MOSTLY = 0.5


class NoWindWarning(UserWarning):
    """An imported room has no wind; solve or load it before gas is released in it."""


class WindGapsWarning(UserWarning):
    """Cells of an imported wind have no sample, or most of them no wind: their air is still."""


@dataclass(frozen=True, kw_only=True)
class _Series:
    # Frames of one kind, in order; `period_s` where the names say it.
    kind: str
    paths: tuple[Path, ...]
    period_s: float | None = None


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

    Raises:
        EnvironmentDataError: the wind is not recognised, or what was recognised is truncated or does not fit; the text
            says both.

    Warns:
        NoWindWarning: all cells are still air.
        WindGapsWarning: air cells have no sample, most of them have no wind, or samples lie outside the grid.
    """
    is_air = np.ones(grid.shape, np.bool_) if occupancy is None else occupancy != Cell.SOLID
    series = _recognised(path)
    try:
        velocity_m_s, gaps = _frames(series, grid, is_air)
    except EnvironmentDataError as error:
        raise EnvironmentDataError(f"wind, recognised as {series.kind}: {error}") from error
    _warn(path, velocity_m_s, is_air, gaps)
    period_s = period_s or series.period_s or 1.0
    return WindFrames(velocity_m_s=velocity_m_s, period_s=period_s, is_looping=is_looping)


POINTS, FOAM = "points with velocities", "time folders of OpenFOAM"
COMPONENTS, RESULTS = "GADEN's component files", "GADEN's results"
UNIFORM, ARRAY = "uniform wind", "a numpy array"

_POINT_READERS: dict[str, Callable[[Path, Grid], PointWind]] = {POINTS: read_points, FOAM: read_time_folder}


def _frames(series: _Series, grid: Grid, is_air: NDArray[np.bool_]) -> tuple[NDArray[np.float32], list[str]]:
    first = series.paths[0]
    if len(series.paths) * count_cells(grid) > LARGEST_WIND_CELLS:
        raise data_error(first, f"at most {LARGEST_WIND_CELLS:.0e} cells in all frames", f"{len(series.paths)} frames")
    if series.kind in _POINT_READERS:
        return _point_frames(series, grid, is_air)
    if series.kind == COMPONENTS:
        return np.stack([read_components(_components_of(path), grid) for path in series.paths]), []
    if series.kind == RESULTS:
        return np.stack([read_result(path, grid) for path in series.paths]), []
    if series.kind == ARRAY:
        return read_array(first, grid), []
    return read_uniform(first, grid, is_air), []


def _point_frames(series: _Series, grid: Grid, is_air: NDArray[np.bool_]) -> tuple[NDArray[np.float32], list[str]]:
    velocity_m_s = np.empty((len(series.paths), *grid.shape, 3), np.float32)
    n_missing = n_outside = 0
    for i, path in enumerate(series.paths):
        wind = _POINT_READERS[series.kind](path, grid)
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


def _recognised(path: Path) -> _Series:
    if path.is_dir():
        return _series_in(path)
    if path.is_file():
        return _Series(kind=_kind_of(path), paths=(_base_of(path),))
    return _series_named(path)


# Of a component file that without its letter, as the series has it; others are themselves.
def _base_of(path: Path) -> Path:
    component = _COMPONENT.fullmatch(path.name)
    return path.with_name(component["name"]) if component is not None else path


def _components_of(base: Path) -> tuple[Path, Path, Path]:
    u, v, w = (base.with_name(f"{base.name}_{letter}") for letter in "UVW")
    return u, v, w


def _kind_of(path: Path) -> str:
    if _COMPONENT.fullmatch(path.name):
        return COMPONENTS
    if path.suffix == ".npy":
        return ARRAY
    if path.name.startswith(_RESULT_PREFIX):
        return RESULTS
    content = read_content(path)
    if is_foam_text(content):
        raise data_error(
            path, "a time folder, which holds U and C", "one file of OpenFOAM", remedy="Name the folder instead."
        )
    if b"\0" in content or content[:4] == np.int32(BINARY_MARK).tobytes():
        raise data_error(path, _KNOWN, "binary, with another name")
    return _kind_of_text(path)


_KNOWN = (
    "a table of points, lines u,v,w, <name>_i.csv_U with _V and _W, wind_iteration_i, .npy, "
    "or a folder of OpenFOAM with U and C"
)


def _kind_of_text(path: Path) -> str:
    lines = read_lines(path)
    if is_table_of_points(lines):
        return POINTS
    if lines and len(lines[0][1].replace(",", " ").split()) == 3:
        return UNIFORM
    raise data_error(path, _KNOWN, repr(lines[0][1][:80]) if lines else "an empty file")


def _series_named(path: Path) -> _Series:
    if not path.parent.is_dir():
        raise data_error(path, "a file, a folder or the beginning of a series of wind", "missing")
    numbers = _numbered(path.parent)
    for kind, prefix in numbers:
        if prefix == path.name:
            return _Series(kind=kind, paths=_in_order(path, numbers[kind, prefix]))
    raise data_error(path, "a file, a folder or the beginning of a series of wind", "missing")


# GADEN leaves its component files beside the tables that they were made from; they are what it uses.
_FIRST_KINDS = (COMPONENTS, RESULTS, POINTS)


def _series_in(folder: Path) -> _Series:
    if is_time_folder(folder):
        return _Series(kind=FOAM, paths=(folder,))
    numbers = _numbered(folder)
    for kind in _FIRST_KINDS:
        prefixes = sorted(prefix for found, prefix in numbers if found == kind)
        if len(prefixes) > 1:
            raise data_error(folder, "one series of wind", ", ".join(prefixes), remedy="Name one of them.")
        if prefixes:
            return _Series(kind=kind, paths=_in_order(folder, numbers[kind, prefixes[0]]))
    return _times_in(folder) or _only_in(folder)


# Files by kind and common beginning of their names, with their numbers.
def _numbered(folder: Path) -> dict[tuple[str, str], dict[int, Path]]:
    found: dict[tuple[str, str], dict[int, Path]] = {}
    for path in sorted(folder.iterdir()):
        base = _base_of(path)
        match = _NUMBERED.fullmatch(base.name)
        if match is None or not path.is_file():
            continue
        is_table = match["suffix"] in _TABLE_SUFFIXES
        is_result = match["prefix"] == _RESULT_PREFIX and not match["suffix"]
        if base != path or is_table or is_result:
            kind = COMPONENTS if base != path else RESULTS if is_result else POINTS
            found.setdefault((kind, match["prefix"]), {})[int(match["number"])] = base
    return found


def _in_order(place: Path, files: dict[int, Path]) -> tuple[Path, ...]:
    numbers = sorted(files)
    missing = next((n for n in range(numbers[0], numbers[-1]) if n not in files), None)
    if missing is not None:
        raise data_error(place, f"frames {numbers[0]} to {numbers[-1]} without a gap", f"none with number {missing}")
    return tuple(files[number] for number in numbers)


# OpenFOAM's case, or its folder of one set: folders named by their time. Those of a case without C, such as 0, hold no
# wind that has a place.
def _times_in(folder: Path) -> _Series | None:
    times = sorted((float(path.name), path) for path in folder.iterdir() if _is_time(path.name) and path.is_dir())
    if not times:
        return None
    whole = [(time_s, path) for time_s, path in times if is_time_folder(path)]
    sets = [(time_s, table) for time_s, path in times for table in _tables_in(path)]
    if not whole and [time_s for time_s, _ in sets] != [time_s for time_s, _ in times]:
        names = ", ".join(path.name for _, path in times[:5])
        remedy = "Run postProcess -func writeCellCentres."
        raise data_error(folder, "time folders with U and C, or with one table each", names, remedy=remedy)
    times_s, paths = zip(*(whole or sets), strict=True)
    return _Series(kind=FOAM if whole else POINTS, paths=paths, period_s=_period_s(times_s))


def _tables_in(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.iterdir()) if path.suffix in _TABLE_SUFFIXES]


def _is_time(name: str) -> bool:
    return re.fullmatch(r"\d+(\.\d+)?(e[-+]?\d+)?", name) is not None


def _period_s(times_s: Sequence[float]) -> float | None:
    steps_s = np.diff(times_s)
    if not len(steps_s):
        return None
    if not np.allclose(steps_s, steps_s[0], rtol=1e-3):
        warnings.warn(
            f"The times {', '.join(f'{t:g}' for t in times_s[:6])} s are not evenly spaced; "
            f"frames are taken to be {steps_s.mean():g} s apart, their mean.",
            WindGapsWarning,
            stacklevel=6,
        )
    return float(steps_s.mean())


def _only_in(folder: Path) -> _Series:
    files = [path for path in sorted(folder.iterdir()) if path.suffix in (".npy", *_TABLE_SUFFIXES)]
    if len(files) != 1:
        names = ", ".join(path.name for path in files[:5]) or "none of them"
        raise data_error(folder, f"one file or series of wind: {_KNOWN}", names)
    return _Series(kind=_kind_of(files[0]), paths=(files[0],))
