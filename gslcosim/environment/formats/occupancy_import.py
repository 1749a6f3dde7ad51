"""Environment from an occupancy grid: solids become boxes, cells of code 2 become openings."""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.boxes import boxes_from_solid
from gslcosim.environment.flood_fill import reachable_cells
from gslcosim.environment.formats.wind_files import NoWindWarning, load_wind
from gslcosim.environment.geometry_model import EnvironmentGeometry, with_wind
from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Cell, Environment, Opening, WindFrames
from gslcosim.environment.openings import FACES, Face
from gslcosim.environment.plan import closing_boxes

# The walls are part of the grid or lie at its border; these close the openings, so that no vehicle leaves the room.
_CLOSING_WALL_M = 0.2
NOTICE = "The room comes from a grid: its solids are boxes of whole cells, and so are its walls."


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
        openings=_openings_of(occupancy == Cell.OUTLET, grid, "x_min" if has_inlet_at_x_min else None),
        notices=(NOTICE,),
    )


def load_geometry_with_wind(
    room: EnvironmentGeometry, wind: Path | None, *, period_s: float | None, is_looping: bool
) -> Environment:
    """Return an imported room with the wind of a file or folder; without one its air is still, and a warning says so.

    Raises:
        EnvironmentDataError: see `load_wind`.
    """
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


# One opening per connected group of cells, laid on the face of the grid that most of it touches.
def _openings_of(is_opening: NDArray[np.bool_], grid: Grid, inlet_face: str | None) -> tuple[Opening, ...]:
    left = is_opening.copy()
    openings: list[Opening] = []
    while left.any():
        group = reachable_cells(left, np.argwhere(left)[:1])
        left &= ~group
        face = _face_of(group)
        if face is not None:
            kind = "inlet" if face.name == inlet_face else "outlet"
            min_m, max_m = _rectangle(np.argwhere(group), grid, face)
            openings.append(Opening(name=f"{kind}_{len(openings)}", kind=kind, min_m=min_m, max_m=max_m))
    return tuple(openings)


def _face_of(group: NDArray[np.bool_]) -> Face | None:
    areas = {face: int(np.take(group, -1 if face.is_upper else 0, axis=face.axis).sum()) for face in FACES}
    face = max(areas, key=lambda face: areas[face])
    return face if areas[face] else None


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
