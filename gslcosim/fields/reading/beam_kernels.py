"""How far a beam reaches until something solid reflects it."""
# pyright: basic

import math

import numba

from gslcosim.environment.sight_kernels import SOLID, to_next_border


@numba.njit(cache=True, nogil=True)
def distance_to_wall_m(occupancy, origin_m, cell_m, x, y, z, dx, dy, dz):
    """Return the way from a point along a unit vector to the first solid cell, or to the border of the grid [m].

    0 when the point is outside the grid or in a solid cell.

    Args:
        occupancy: (nx, ny, nz) uint8, 1 is solid; index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        x: Point, world frame [m]; y and z likewise.
        y: See x.
        z: See x.
        dx: Direction, world frame, of length 1; dy and dz likewise.
        dy: See dx.
        dz: See dx.

    Source:
        Amanatides and Woo 1987, A fast voxel traversal algorithm for ray tracing, Eurographics, section 2.
    Held by:
        tests/unit/fields/reading/test_beams.py (against small steps in a box with three side lengths)
    """
    nx, ny, nz = occupancy.shape
    sx, sy, sz = (x - origin_m[0]) / cell_m, (y - origin_m[1]) / cell_m, (z - origin_m[2]) / cell_m
    i, j, k = math.floor(sx), math.floor(sy), math.floor(sz)
    next_x, gap_x = to_next_border(sx, i, dx)
    next_y, gap_y = to_next_border(sy, j, dy)
    next_z, gap_z = to_next_border(sz, k, dz)
    way = 0.0
    while 0 <= i < nx and 0 <= j < ny and 0 <= k < nz and occupancy[i, j, k] != SOLID:
        way = min(next_x, next_y, next_z)
        if next_x <= next_y and next_x <= next_z:
            i += 1 if dx > 0.0 else -1
            next_x += gap_x
        elif next_y <= next_z:
            j += 1 if dy > 0.0 else -1
            next_y += gap_y
        else:
            k += 1 if dz > 0.0 else -1
            next_z += gap_z
    return way * cell_m
