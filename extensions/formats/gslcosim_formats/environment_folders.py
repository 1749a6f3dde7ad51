"""Environments of other programs: GADEN's grids and the folders of GSL-Bench and AutoGDM+, with their wind.

GADEN has `OccupancyGrid3D.csv` with the wind around it. Layouts that are known, from MAPIRlab/gaden and AutoGDM+:

    <scenario>/OccupancyGrid3D.csv, wind_simulations/<name>/<name>_i.csv[_U|_V|_W], gas_simulations/<…>/<…>/wind
    <scenario>/environment_configurations/<name>/OccupancyGrid3D.csv, wind/wind_iteration_i, simulations/<…>/<…>/wind

GADEN's grid holds the walls; its outlets are cells of code 2, where filaments end. Inlets are not marked.

GSL-Bench and AutoGDM+ have grids with their wind where it is there. Layout of such a folder (GSL-Bench,
environments/NNN; described by GSL-Bench's own files):

    occupancy/<name>_head.txt   JSON: env_min and env_max [m], num_cells (x, y, z), cell_size [m]
    occupancy/<name>_grid.npy   integers indexed [z, x, y]: 0 free, 1 obstacle, 2 inlet or outlet
    wind_data/<name>.npy        (t, cells, 3) wind [m/s], cell x + nx (y + ny z); AutoGDM+ writes it

The grids hold the walls, one or two cells thick, with the openings as cells of code 2 in them. GSL-Bench's published
folders have no wind. AutoGDM+ has the files of all its environments in one folder: there a room is named by its head
file. It also puts frames of wind together in whatever order its system lists files, which the array does not say.
"""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid_kernels import group_opening_cells
from gslcosim.environment.model import (
    Cell,
    Environment,
    EnvironmentGeometry,
    Grid,
    Opening,
    WindFrames,
    closing_boxes,
    with_wind,
)
from gslcosim.environment.openings import Face
from gslcosim.environment.store import data_error, load_npy
from gslcosim_formats.data_files import (
    OCCUPANCY_FILE,
    build_checked_grid,
    read_content,
    read_occupancy,
)
from gslcosim_formats.solid_boxes import boxes_from_solid
from gslcosim_formats.wind_files import NoWindWarning, load_wind

# The walls are part of the grid or lie at its border; these close the openings, so that no vehicle leaves the room.
_CLOSING_WALL_M = 0.2
NOTICE = "The room comes from a grid: its solids are boxes of whole cells, and so are its walls."
# Below the folder of the occupancy: where a wind may be; the first pattern that is there is taken.
_WIND_FOLDERS = ("wind", "wind_simulations", "wind_simulations/*", "gas_simulations/*/*/wind", "simulations/*/*/wind")
_OCCUPANCY_PLACES = ("", "environment_configurations/*/")
# Folders that carry a layout's name and not the scenario's.
_CONFIGURATIONS = "environment_configurations"
HEAD_SUFFIX, GRID_SUFFIX = "_head.txt", "_grid.npy"
OCCUPANCY_DIR, WIND_DIR = "occupancy", "wind_data"
_WIND_DIRS = (WIND_DIR, "wind")


def geometry_from_grid(
    name: str, grid: Grid, occupancy: NDArray[np.uint8], *, has_inlet_at_x_min: bool = False
) -> EnvironmentGeometry:
    """Return the room that an occupancy grid describes.

    Args:
        name: The room's.
        grid: Its cells.
        occupancy: (nx, ny, nz) of `Cell`; becomes read-only.
        has_inlet_at_x_min: Openings on the face x_min are inlets, where AutoGDM+ has its inlet. Other openings, and
            those of formats that do not say, are outlets. All of them end filaments.
    """
    solids = boxes_from_solid(occupancy == Cell.SOLID, grid)
    occupancy.setflags(write=False)
    return EnvironmentGeometry(
        name=name,
        grid=grid,
        occupancy=occupancy,
        boxes=(*closing_boxes(grid.origin_m, grid.max_m, _CLOSING_WALL_M), *solids),
        openings=_find_openings(occupancy, grid, "x_min" if has_inlet_at_x_min else None),
        notices=(NOTICE,),
    )


def load_geometry_with_wind(
    room: EnvironmentGeometry, wind: Path | None, *, period_s: float | None, is_looping: bool
) -> Environment:
    """Return an imported room with the wind of a file or folder; without one its air is still, with a warning."""
    if wind is not None:
        frames = load_wind(wind, room.grid, occupancy=room.occupancy, period_s=period_s, is_looping=is_looping)
        return with_wind(room, frames)
    warnings.warn(
        f"{room.name} has no wind: all {room.occupancy.size} cells are still air. Solve its wind before use.",
        NoWindWarning,
        stacklevel=3,
    )
    still = np.zeros((1, *room.grid.shape, 3), dtype=np.float32)
    return with_wind(room, WindFrames(velocity_m_s=still))


