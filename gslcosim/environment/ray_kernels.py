"""Rays through the cells of a grid, border after border; called by other kernels."""
# pyright: basic

import math

import numba
import numpy as np

SOLID = 1


@numba.njit(cache=True, nogil=True)
def to_next_border(start, i, direction):
    """Return the way along a ray to the border of the cell ahead, and that between two borders; infinity across it.

    Args:
        start: Coordinate of the ray's start along one axis [cells].
        i: Index of the cell that it lies in.
        direction: Component of the ray's direction along that axis.

    Returns:
        Both ways in lengths of the direction [cells].

    Held by:
        tests/unit/services/fields/concentration/test_sample_points.py, tests/unit/services/sensing/test_ray_kernels.py
        (walks that use it)
    """
    if direction > 0.0:
        return (i + 1.0 - start) / direction, 1.0 / direction
    if direction < 0.0:
        return (i - start) / direction, -1.0 / direction
    return np.inf, np.inf


@numba.njit(cache=True, nogil=True, inline="always")
def _first_crossing(start, i, step, direction):
    # Line parameter (0 at the start, 1 at the end) at the first cell border, and how much lies between two borders.
    if step == 0:
        return np.inf, np.inf
    border = i + 1.0 if step > 0 else float(i)
    per_cell = 1.0 / direction
    return (border - start) * per_cell, abs(per_cell)


@numba.njit(cache=True, nogil=True)
def is_line_of_sight_free(occupancy, origin_m, cell_m, ax, ay, az, bx, by, bz):
    """Return whether no solid cell lies on the straight line between two points.

    Every cell that the line passes through is visited once, in order, by stepping to the nearest of the next
    three cell borders. Cells hold their lower faces (as in `Grid.cell_of`).

    The cells that hold the two end points count too: from inside a solid cell nothing is seen.
    Outside the grid nothing blocks. A line that hits an edge of the grid's lattice exactly touches one of the
    cells beside the edge, so no line slips between two solid cells that share only an edge; whether it counts as
    touching a single cell there is left open. The answer is the same, to the bit, when the two points are swapped.

    Args:
        occupancy: (nx, ny, nz) uint8 of `gslcosim.environment.model.Cell`; only SOLID (1) blocks; index order ij.
        origin_m: (3,) or tuple, corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        ax: First point, world frame [m], finite.
        ay: First point, world frame [m].
        az: First point, world frame [m].
        bx: Second point, world frame [m], finite.
        by: Second point, world frame [m].
        bz: Second point, world frame [m].

    Returns:
        True when nothing blocks.

    Source:
        Amanatides and Woo 1987, A fast voxel traversal algorithm for ray tracing, Eurographics, section 2.
    Deviation:
        The number of steps is counted beforehand from the two end cells, so rounding cannot miss the last cell.
    Held by:
        tests/unit/environment/test_ray_kernels.py (against brute force in a box with three side lengths)
    """
    if ax > bx or (ax == bx and (ay > by or (ay == by and az > bz))):
        ax, ay, az, bx, by, bz = bx, by, bz, ax, ay, az
    nx, ny, nz = occupancy.shape
    sx = (ax - origin_m[0]) / cell_m
    sy = (ay - origin_m[1]) / cell_m
    sz = (az - origin_m[2]) / cell_m
    ex = (bx - origin_m[0]) / cell_m
    ey = (by - origin_m[1]) / cell_m
    ez = (bz - origin_m[2]) / cell_m
    i, j, k = math.floor(sx), math.floor(sy), math.floor(sz)
    i_end, j_end, k_end = math.floor(ex), math.floor(ey), math.floor(ez)
    # Both ends inside: all cells between are inside too, because the grid is convex.
    is_inside = 0 <= i < nx and 0 <= j < ny and 0 <= k < nz and 0 <= i_end < nx and 0 <= j_end < ny and 0 <= k_end < nz
    step_x = 1 if i_end > i else (-1 if i_end < i else 0)
    step_y = 1 if j_end > j else (-1 if j_end < j else 0)
    step_z = 1 if k_end > k else (-1 if k_end < k else 0)
    next_x, gap_x = _first_crossing(sx, i, step_x, ex - sx)
    next_y, gap_y = _first_crossing(sy, j, step_y, ey - sy)
    next_z, gap_z = _first_crossing(sz, k, step_z, ez - sz)
    n_steps = abs(i_end - i) + abs(j_end - j) + abs(k_end - k)
    for _ in range(n_steps + 1):
        if (is_inside or (0 <= i < nx and 0 <= j < ny and 0 <= k < nz)) and occupancy[i, j, k] == SOLID:
            return False
        if next_x <= next_y and next_x <= next_z:
            i += step_x
            next_x = next_x + gap_x if i != i_end else np.inf
        elif next_y <= next_z:
            j += step_y
            next_y = next_y + gap_y if j != j_end else np.inf
        else:
            k += step_z
            next_z = next_z + gap_z if k != k_end else np.inf
    return True
