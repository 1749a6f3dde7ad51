# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Wind beside walls: no wind through them, also between the centres of cells."""

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim.environment.model import Cell, EnvironmentGeometry
from gslcosim.environment.openings import FACES, cells_at, find_face


def find_wall_faces(room: EnvironmentGeometry) -> NDArray[np.uint8]:
    """Return which faces of each cell are walls, (nx, ny, nz): a bit for each of `FACES`; none in solids."""
    solid = room.occupancy == Cell.SOLID
    found = np.zeros(solid.shape, np.uint8)
    for bit, face in enumerate(FACES):
        is_wall = np.roll(solid, -1 if face.is_upper else 1, face.axis)
        outermost = -1 if face.is_upper else 0
        np.moveaxis(is_wall, face.axis, 0)[outermost] = (
            np.moveaxis(room.occupancy, face.axis, 0)[outermost] != Cell.OUTLET
        )
        for opening in room.openings:
            if find_face(opening, room.grid) == face:
                is_wall[cells_at(opening, room.grid)] = False
        found |= is_wall.astype(np.uint8) << bit
    found[solid] = 0
    return found


@numba.njit(cache=True, nogil=True, inline="always")
def _share_through(low, high, is_first, is_last, t):
    # Of the wind between centres along its axis: from all of it at a centre to nothing at a wall. Beside a border of
    # the grid that wind is the centre's, beside a solid half of it is left at the wall, as solids have none.
    if t < 0.5:
        return (2.0 * t if is_first else 2.0 * t / (0.5 + t)) if low else 1.0
    return (2.0 * (1.0 - t) if is_last else 2.0 * (1.0 - t) / (1.5 - t)) if high else 1.0


@numba.njit(cache=True, nogil=True, inline="always")
def wind_beside_walls(velocity_m_s, wall_faces, origin_m, cell_m, x, y, z):
    """Return the wind at a point of a room, `trilinear_wind` without what would blow through walls.

    Without it tracers that fill a room gather where the wind turns at a wall: within half a cell it has divergence.

    Args:
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame, zero in solids [m/s].
        wall_faces: Of `find_wall_faces`.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        x, y, z: Point, world frame [m], in the grid.

    Held by:
        tests/unit/services/fields/turbulence/test_wall_faces.py
    """
    u, v, w = trilinear_wind(velocity_m_s, origin_m, cell_m, x, y, z)
    nx, ny, nz = wall_faces.shape
    per_m = 1.0 / cell_m
    sx, sy, sz = (x - origin_m[0]) * per_m, (y - origin_m[1]) * per_m, (z - origin_m[2]) * per_m
    i, j, k = min(max(np.int64(sx), 0), nx - 1), min(max(np.int64(sy), 0), ny - 1), min(max(np.int64(sz), 0), nz - 1)
    walls = wall_faces[i, j, k]
    if walls != 0:
        u *= _share_through(walls & 1, walls & 2, i == 0, i == nx - 1, sx - i)
        v *= _share_through(walls & 4, walls & 8, j == 0, j == ny - 1, sy - j)
        w *= _share_through(walls & 16, walls & 32, k == 0, k == nz - 1, sz - k)
    return u, v, w
