"""Collision of filaments with walls: a displacement traced through the occupancy grid, never into a solid cell."""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
# pyright: basic

import math

import numba

from gslcosim.environment.ray_kernels import SOLID

FREE = 0
OUTLET = 2

# A traced point keeps this share of a cell's edge away from the cell's faces, so that rounding cannot move it across.
FACE_MARGIN = 1e-7


@numba.njit(cache=True, nogil=True)
def cell_index(coordinate_m, origin_m, cell_m):
    """Return the index of the cell that holds a coordinate, with the same rounding as `Grid.cell_of`."""
    return math.floor((coordinate_m - origin_m) / cell_m)


@numba.njit(cache=True, nogil=True)
def _clamped(coordinate_m, origin_m, cell_m, i):
    low = origin_m + (i + FACE_MARGIN) * cell_m
    high = origin_m + (i + 1.0 - FACE_MARGIN) * cell_m
    return min(max(coordinate_m, low), high)


@numba.njit(cache=True, nogil=True)
def _time_to_face(coordinate_m, displacement_m, origin_m, cell_m, i):
    # Share of the displacement after which the coordinate reaches the face ahead of it.
    if displacement_m > 0.0:
        return max(0.0, (origin_m + (i + 1) * cell_m - coordinate_m) / displacement_m)
    if displacement_m < 0.0:
        return max(0.0, (origin_m + i * cell_m - coordinate_m) / displacement_m)
    return math.inf


@numba.njit(cache=True, nogil=True)
def _after_wall(displacement_m, reflects):
    return -displacement_m if reflects else 0.0


@numba.njit(cache=True, nogil=True)
def trace_displacement(occupancy, origin_m, cell_m, x, y, z, dx, dy, dz, reflects):
    """Move a point through the grid cell by cell, along or off the walls that it meets.

    At a wall (a solid cell, or the border of the grid) the component of the remaining displacement that points into
    it is dropped (the point slides) or changes its sign (the point is reflected). Entering an outlet cell, or meeting
    a wall from within one, ends the point.

    Args:
        occupancy: (nx, ny, nz) uint8, 0 free, 1 solid, 2 outlet; index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        x: Start, world frame [m]; in a cell that is not solid.
        y: Start, world frame [m].
        z: Start, world frame [m].
        dx: Displacement, world frame [m]; of any length.
        dy: Displacement, world frame [m].
        dz: Displacement, world frame [m].
        reflects: Whether walls reflect; otherwise the point slides along them.

    Returns:
        (x, y, z, ended): where the displacement ends, world frame [m], strictly inside a cell that is not solid;
        `ended` when the point left through an outlet.

    Source:
        Cell traversal after Amanatides and Woo 1987, A fast voxel traversal algorithm for ray tracing; the wall rules
        are ours. Reflection keeps a well mixed gas well mixed, where sliding would gather it at the wall.
    Held by:
        tests/properties/test_gas_blocking.py, tests/unit/services/fields/filament/test_wall_collision.py
    """
    nx, ny, nz = occupancy.shape
    ox, oy, oz = origin_m[0], origin_m[1], origin_m[2]
    i, j, k = cell_index(x, ox, cell_m), cell_index(y, oy, cell_m), cell_index(z, oz, cell_m)
    while True:
        tx = _time_to_face(x, dx, ox, cell_m, i)
        ty = _time_to_face(y, dy, oy, cell_m, j)
        tz = _time_to_face(z, dz, oz, cell_m, k)
        t = min(tx, ty, tz)
        if t >= 1.0:
            x = _clamped(x + dx, ox, cell_m, i)
            y = _clamped(y + dy, oy, cell_m, j)
            z = _clamped(z + dz, oz, cell_m, k)
            return x, y, z, False
        x += t * dx
        y += t * dy
        z += t * dz
        rest = 1.0 - t
        dx *= rest
        dy *= rest
        dz *= rest
        ni, nj, nk = i, j, k
        if tx == t:
            ni = i + 1 if dx > 0.0 else i - 1
        elif ty == t:
            nj = j + 1 if dy > 0.0 else j - 1
        else:
            nk = k + 1 if dz > 0.0 else k - 1
        is_inside = 0 <= ni < nx and 0 <= nj < ny and 0 <= nk < nz
        if is_inside and occupancy[ni, nj, nk] == OUTLET:
            return x, y, z, True
        if is_inside and occupancy[ni, nj, nk] != SOLID:
            i, j, k = ni, nj, nk
        elif occupancy[i, j, k] == OUTLET:
            return x, y, z, True
        elif tx == t:
            dx = _after_wall(dx, reflects)
        elif ty == t:
            dy = _after_wall(dy, reflects)
        else:
            dz = _after_wall(dz, reflects)


@numba.njit(cache=True, nogil=True)
def is_step_in_free_air(occupancy, i0, j0, k0, i1, j1, k1):
    """Return whether all cells of the smallest box around two cells are free; false when they are not neighbours.

    Args:
        occupancy: (nx, ny, nz) uint8, 0 free.
        i0: First cell, inside the grid (j0, k0 likewise).
        j0: See i0.
        k0: See i0.
        i1: Second cell, anywhere (j1, k1 likewise).
        j1: See i1.
        k1: See i1.
    """
    nx, ny, nz = occupancy.shape
    if abs(i1 - i0) > 1 or abs(j1 - j0) > 1 or abs(k1 - k0) > 1:
        return False
    if not (0 <= i1 < nx and 0 <= j1 < ny and 0 <= k1 < nz):
        return False
    for i in range(min(i0, i1), max(i0, i1) + 1):
        for j in range(min(j0, j1), max(j0, j1) + 1):
            for k in range(min(k0, k1), max(k0, k1) + 1):
                if occupancy[i, j, k] != FREE:
                    return False
    return True
