# pyright: basic
"""Kernels of a geometry's cells: which ones triangles touch, and flood fills between blocked borders."""

import numba
import numpy as np

# What is closer to a border than this share of a cell lies on it: coordinates of files have single precision.
EPS = 1e-3
# Lines between cell centres are moved by these shares of a cell, so that a surface exactly on a centre has a side (a
# centre on the lower face of a body lies in it) and the lines meet neither edges nor diagonals of aligned faces.
SHIFT = np.array((5.1e-4, 3.7e-4, 4.3e-4))

# Bits of a cell: touched by a surface; border to the next cell along x, y, z touched; line to the next centre crossed.
TOUCHED, BORDER, CROSSED = 1, 2, 16
AIR, OTHER = 1, 2
_NEW_AIR, _NEW_OTHER = 3, 4


@numba.njit(cache=True, nogil=True)
def is_overlapping(corners, centre, half):
    """Return whether a triangle and an axis-aligned box share a point.

    Separating axes: the three of the box, the triangle's normal, and the nine products of their edges.

    Args:
        corners: (3, 3) the triangle's corners, xyz.
        centre: (3,) the box's centre, in the same unit.
        half: (3,) half the box's sides.

    Source:
        Akenine-Möller 2001, "Fast 3D triangle-box overlap testing", doi:10.1080/10867651.2001.10487535.

    Held by:
        extensions/formats/tests/unit/geometry/test_triangle_kernels.py
    """
    ax, ay, az = corners[0, 0] - centre[0], corners[0, 1] - centre[1], corners[0, 2] - centre[2]
    bx, by, bz = corners[1, 0] - centre[0], corners[1, 1] - centre[1], corners[1, 2] - centre[2]
    cx, cy, cz = corners[2, 0] - centre[0], corners[2, 1] - centre[1], corners[2, 2] - centre[2]
    hx, hy, hz = half[0], half[1], half[2]
    if min(ax, bx, cx) > hx or max(ax, bx, cx) < -hx:
        return False
    if min(ay, by, cy) > hy or max(ay, by, cy) < -hy:
        return False
    if min(az, bz, cz) > hz or max(az, bz, cz) < -hz:
        return False
    for edge in range(3):
        if edge == 0:
            ex, ey, ez = bx - ax, by - ay, bz - az
        elif edge == 1:
            ex, ey, ez = cx - bx, cy - by, cz - bz
        else:
            ex, ey, ez = ax - cx, ay - cy, az - cz
        p, q, r = az * ey - ay * ez, bz * ey - by * ez, cz * ey - cy * ez
        reach = abs(ez) * hy + abs(ey) * hz
        if min(p, q, r) > reach or max(p, q, r) < -reach:
            return False
        p, q, r = ax * ez - az * ex, bx * ez - bz * ex, cx * ez - cz * ex
        reach = abs(ez) * hx + abs(ex) * hz
        if min(p, q, r) > reach or max(p, q, r) < -reach:
            return False
        p, q, r = ay * ex - ax * ey, by * ex - bx * ey, cy * ex - cx * ey
        reach = abs(ey) * hx + abs(ex) * hy
        if min(p, q, r) > reach or max(p, q, r) < -reach:
            return False
    nx = (by - ay) * (cz - az) - (bz - az) * (cy - ay)
    ny = (bz - az) * (cx - ax) - (bx - ax) * (cz - az)
    nz = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    distance = nx * ax + ny * ay + nz * az
    return abs(distance) <= abs(nx) * hx + abs(ny) * hy + abs(nz) * hz


@numba.njit(cache=True, nogil=True)
def _normal(corners):
    a, b = corners[1] - corners[0], corners[2] - corners[0]
    normal = np.empty(3)
    normal[0] = a[1] * b[2] - a[2] * b[1]
    normal[1] = a[2] * b[0] - a[0] * b[2]
    normal[2] = a[0] * b[1] - a[1] * b[0]
    return normal


@numba.njit(cache=True, nogil=True)
def _extent(corners, axis):
    low = min(corners[0, axis], corners[1, axis], corners[2, axis])
    return low, max(corners[0, axis], corners[1, axis], corners[2, axis])


