"""GSL-Bench and AutoGDM+ environment folders: their occupancy grids, with their wind where it is there.

Layout of such a folder (GSL-Bench, environments/NNN; described by GSL-Bench's own files):

    occupancy/<name>_head.txt   JSON: env_min and env_max [m], num_cells (x, y, z), cell_size [m]
    occupancy/<name>_grid.npy   integers indexed [z, x, y]: 0 free, 1 obstacle, 2 inlet or outlet
    wind_data/<name>.npy        (t, cells, 3) wind [m/s], cell x + nx (y + ny z); AutoGDM+ writes it

The grids hold the walls, one or two cells thick, with the openings as cells of code 2 in them. GSL-Bench's published
folders have no wind. AutoGDM+ has the files of all its environments in one folder: there a room is named by its head
file. It also puts frames of wind together in whatever order its system lists files, which the array does not say.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.quantities import Vec3
from gslcosim.environment.formats.data_files import build_checked_grid, data_error, load_npy, read_content
from gslcosim.environment.formats.occupancy_import import geometry_from_grid, load_geometry_with_wind
from gslcosim.environment.geometry_model import EnvironmentGeometry
from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Cell, Environment

HEAD_SUFFIX, GRID_SUFFIX = "_head.txt", "_grid.npy"
OCCUPANCY_DIR, WIND_DIR = "occupancy", "wind_data"
_WIND_DIRS = (WIND_DIR, "wind")


class _Head(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    env_min: Vec3
    env_max: Vec3
    num_cells: tuple[int, int, int]
    cell_size: float = Field(gt=0)


def import_gsl_bench(
    path: Path, *, wind: Path | None = None, period_s: float | None = None, is_looping: bool = True
) -> Environment:
    """Return the room of a GSL-Bench environment folder with its wind.

    Solids become named boxes, floor and ceiling are added, and connected cells of code 2 become openings: inlets on
    the face x_min, where AutoGDM+ has its inlet, and outlets elsewhere. All of them end filaments, as in GADEN.

    Args:
        path: For example `environments/001` of GSL-Bench, or a head file, `occupancy/wh_empty_001_head.txt`.
        wind: The wind, see `load_wind`; by default what lies in `wind_data` or `wind`.
        period_s: Seconds from frame to frame; 1 by default, as in GSL-Bench.
        is_looping: Whether the first frame comes after the last.

    Raises:
        EnvironmentDataError: a file is missing, ambiguous, truncated, or does not agree with the other.

    Warns:
        NoWindWarning: there is no wind; the air is still.
        WindGapsWarning: see `load_wind`.
    """
    room = load_gsl_bench_geometry(path)
    folder = _head_path(path).parent.parent
    return load_geometry_with_wind(
        room, wind or _find_wind(folder, room.name), period_s=period_s, is_looping=is_looping
    )


def load_gsl_bench_geometry(path: Path) -> EnvironmentGeometry:
    """Return the room of a GSL-Bench environment folder, without wind; see `import_gsl_bench`."""
    head_path = _head_path(path)
    name = head_path.name.removesuffix(HEAD_SUFFIX)
    head = _load_head(head_path)
    grid = build_checked_grid(
        head_path, min_m=head.env_min, max_m=head.env_max, cell_m=head.cell_size, shape=head.num_cells
    )
    named = head_path.with_name(name + GRID_SUFFIX)
    occupancy = _load_occupancy(named if named.exists() else _only_file(head_path.parent, f"*{GRID_SUFFIX}"), grid)
    return geometry_from_grid(name, grid, occupancy, has_inlet_at_x_min=True)


def is_gsl_bench(path: Path) -> bool:
    """Return whether a path is a head file or a folder with some."""
    return path.name.endswith(HEAD_SUFFIX) or any((path / OCCUPANCY_DIR).glob(f"*{HEAD_SUFFIX}"))


def _head_path(path: Path) -> Path:
    return path if path.name.endswith(HEAD_SUFFIX) else _only_file(path / OCCUPANCY_DIR, f"*{HEAD_SUFFIX}")


def _find_wind(folder: Path, name: str) -> Path | None:
    for wind_dir in _WIND_DIRS:
        if (folder / wind_dir / f"{name}.npy").is_file():
            return folder / wind_dir / f"{name}.npy"
    filled = (folder / wind_dir for wind_dir in _WIND_DIRS)
    return next((path for path in filled if path.is_dir() and any(path.iterdir())), None)


def _only_file(folder: Path, pattern: str) -> Path:
    found = sorted(folder.glob(pattern))
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise EnvironmentDataError(f"expected one file {pattern}, was {names}.\nFolder: {folder}")
    return found[0]


def _load_head(path: Path) -> _Head:
    try:
        return _Head.model_validate_json(read_content(path))
    except ValidationError as error:
        found = str(error).replace("\n", " ")
        raise EnvironmentDataError(
            f"{path.name}: expected JSON with env_min, env_max, num_cells and cell_size, was {found}\nFile: {path}"
        ) from error


def _load_occupancy(path: Path, grid: Grid) -> NDArray[np.uint8]:
    nx, ny, nz = grid.shape
    codes = load_npy(path)
    if codes.shape != (nz, nx, ny) or codes.dtype.kind not in "iu":
        found = f"{codes.dtype} {codes.shape}"
        raise data_error(path, f"whole numbers [z, x, y] of {(nz, nx, ny)}, as in the head file", found)
    unknown = np.setdiff1d(codes, [cell.value for cell in Cell])
    if len(unknown):
        raise data_error(path, "0 free, 1 obstacle, 2 inlet or outlet", str(unknown[0]))
    return np.ascontiguousarray(np.moveaxis(codes, 0, 2), dtype=np.uint8)
