"""Wind files of other programs, recognised by content and name, as frames on a grid.

A file is one frame, or all that it holds. A folder, or the beginning of a path such as GADEN's `wind_files` parameter,
is a series: files that differ by their last number, frame after frame. What is read:

    uniform       lines `u,v,w`, one a frame
    points        csv of ParaView, csv or raw sets of OpenFOAM: see `wind_points`
    OpenFOAM      a time folder with `U` and `C`, or a case with several: see `wind_points`
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
from gslcosim.environment.formats.data_files import data_error, read_content, read_lines
from gslcosim.environment.formats.wind_arrays import (
    BINARY_MARK,
    LARGEST_WIND_CELLS,
    count_cells,
    read_array,
    read_components,
    read_result,
    read_uniform,
)
from gslcosim.environment.formats.wind_points import (
    PointWind,
    is_foam_text,
    is_table_of_points,
    is_time_folder,
    read_points,
    read_time_folder,
)
from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Cell, WindFrames

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
