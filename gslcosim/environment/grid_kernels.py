# pyright: basic

"""Occupancy of cells, and kernels on a grid: flood fill, rays from border to border, wind at a point."""

import math
from collections.abc import Iterator, Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.cell_kernels import label_parts
from gslcosim.base.problems import Problem
from gslcosim.environment.model import LAYOUT_PATH, Box, Cell, EnvironmentGeometry, Grid, Opening, span_text
from gslcosim.environment.openings import FACES, Face, cells_at, voxelize

SOLID = 1


@numba.njit(cache=True, nogil=True)
def to_next_border(start, i, direction):
    """Return the length along a ray to the next cell border on one axis, and between two borders; infinite across it.

    Args:
        start: Coordinate of the ray's start along one axis [cells].
        i: Index of the cell that holds it.
        direction: Component of the ray's direction along that axis.

    Returns:
        Both lengths in units of the direction [cells].

    Held by:
        tests/unit/services/fields/test_sample_points.py, tests/unit/services/sensing/test_ray_kernels.py
        (walks that use it)
    """
    if direction > 0.0:
        return (i + 1.0 - start) / direction, 1.0 / direction
    if direction < 0.0:
        return (i - start) / direction, -1.0 / direction
    return np.inf, np.inf


@numba.njit(cache=True, nogil=True, inline="always")
def _first_crossing(start, i, step, direction):
    # Line parameter (0 at the start, 1 at the end) at the first cell border, and its increment between two borders.
    if step == 0:
        return np.inf, np.inf
    border = i + 1.0 if step > 0 else float(i)
    per_cell = 1.0 / direction
    return (border - start) * per_cell, abs(per_cell)


