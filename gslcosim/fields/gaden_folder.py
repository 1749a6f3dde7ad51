"""What lies around GADEN's gas frames: the occupancy grid of the scenario, and the wind of the result folder.

    OccupancyGrid3D.csv        beside the results or above them: four lines of head, then one layer of cells after the
                               other, each row along y, one row for each x; a line with `;` ends a layer
    wind/wind_iteration_i      versions 1 and 2: all U, then all V, then all W, float64; version 3: int major, minor,
                               then float32 triples; x runs fastest, then y

Both layouts were taken from MAPIRlab/gaden and MAPIRlab/gaden_core.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid, Vec3
from gslcosim.environment.model import Cell
from gslcosim.errors import EnvironmentDataError
from gslcosim.fields.concentration import Walls

OCCUPANCY_FILE = "OccupancyGrid3D.csv"
# Results lie a few folders below their scenario.
N_FOLDERS_UP = 4
_N_HEAD_LINES = 4
_LARGEST_GRID_CELLS = 10**9


def find_occupancy(folder: Path) -> Path | None:
    """Return the nearest `OccupancyGrid3D.csv` in a folder or the few above it, if there is one."""
    above = folder.resolve()
    for candidate in [above, *above.parents][: N_FOLDERS_UP + 1]:
        if (candidate / OCCUPANCY_FILE).is_file():
            return candidate / OCCUPANCY_FILE
    return None


def read_walls(path: Path) -> Walls:
    """Return the walls that an `OccupancyGrid3D.csv` describes.

    Raises:
        EnvironmentDataError: the file is not of this kind, or its cells do not fit its head.
    """
    grid, lines = _head(path)
    rows = [line.split() for line in lines if line.strip() and line.strip() != ";"]
    nx, ny, nz = grid.shape
    if len(rows) != nx * nz or any(len(row) != ny for row in rows):
        raise _error(path, f"{nx * nz} rows of {ny} cells", f"{len(rows)} rows of {sorted({len(r) for r in rows})}")
    try:
        codes = np.array(rows, np.int64).reshape(nz, nx, ny)
    except ValueError as error:
        raise _error(path, "whole numbers as cells", str(error)) from error
    unknown = np.setdiff1d(codes, [cell.value for cell in Cell])
    if len(unknown):
        raise _error(path, "0 free, 1 obstacle or 2 outlet in each cell", str(unknown[0]))
    return Walls.of_occupancy(np.moveaxis(codes, 0, 2).astype(np.uint8), grid)


def read_wind(path: Path, grid: Grid) -> NDArray[np.float32]:
    """Return the (nx, ny, nz, 3) wind of one `wind_iteration_i`, world frame [m/s].

    Args:
        path: The file.
        grid: The cells that it covers.

    Raises:
        EnvironmentDataError: the file is missing or does not fit the grid.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise EnvironmentDataError(f"wind: cannot be read ({error.strerror}). File: {path}") from error
    nx, ny, nz = grid.shape
    n = nx * ny * nz
    if len(content) == 24 * n:
        values = np.frombuffer(content, "<f8").reshape(3, nz, ny, nx).transpose(3, 2, 1, 0)
    elif len(content) == 8 + 12 * n:
        values = np.frombuffer(content, "<f4", offset=8).reshape(nz, ny, nx, 3).transpose(2, 1, 0, 3)
    else:
        raise _error(path, f"{24 * n} bytes (versions 1 and 2) or {8 + 12 * n} (3) for {n} cells", f"{len(content)}")
    with np.errstate(all="ignore"):
        velocity_m_s = np.ascontiguousarray(values, np.float32)
    if not np.isfinite(velocity_m_s).all():
        raise _error(path, "finite velocities", "others among them")
    return velocity_m_s


def _head(path: Path) -> tuple[Grid, list[str]]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise _error(path, "a text that can be read", str(error)) from error
    names = ("env_min", "env_max", "num_cells", "cell_size")
    try:
        numbers = [
            _numbers_of(line, name, 1 if name == "cell_size" else 3) for line, name in zip(lines, names, strict=False)
        ]
        (min_m, max_m, cells, (cell_m,)) = numbers
    except ValueError as error:
        raise _error(path, f"{_N_HEAD_LINES} lines of head: {', '.join(f'#{n}' for n in names)}", str(error)) from error
    shape = (int(cells[0]), int(cells[1]), int(cells[2]))
    is_sound = min(shape) > 0 and np.isfinite([*min_m, cell_m]).all() and cell_m > 0
    if not is_sound or int(np.prod(np.array(shape, object))) > _LARGEST_GRID_CELLS:
        raise _error(path, "a grid of finite, positive size", f"{shape} cells of {cell_m} m from {min_m} to {max_m} m")
    origin_m: Vec3 = (min_m[0], min_m[1], min_m[2])
    return Grid(origin_m=origin_m, cell_m=cell_m, shape=shape), lines[_N_HEAD_LINES:]


def _numbers_of(line: str, name: str, n: int) -> list[float]:
    word, *numbers = line.split()
    if not word.startswith(f"#{name}") or len(numbers) != n:
        raise ValueError(f"{line!r} where #{name} and {n} numbers are expected")
    return [float(number) for number in numbers]


def _error(path: Path, expected: str, found: str) -> EnvironmentDataError:
    return EnvironmentDataError(f"{path.name}: expected {expected}, was {found}. File: {path}")
