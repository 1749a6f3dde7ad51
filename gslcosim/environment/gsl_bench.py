"""Environment folders of GSL-Bench and AutoGDM+: their occupancy grids as rooms.

Layout of such a folder (GSL-Bench, environments/NNN; described by GSL-Bench's own files):

    occupancy/<name>_head.txt   JSON: env_min and env_max [m], num_cells (x, y, z), cell_size [m]
    occupancy/<name>_grid.npy   integers indexed [z, x, y]: 0 free, 1 obstacle, 2 inlet or outlet

The grids hold the walls, one or two cells thick, with the openings as cells of code 2 in them.
Wind is not part of the folders that are published, so a room without wind is returned.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gslcosim.environment.grid import Grid, Vec3, point_text
from gslcosim.environment.layouts import closing_boxes
from gslcosim.environment.model import Cell, Environment, Opening, WindFrames
from gslcosim.environment.occupancy_kernels import reachable_cells
from gslcosim.environment.openings import FACES, Face
from gslcosim.environment.room import Room, with_wind
from gslcosim.environment.voxel_boxes import boxes_from_solid
from gslcosim.errors import EnvironmentDataError

# The walls are part of the grid; these close the openings in them, so that no vehicle leaves the room.
_CLOSING_WALL_M = 0.2


class NoWindWarning(UserWarning):
    """An imported room has no wind; solve or load it before gas is released in it."""


class _Head(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    env_min: Vec3
    env_max: Vec3
    num_cells: tuple[int, int, int]
    cell_size: float = Field(gt=0)


def import_gsl_bench(folder: Path) -> Environment:
    """Return the room of a GSL-Bench environment folder, with still air and a warning that says so.

    Solids become named boxes, floor and ceiling are added, and connected cells of code 2 become openings: inlets on
    the face x_min, where AutoGDM+ has its inlet, and outlets elsewhere. All of them end filaments, as in GADEN.

    Args:
        folder: For example `environments/001` of GSL-Bench.

    Raises:
        EnvironmentDataError: a file is missing, ambiguous, truncated, or does not agree with the other.
    """
    room = load_gsl_bench_room(folder)
    warnings.warn(
        f"{room.name} has no wind: all {room.occupancy.size} cells are still air. Solve its wind before use.",
        NoWindWarning,
        stacklevel=2,
    )
    still = np.zeros((1, *room.grid.shape, 3), dtype=np.float32)
    return with_wind(room, WindFrames(velocity_m_s=still))


def load_gsl_bench_room(folder: Path) -> Room:
    """Return the room of a GSL-Bench environment folder, without wind; see `import_gsl_bench`."""
    head_path = _only_file(folder / "occupancy", "*_head.txt")
    grid = _grid_of(_load_head(head_path), head_path)
    occupancy = _load_occupancy(_only_file(folder / "occupancy", "*_grid.npy"), grid)
    solids = boxes_from_solid(occupancy == Cell.SOLID, grid)
    occupancy.setflags(write=False)
    return Room(
        name=head_path.name.removesuffix("_head.txt"),
        grid=grid,
        occupancy=occupancy,
        boxes=(*closing_boxes(grid.origin_m, grid.max_m, _CLOSING_WALL_M), *solids),
        openings=_openings_of(occupancy == Cell.OUTLET, grid),
        notices=("The grid holds the walls; wall thickness is that of its cells.",),
    )


def _only_file(folder: Path, pattern: str) -> Path:
    found = sorted(folder.glob(pattern))
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise EnvironmentDataError(f"expected one file {pattern}, was {names}.\nFolder: {folder}")
    return found[0]


def _load_head(path: Path) -> _Head:
    try:
        return _Head.model_validate_json(path.read_text(encoding="utf-8"))
    except (ValidationError, UnicodeDecodeError) as error:
        found = str(error).replace("\n", " ")
        raise EnvironmentDataError(
            f"{path.name}: expected JSON with env_min, env_max, num_cells and cell_size, was {found}\nFile: {path}"
        ) from error


def _grid_of(head: _Head, path: Path) -> Grid:
    lengths_m = np.subtract(head.env_max, head.env_min)
    if not np.allclose(np.multiply(head.num_cells, head.cell_size), lengths_m, rtol=0.0, atol=1e-6):
        raise EnvironmentDataError(
            f"{path.name}: expected num_cells * cell_size to be env_max - env_min, {point_text(lengths_m.tolist())} m, "
            f"was {head.num_cells} * {head.cell_size:g} m.\nFile: {path}"
        )
    return Grid(origin_m=head.env_min, cell_m=head.cell_size, shape=head.num_cells)


def _load_occupancy(path: Path, grid: Grid) -> NDArray[np.uint8]:
    nx, ny, nz = grid.shape
    try:
        codes: NDArray[Any] = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise EnvironmentDataError(
            f"{path.name}: expected a whole numpy array, was {path.stat().st_size} bytes that are not ({error})."
            f"\nFile: {path}"
        ) from error
    if codes.shape != (nz, nx, ny):
        raise EnvironmentDataError(
            f"{path.name}: expected [z, x, y] of {(nz, nx, ny)}, as in the head file, was {codes.shape}.\nFile: {path}"
        )
    unknown = np.setdiff1d(codes, [cell.value for cell in Cell])
    if len(unknown):
        raise EnvironmentDataError(
            f"{path.name}: expected 0 free, 1 obstacle, 2 inlet or outlet, was {unknown[0]}.\nFile: {path}"
        )
    return np.ascontiguousarray(np.moveaxis(codes, 0, 2), dtype=np.uint8)


# One opening per connected group of cells, laid on the face of the grid that it reaches.
def _openings_of(is_opening: NDArray[np.bool_], grid: Grid) -> tuple[Opening, ...]:
    left = is_opening.copy()
    openings: list[Opening] = []
    while left.any():
        group = reachable_cells(left, np.argwhere(left)[:1])
        left &= ~group
        cells = np.argwhere(group)
        opening = _opening_of(cells.min(axis=0), cells.max(axis=0) + 1, grid, len(openings))
        if opening is not None:
            openings.append(opening)
    return tuple(openings)


def _opening_of(low: NDArray[np.int64], high: NDArray[np.int64], grid: Grid, number: int) -> Opening | None:
    face = next((face for face in FACES if _reaches(low, high, grid, face)), None)
    if face is None:
        return None
    min_m = [round(grid.origin_m[axis] + int(low[axis]) * grid.cell_m, 9) for axis in range(3)]
    max_m = [round(grid.origin_m[axis] + int(high[axis]) * grid.cell_m, 9) for axis in range(3)]
    min_m[face.axis] = max_m[face.axis] = face.coordinate_m(grid)
    kind = "inlet" if face.name == "x_min" else "outlet"
    return Opening(
        name=f"{kind}_{number}",
        kind=kind,
        min_m=(min_m[0], min_m[1], min_m[2]),
        max_m=(max_m[0], max_m[1], max_m[2]),
    )


def _reaches(low: NDArray[np.int64], high: NDArray[np.int64], grid: Grid, face: Face) -> bool:
    return bool(high[face.axis] == grid.shape[face.axis] if face.is_upper else low[face.axis] == 0)