@numba.njit(cache=True, nogil=True)
def is_line_of_sight_free(occupancy, origin_m, cell_m, ax, ay, az, bx, by, bz):
    """Return whether no solid cell lies on the straight line between two points.

    The walk visits every cell on the line once, in order, by steps to the nearest of the next three cell borders.
    Cells hold their lower faces (as in `Grid.cell_of`).

    The cells of the two end points count too: nothing is visible from inside a solid cell. Outside the grid nothing
    blocks. A line exactly through an edge of the lattice touches one of the cells at that edge, so that no line slips
    between two solid cells with only an edge in common; which single cell it touches there is undefined. The result is
    bit-identical when the two points are swapped.

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


@numba.njit(cache=True, nogil=True, inline="always")
def _bracket(coordinate_m, origin_m, cell_m, n):
    # Index of the lower cell centre and weight of the upper one, clamped to the border.
    s = (coordinate_m - origin_m) / cell_m - 0.5
    if s <= 0.0:
        return 0, 0.0
    if s >= n - 1:
        return max(n - 2, 0), 1.0 if n > 1 else 0.0
    i = int(s)
    return i, s - i


@numba.njit(cache=True, nogil=True, inline="always")
def _blend(f, w, i, j, k, i1, j1, k1, axis):
    return (
        w[0] * f[i, j, k, axis] + w[1] * f[i1, j, k, axis] + w[2] * f[i, j1, k, axis] + w[3] * f[i1, j1, k, axis]
        + w[4] * f[i, j, k1, axis] + w[5] * f[i1, j, k1, axis] + w[6] * f[i, j1, k1, axis] + w[7] * f[i1, j1, k1, axis]
    )  # fmt: skip


@numba.njit(cache=True, nogil=True, inline="always")
def trilinear_wind(velocity_m_s, origin_m, cell_m, x_m, y_m, z_m):
    """Interpolate the wind at one point from the eight cell centres around it.

    Outside the outermost centres the border value holds (no extrapolation).

    Args:
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s], float32; index order ij.
        origin_m: (3,) or tuple, corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        x_m: Point, world frame [m].
        y_m: Point, world frame [m].
        z_m: Point, world frame [m].

    Returns:
        (u, v, w) wind, world frame [m/s], float64.

    Held by:
        tests/unit/environment/test_wind_kernels.py (exact for linear fields, box of three side lengths)
    """
    nx, ny, nz, _ = velocity_m_s.shape
    i, a = _bracket(x_m, origin_m[0], cell_m, nx)
    j, b = _bracket(y_m, origin_m[1], cell_m, ny)
    k, c = _bracket(z_m, origin_m[2], cell_m, nz)
    # Unsigned indices spare the test for negative ones.
    i1, j1, k1 = np.uint64(min(i + 1, nx - 1)), np.uint64(min(j + 1, ny - 1)), np.uint64(min(k + 1, nz - 1))
    i, j, k = np.uint64(i), np.uint64(j), np.uint64(k)
    weights = (
        (1.0 - a) * (1.0 - b) * (1.0 - c), a * (1.0 - b) * (1.0 - c), (1.0 - a) * b * (1.0 - c), a * b * (1.0 - c),
        (1.0 - a) * (1.0 - b) * c, a * (1.0 - b) * c, (1.0 - a) * b * c, a * b * c,
    )  # fmt: skip
    u = _blend(velocity_m_s, weights, i, j, k, i1, j1, k1, 0)
    v = _blend(velocity_m_s, weights, i, j, k, i1, j1, k1, 1)
    w = _blend(velocity_m_s, weights, i, j, k, i1, j1, k1, 2)
    return u, v, w


@numba.njit(cache=True, nogil=True)
def trilinear_wind_at_points(velocity_m_s, origin_m, cell_m, points_world_m):
    """Interpolate the wind at many points; see `trilinear_wind`.

    Args:
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s].
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        points_world_m: (n, 3) points, world frame, xyz [m].

    Returns:
        (n, 3) wind, world frame [m/s], float64.
    """
    wind = np.empty((points_world_m.shape[0], 3))
    for p in range(points_world_m.shape[0]):
        u, v, w = trilinear_wind(
            velocity_m_s, origin_m, cell_m, points_world_m[p, 0], points_world_m[p, 1], points_world_m[p, 2]
        )
        wind[p, 0] = u
        wind[p, 1] = v
        wind[p, 2] = w
    return wind


def reachable_cells(is_open: NDArray[np.bool_], seed_cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the open cells that are connected to seed cells through faces.

    Args:
        is_open: (nx, ny, nz) bool, cells that can be entered; index order ij.
        seed_cells: (n, 3) cell indices inside the grid; seeds that are not open are ignored.

    Returns:
        (nx, ny, nz) bool, True in the parts that hold a seed.
    """
    parts = label_parts(is_open, False)  # noqa: FBT003 - compiled functions take positional arguments only
    reached = np.unique(parts[tuple(seed_cells.T)])
    return np.isin(parts, reached[reached > 0])


def build_occupancy(boxes: Sequence[Box], openings: Sequence[Opening], grid: Grid) -> NDArray[np.uint8]:
    """Return the (nx, ny, nz) cells of a room: its boxes, sealed pockets filled, outlets marked.

    Air is connected with an opening through faces of cells. The rest becomes solid: no vehicle and no wind reaches it.
    """
    is_solid = voxelize(boxes, grid)
    is_air = find_reachable_cells(~is_solid, openings, grid)
    occupancy = np.where(is_air, np.uint8(Cell.FREE), np.uint8(Cell.SOLID))
    for opening in openings:
        if opening.kind != "inlet":
            layer = occupancy[cells_at(opening, grid)]
            layer[layer == Cell.FREE] = Cell.OUTLET
    return occupancy


def find_reachable_cells(is_open: NDArray[np.bool_], openings: Sequence[Opening], grid: Grid) -> NDArray[np.bool_]:
    """Return the open cells that are connected with an open cell at one of the openings."""
    is_seed = np.zeros(grid.shape, dtype=np.bool_)
    for opening in openings:
        is_seed[cells_at(opening, grid)] = True
    return reachable_cells(is_open, np.argwhere(is_seed & is_open))