# One opening per connected group of cells that reaches a face.
def _find_openings(occupancy: NDArray[np.uint8], grid: Grid, inlet_face: str | None) -> tuple[Opening, ...]:
    openings: list[Opening] = []
    for group, face in group_opening_cells(occupancy):
        if face is not None:
            kind = "inlet" if face.name == inlet_face else "outlet"
            min_m, max_m = _rectangle(np.argwhere(group), grid, face)
            openings.append(Opening(name=f"{kind}_{len(openings)}", kind=kind, min_m=min_m, max_m=max_m))
    return tuple(openings)


def _rectangle(cells: NDArray[np.int64], grid: Grid, face: Face) -> tuple[Vec3, Vec3]:
    corners = cells.min(axis=0), cells.max(axis=0) + 1
    (x0, y0, z0), (x1, y1, z1) = (
        [
            face.coordinate_m(grid) if axis == face.axis else round(grid.origin_m[axis] + int(i) * grid.cell_m, 9)
            for axis, i in enumerate(corner)
        ]
        for corner in corners
    )
    return (x0, y0, z0), (x1, y1, z1)


def import_gaden(
    path: Path, *, wind: Path | None = None, period_s: float | None = None, is_looping: bool = True
) -> Environment:
    """Return a room of GADEN with its wind.

    Args:
        path: A scenario's folder, one of its configurations, or the `OccupancyGrid3D.csv`.
        wind: The wind, see `load_wind`; by default what lies in the folders that GADEN uses.
        period_s: Seconds from frame to frame; 1 by default.
        is_looping: Whether the first frame comes after the last.

    Warns:
        NoWindWarning: there is no wind; the air is still.
        WindGapsWarning: see `load_wind`.
    """
    occupancy_path = _occupancy_path(path)
    room = load_gaden_geometry(occupancy_path)
    return load_geometry_with_wind(
        room, wind or _find_gaden_wind(occupancy_path.parent), period_s=period_s, is_looping=is_looping
    )


def load_gaden_geometry(path: Path) -> EnvironmentGeometry:
    """Return a room of GADEN without wind; see `import_gaden`."""
    occupancy_path = _occupancy_path(path)
    grid, occupancy = read_occupancy(occupancy_path)
    return geometry_from_grid(_name_of(occupancy_path), grid, occupancy)


def is_gaden(path: Path) -> bool:
    """Return whether a path is an `OccupancyGrid3D.csv` or a folder where one is found."""
    return bool(_occupancies(path))


def _occupancies(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix == ".csv" else []
    found = (sorted(path.glob(f"{place}{OCCUPANCY_FILE}")) for place in _OCCUPANCY_PLACES)
    return next((paths for paths in found if paths), [])


def _occupancy_path(path: Path) -> Path:
    found = _occupancies(path)
    if len(found) != 1:
        names = ", ".join(str(each.relative_to(path)) for each in found) or "none"
        raise data_error(path, f"one {OCCUPANCY_FILE} in the folder or its {_CONFIGURATIONS}", names)
    return found[0]


def _name_of(occupancy_path: Path) -> str:
    folder = occupancy_path.resolve().parent
    return folder.parent.parent.name if folder.parent.name == _CONFIGURATIONS else folder.name


def _find_gaden_wind(folder: Path) -> Path | None:
    for pattern in _WIND_FOLDERS:
        found = [path for path in sorted(folder.glob(pattern)) if path.is_dir() and _holds_files(path)]
        if len(found) > 1:
            names = ", ".join(str(path.relative_to(folder)) for path in found)
            raise data_error(folder, "one wind", names, remedy="Name the one to take.")
        if found:
            return found[0]
    return None


def _holds_files(folder: Path) -> bool:
    return any(path.is_file() for path in folder.iterdir())


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

    Warns:
        NoWindWarning: there is no wind; the air is still.
        WindGapsWarning: see `load_wind`.
    """
    room = load_gsl_bench_geometry(path)
    folder = _head_path(path).parent.parent
    return load_geometry_with_wind(
        room, wind or _find_gsl_bench_wind(folder, room.name), period_s=period_s, is_looping=is_looping
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


def _find_gsl_bench_wind(folder: Path, name: str) -> Path | None:
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
