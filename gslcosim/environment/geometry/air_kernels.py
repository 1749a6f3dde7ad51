"""Flood fills over cells with blocked borders: free cells, the air that the rest belongs to, and narrow passages."""
# pyright: basic

import numba
import numpy as np

from gslcosim.environment.geometry.triangle_kernels import BORDER, CROSSED, TOUCHED

AIR, OTHER = 1, 2
_NEW_AIR, _NEW_OTHER = 3, 4


@numba.njit(cache=True, nogil=True)
def _shape_and_strides(marks):
    shape = np.array(marks.shape)
    return shape, np.array((shape[1] * shape[2], shape[2], 1))


@numba.njit(cache=True, nogil=True)
def _step(shape, strides, cell, side):
    # The neighbour on one of six sides as flat index (-1: outside), the lower of both, and the axis.
    axis = side // 2
    coordinate = (cell // strides[axis]) % shape[axis]
    if side % 2 == 0:
        if coordinate + 1 == shape[axis]:
            return -1, cell, axis
        return cell + strides[axis], cell, axis
    if coordinate == 0:
        return -1, cell, axis
    return cell - strides[axis], cell - strides[axis], axis


@numba.njit(cache=True, nogil=True)
def flood_untouched(marks, seeds):
    """Return the cells that no surface touches and that are connected with seeds through borders none lies on.

    A hole lets the flood pass only where it is as large as the whole face of a cell.

    Args:
        marks: (nx, ny, nz) uint8 of `triangle_kernels`, C order.
        seeds: (n,) int64 flat cell indices; touched ones are passed over.

    Returns:
        (nx, ny, nz) bool.

    Held by:
        tests/unit/environment/geometry/test_air_kernels.py
    """
    shape, strides = _shape_and_strides(marks)
    flat = marks.reshape(-1)
    is_reached = np.zeros(flat.size, np.bool_)
    stack = np.empty(flat.size, np.int64)
    n = 0
    for seed in seeds:
        if not is_reached[seed] and not flat[seed] & TOUCHED:
            is_reached[seed] = True
            stack[n] = seed
            n += 1
    while n > 0:
        n -= 1
        cell = stack[n]
        for side in range(6):
            other, lower, axis = _step(shape, strides, cell, side)
            if other < 0 or is_reached[other] or flat[other] & TOUCHED or flat[lower] & (BORDER << axis):
                continue
            is_reached[other] = True
            stack[n] = other
            n += 1
    return is_reached.reshape(marks.shape)


@numba.njit(cache=True, nogil=True)
def assign_touched_cells(marks, is_air):
    """Return which cells are air, those included that a surface touches but whose centre lies in the air.

    Touched cells go to the nearer, in steps between centres that no surface crosses: the air, or any other untouched
    cell, which is the outside or the inside of a body. What both reach with equally many steps is not air: there the
    surface has a hole smaller than a cell.

    Args:
        marks: (nx, ny, nz) uint8 of `triangle_kernels`, C order.
        is_air: (nx, ny, nz) bool, the untouched cells that are air.

    Returns:
        (nx, ny, nz) bool.

    Held by:
        tests/unit/environment/geometry/test_air_kernels.py
    """
    shape, strides = _shape_and_strides(marks)
    flat, was_air = marks.reshape(-1), is_air.reshape(-1)
    label = np.zeros(flat.size, np.uint8)
    front = np.empty(flat.size, np.int64)
    n_front = 0
    for cell in range(flat.size):
        if was_air[cell] or not flat[cell] & TOUCHED:
            label[cell] = AIR if was_air[cell] else OTHER
            front[n_front] = cell
            n_front += 1
    start = 0
    while start < n_front:
        end = n_front
        for place in range(start, end):
            cell = front[place]
            fresh = _NEW_AIR if label[cell] == AIR else _NEW_OTHER
            for side in range(6):
                other, lower, axis = _step(shape, strides, cell, side)
                if other < 0 or flat[lower] & (CROSSED << axis):
                    continue
                if label[other] == 0:
                    label[other] = fresh
                    front[n_front] = other
                    n_front += 1
                elif label[other] == _NEW_AIR and fresh == _NEW_OTHER:
                    label[other] = _NEW_OTHER
        for place in range(end, n_front):
            label[front[place]] = AIR if label[front[place]] == _NEW_AIR else OTHER
        start = end
    return (label == AIR).reshape(marks.shape)


@numba.njit(cache=True, nogil=True)
def clearances(marks, is_reached, n_most):
    """Return how many steps each reached cell is away from a surface, at most `n_most`; 0 where it was not reached."""
    shape, strides = _shape_and_strides(marks)
    flat, reached = marks.reshape(-1), is_reached.reshape(-1)
    steps = np.zeros(flat.size, np.uint8)
    front = np.empty(flat.size, np.int64)
    n_front = 0
    for cell in range(flat.size):
        if not reached[cell]:
            continue
        for side in range(6):
            other, lower, axis = _step(shape, strides, cell, side)
            if other >= 0 and (not reached[other] or flat[lower] & (BORDER << axis)):
                steps[cell] = 1
                front[n_front] = cell
                n_front += 1
                break
    place = 0
    while place < n_front:
        cell = front[place]
        place += 1
        if steps[cell] >= n_most:
            continue
        for side in range(6):
            other, lower, axis = _step(shape, strides, cell, side)
            if other >= 0 and reached[other] and steps[other] == 0 and not flat[lower] & (BORDER << axis):
                steps[other] = steps[cell] + 1
                front[n_front] = other
                n_front += 1
    for cell in range(flat.size):
        if reached[cell] and steps[cell] == 0:
            steps[cell] = n_most
    return steps.reshape(marks.shape)


@numba.njit(cache=True, nogil=True)
def split_at_narrows(marks, clearance, seed):
    """Return which reached cells belong to the seed and which to the outside, divided where the way is narrowest.

    A watershed on the clearance: the widest cells next to either side are taken first, so both sides meet in the
    holes between them.

    Args:
        marks: (nx, ny, nz) uint8 of `triangle_kernels`, C order.
        clearance: (nx, ny, nz) uint8 of `clearances`; 0 is not reached.
        seed: flat index of a reached cell; the outside starts at all reached cells of the grid's border.

    Returns:
        (nx, ny, nz) uint8: 1 the seed's, 2 the outside's, 0 neither.

    Held by:
        tests/unit/environment/geometry/test_solid_geometry.py
    """
    shape, strides = _shape_and_strides(marks)
    flat, width = marks.reshape(-1), clearance.reshape(-1)
    label = np.zeros(flat.size, np.uint8)
    n_levels = int(width.max()) + 1
    # A list for each clearance, linked from cell to cell: first in, last out.
    top, below = np.full(n_levels, -1, np.int64), np.full(flat.size, -1, np.int64)
    for cell in range(flat.size):
        if width[cell] == 0:
            continue
        is_border = False
        for axis in range(3):
            coordinate = (cell // strides[axis]) % shape[axis]
            is_border |= coordinate == 0 or coordinate == shape[axis] - 1
        if is_border or cell == seed:
            label[cell] = 1 if cell == seed else 2
            below[cell] = top[width[cell]]
            top[width[cell]] = cell
    level = n_levels - 1
    while level > 0:
        cell = top[level]
        if cell < 0:
            level -= 1
            continue
        top[level] = below[cell]
        for side in range(6):
            other, lower, axis = _step(shape, strides, cell, side)
            if other < 0 or width[other] == 0 or label[other] != 0 or flat[lower] & (BORDER << axis):
                continue
            label[other] = label[cell]
            # A wider cell behind a narrow one is the next to be taken.
            below[other] = top[width[other]]
            top[width[other]] = other
            level = max(level, int(width[other]))
    return label.reshape(marks.shape)