def group_opening_cells(occupancy: NDArray[np.uint8]) -> Iterator[tuple[NDArray[np.bool_], Face | None]]:
    """Yield the cells of each opening with its face of the grid, None where it reaches no face.

    Connected cells of code 2 are one opening on each face where they lie flat: no deeper than the smaller side of
    their contact with the face. So a band around a corner is two openings, the open sides of outdoors are four, and
    their rims on floor and ceiling are none. Cells flat on no face belong to the face that most of them touch.

    Args:
        occupancy: (nx, ny, nz) of `Cell`.

    Yields:
        ((nx, ny, nz) True in the opening, its face).
    """
    left = occupancy == Cell.OUTLET
    while left.any():
        group = reachable_cells(left, np.argwhere(left)[:1])
        left &= ~group
        # GADEN's preprocessing marks only the hull of an opening; its depth includes the enclosed cells.
        is_filled = group | ~reachable_cells(~group, np.argwhere(occupancy == Cell.FREE))
        parts: list[tuple[NDArray[np.bool_], Face]] = []
        is_unexplained = group.copy()
        for face in FACES:
            layer = _from_face(group, face)[0]
            lines = _from_face(is_filled, face)
            depths = np.logical_and.accumulate(lines, axis=0).sum(axis=0)
            # A line through the whole grid is another side, seen from its edge.
            flat = np.sort(depths[layer & (depths < len(lines))])
            sides = np.ptp(np.argwhere(layer), axis=0) + 1 if len(flat) else (0, 0)
            if (
                len(flat)
                and flat[(len(flat) - 1) // 2] <= min(sides)
                and (layer & _from_face(is_unexplained, face)[0]).any()
            ):
                part = np.zeros_like(group)
                _from_face(part, face)[: flat[0], layer] = True
                parts.append((part & group, face))
                is_unexplained &= ~part
        if len(parts) > 1:
            yield from parts
            continue
        areas = {face: int(_from_face(group, face)[0].sum()) for face in FACES}
        face = parts[0][1] if parts else max(areas, key=lambda face: areas[face])
        yield group, face if areas[face] else None


# A view with the layers across a face first, from the face on inwards.
def _from_face(cells: NDArray[np.bool_], face: Face) -> NDArray[np.bool_]:
    return np.moveaxis(cells, face.axis, 0)[:: face.inward]


def find_air_cells(occupancy: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return the (nx, ny, nz) cells that air passes through: all that are not solid, and those that openings enclose.

    GADEN's preprocessing marks the hull of an opening and leaves the enclosed cells solid, so that all air would leave
    through the rim. Cells between those of an opening and its face are therefore air.

    Args:
        occupancy: (nx, ny, nz) of `Cell`.
    """
    is_air = occupancy != Cell.SOLID
    for group, face in group_opening_cells(occupancy):
        if face is not None:
            _from_face(is_air, face)[::-1] |= np.logical_or.accumulate(_from_face(group, face)[::-1], axis=0)
    return is_air


def find_occupancy_problems(room: EnvironmentGeometry) -> list[Problem]:
    """Return the obstructions of the air's way in, through and out; empty when there are none."""
    is_open = ~voxelize(room.boxes, room.grid)
    problems = [
        Problem(
            where=_path_to_blame(room),
            expected=f"air at the {opening.name}, {span_text(opening.min_m, opening.max_m)}",
            found="obstacles in front of all of it",
            remedy=f"Move the obstacles or the {opening.name}.",
        )
        for opening in room.openings
        if not is_open[cells_at(opening, room.grid)].any()
    ]
    if problems:
        return problems
    inlets = [opening for opening in room.openings if opening.kind == "inlet"]
    outlets = [opening for opening in room.openings if opening.kind != "inlet"]
    is_reached = find_reachable_cells(is_open, inlets, room.grid)
    if inlets and any(not is_reached[cells_at(outlet, room.grid)].any() for outlet in outlets):
        problems.append(
            Problem(
                where=_path_to_blame(room),
                expected="a way for the air from the inlet to the outlet, at least one cell wide",
                found=f"obstacles that divide the room; the inlet's part has {int(is_reached.sum())} of "
                f"{int(is_open.sum())} free cells",
                remedy="Leave a gap between the obstacles.",
            )
        )
    return problems


def _path_to_blame(room: EnvironmentGeometry) -> str:
    return f"{LAYOUT_PATH}.obstacles" if any(box.kind == "obstacle" for box in room.boxes) else LAYOUT_PATH