@numba.njit(cache=True, nogil=True)
def mark_touched_inplace(marks, triangles):
    """Mark the cells whose inside a triangle touches, and the borders between cells that one lies on.

    A cell counts without the outermost thousandth, so a surface on a border of cells touches none of the two, only
    the border: walls on the grid's planes do not thicken to either side.

    Args:
        marks: (nx, ny, nz) uint8, bit `TOUCHED` of cells and bits `BORDER << axis` of the border to the next cell are
            set; index order ij.
        triangles: (n, 3, 3) corners, xyz, in cells from the grid's lower corner; triangles without area left out.

    Held by:
        extensions/formats/tests/unit/geometry/test_triangle_kernels.py
    """
    for t in range(triangles.shape[0]):
        corners = triangles[t]
        normal = _normal(corners)
        _mark_cells(marks, corners, normal)
        for axis in range(3):
            _mark_borders(marks, corners, normal, axis)


# Goes over the columns along the normal's main axis; in each only the few cells that the plane passes are tested.
@numba.njit(cache=True, nogil=True)
def _mark_cells(marks, corners, normal):
    main = np.argmax(np.abs(normal))
    a, b = (main + 1) % 3, (main + 2) % 3
    shape = marks.shape
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for axis in range(3):
        least, most = _extent(corners, axis)
        low[axis] = max(0, int(np.floor(least - EPS)))
        high[axis] = min(shape[axis] - 1, int(np.floor(most + EPS)))
    half = np.full(3, 0.5 - EPS)
    cell, centre = np.empty(3, np.int64), np.empty(3)
    slope = 0.5 * (abs(normal[a]) + abs(normal[b])) / abs(normal[main])
    for i in range(low[a], high[a] + 1):
        for j in range(low[b], high[b] + 1):
            middle = (
                corners[0, main]
                - (normal[a] * (i + 0.5 - corners[0, a]) + normal[b] * (j + 0.5 - corners[0, b])) / normal[main]
            )
            first = max(low[main], int(np.floor(middle - slope - EPS)))
            last = min(high[main], int(np.floor(middle + slope + EPS)))
            for k in range(first, last + 1):
                cell[a], cell[b], cell[main] = i, j, k
                if marks[cell[0], cell[1], cell[2]] & TOUCHED:
                    continue
                centre[a], centre[b], centre[main] = i + 0.5, j + 0.5, k + 0.5
                if is_overlapping(corners, centre, half):
                    marks[cell[0], cell[1], cell[2]] |= TOUCHED


# A large triangle that is not along the border touches the cells on one side of it anyway.
@numba.njit(cache=True, nogil=True)
def _mark_borders(marks, corners, normal, axis):
    low, high = _extent(corners, axis)
    slope = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2) - abs(normal[axis])
    if high - low > 1.0 and slope > 1e-2 * abs(normal[axis]):
        return
    a, b = (axis + 1) % 3, (axis + 2) % 3
    (low_a, high_a), (low_b, high_b) = _extent(corners, a), _extent(corners, b)
    half, centre, cell = np.full(3, 0.5 - EPS), np.empty(3), np.empty(3, np.int64)
    half[axis] = EPS
    shape = marks.shape
    for k in range(max(1, int(np.ceil(low - EPS))), min(shape[axis] - 1, int(np.floor(high + EPS))) + 1):
        for i in range(max(0, int(np.floor(low_a))), min(shape[a] - 1, int(np.floor(high_a))) + 1):
            for j in range(max(0, int(np.floor(low_b))), min(shape[b] - 1, int(np.floor(high_b))) + 1):
                centre[axis], centre[a], centre[b] = k, i + 0.5, j + 0.5
                if is_overlapping(corners, centre, half):
                    cell[axis], cell[a], cell[b] = k - 1, i, j
                    marks[cell[0], cell[1], cell[2]] |= np.uint8(BORDER << axis)


@numba.njit(cache=True, nogil=True)
def find_crossings(triangles, shape, links, owners, places):
    """Find where triangles cross the lines between centres of neighbouring cells; return how many crossings there are.

    Args:
        triangles: (n, 3, 3) corners, xyz, in cells from the grid's lower corner.
        shape: (3,) int64, the grid's cells.
        links: (m,) int64, is filled with axis * n_cells + the flat index of the lower cell; empty: only count.
        owners: (m,) int64, is filled with the triangles' indices.
        places: (m,) float64, is filled with the coordinate along the axis, in cells.

    Held by:
        extensions/formats/tests/unit/geometry/test_triangle_kernels.py
    """
    n_cells = shape[0] * shape[1] * shape[2]
    n_found = 0
    for t in range(triangles.shape[0]):
        corners = triangles[t]
        normal = _normal(corners)
        size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        for axis in range(3):
            if abs(normal[axis]) < 1e-9 * size:
                continue
            a, b = (axis + 1) % 3, (axis + 2) % 3
            (low_a, high_a), (low_b, high_b) = _extent(corners, a), _extent(corners, b)
            first_a = max(0, int(np.ceil(low_a - 0.5 - SHIFT[a])))
            last_a = min(shape[a] - 1, int(np.floor(high_a - 0.5 - SHIFT[a])))
            first_b = max(0, int(np.ceil(low_b - 0.5 - SHIFT[b])))
            last_b = min(shape[b] - 1, int(np.floor(high_b - 0.5 - SHIFT[b])))
            for i in range(first_a, last_a + 1):
                u = i + 0.5 + SHIFT[a]
                for j in range(first_b, last_b + 1):
                    v = j + 0.5 + SHIFT[b]
                    if not _is_inside(corners, a, b, u, v):
                        continue
                    place = (
                        corners[0, axis]
                        - (normal[a] * (u - corners[0, a]) + normal[b] * (v - corners[0, b])) / normal[axis]
                    )
                    k = int(np.floor(place - 0.5 - SHIFT[axis]))
                    if k < 0 or k > shape[axis] - 2:
                        continue
                    if links.shape[0] > 0:
                        cell = np.empty(3, np.int64)
                        cell[axis], cell[a], cell[b] = k, i, j
                        links[n_found] = axis * n_cells + (cell[0] * shape[1] + cell[1]) * shape[2] + cell[2]
                        owners[n_found] = t
                        places[n_found] = place
                    n_found += 1
    return n_found


# Edges count, so that no line slips through between two triangles.
@numba.njit(cache=True, nogil=True)
def _is_inside(corners, a, b, u, v):
    n_left = n_right = 0
    for edge in range(3):
        pu, pv = corners[edge, a], corners[edge, b]
        qu, qv = corners[(edge + 1) % 3, a], corners[(edge + 1) % 3, b]
        side = (qu - pu) * (v - pv) - (qv - pv) * (u - pu)
        tolerance = 1e-12 * (abs(qu - pu) + abs(qv - pv))
        n_left += side > tolerance
        n_right += side < -tolerance
    return n_left == 0 or n_right == 0


@numba.njit(cache=True, nogil=True)
def join_inplace(roots, first, second):
    """Join things in pairs; afterwards `roots` holds, for each thing, the same number for all that are joined.

    Args:
        roots: (n,) int64, 0 to n - 1; is changed.
        first: (m,) int64, one thing of each pair.
        second: (m,) int64, the other.

    Held by:
        extensions/formats/tests/unit/geometry/test_surfaces.py
    """
    for pair in range(first.shape[0]):
        a, b = _root(roots, first[pair]), _root(roots, second[pair])
        roots[max(a, b)] = min(a, b)
    for thing in range(roots.shape[0]):
        roots[thing] = _root(roots, thing)


@numba.njit(cache=True, nogil=True)
def _root(roots, thing):
    while roots[thing] != thing:
        roots[thing] = roots[roots[thing]]
        thing = roots[thing]
    return thing


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
        extensions/formats/tests/unit/geometry/test_air_kernels.py
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
        extensions/formats/tests/unit/geometry/test_air_kernels.py
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
        extensions/formats/tests/unit/geometry/test_solid_geometry.py
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
