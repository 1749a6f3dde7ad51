"""Surfaces of a geometry as triangles on a grid, the bodies they make, the cells of air between, and leaks."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.problems import Problem
from gslcosim.environment.model import Grid, point_text
from gslcosim_formats.geometry.cell_kernels import (
    BORDER,
    CROSSED,
    EPS,
    assign_touched_cells,
    clearances,
    find_crossings,
    flood_untouched,
    join_inplace,
    mark_touched_inplace,
    split_at_narrows,
)
from gslcosim_formats.geometry.mesh_formats import Part

# Corners closer than this are one: coordinates of files have single precision [m].
SAME_M = 1e-5
Cells = NDArray[np.bool_]
MAX_SHOWN = 3
_MOST_STEPS = 200


@dataclass(frozen=True, kw_only=True)
class Surfaces:
    """Triangles of a geometry, world frame [m].

    `corners_m` is (n, 3, 3): triangle, corner, xyz. `part` (n,) is the index into `names`, -1 where an opening is
    drawn. `body` (n,) numbers what hangs together through edges of two triangles within a part. `closed` has one
    entry for each body: whether two of its triangles meet at each of its edges.
    """

    corners_m: NDArray[np.float64]
    part: NDArray[np.int32]
    body: NDArray[np.int32]
    closed: NDArray[np.bool_]
    names: tuple[str, ...]

    def is_opening(self, triangles: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of the triangles, given by index, belong to openings."""
        return self.part[triangles] < 0


def build_surfaces(parts: Sequence[Part], opening_corners_m: NDArray[np.float64]) -> Surfaces:
    """Return the triangles of all parts and openings; those without area and doubles within a part are left out.

    Args:
        parts: Walls, furniture and whatever else is solid.
        opening_corners_m: (n, 3, 3) triangles of openings.
    """
    corners: list[NDArray[np.float64]] = []
    bodies: list[NDArray[np.int32]] = []
    closed: list[NDArray[np.bool_]] = []
    n_bodies = 0
    for part in parts:
        faces = part.faces[_areas_m2(part.vertices_m[part.faces]) > 0]
        merged = _merged(part.vertices_m)[faces]
        is_kept = _first_of_doubles(merged)
        body, is_closed = _bodies_of(merged[is_kept])
        corners.append(part.vertices_m[faces[is_kept]])
        bodies.append(body + np.int32(n_bodies))
        closed.append(is_closed)
        n_bodies += len(is_closed)
    counts = [len(part_corners) for part_corners in corners]
    opening_corners_m = opening_corners_m[_areas_m2(opening_corners_m) > 0]
    n_openings = len(opening_corners_m)
    return Surfaces(
        corners_m=np.concatenate((*corners, opening_corners_m)),
        part=np.concatenate((np.repeat(np.arange(len(parts)), counts), np.full(n_openings, -1))).astype(np.int32),
        body=np.concatenate((*bodies, np.full(n_openings, n_bodies))).astype(np.int32),
        closed=np.concatenate((*closed, np.zeros(1, np.bool_))),
        names=tuple(part.name for part in parts),
    )


# Of triangles between the same corners, whichever way they turn, the first.
def _first_of_doubles(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    a, b, c = np.sort(faces, axis=1).T
    order, is_first = _in_groups(a, b, c)
    is_kept = np.empty(len(faces), np.bool_)
    is_kept[order] = is_first
    return is_kept


# The order by several keys, equal ones as they were, and where in that order a new combination of them begins.
def _in_groups(*keys: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    lows = [key.min(initial=0) for key in keys]
    sides = [int(key.max(initial=0) - low) + 1 for key, low in zip(keys, lows, strict=True)]
    # As one number they are sorted four times as fast as one after the other.
    if math.prod(sides) < 2**62:
        offsets = tuple(key - low for key, low in zip(keys, lows, strict=True))
        keys = (np.asarray(np.ravel_multi_index(offsets, sides)),)
    order = np.lexsort(keys[::-1])
    is_first = np.zeros(len(order), np.bool_)
    is_first[:1] = True
    for key in keys:
        is_first[1:] |= np.diff(key[order]) != 0
    return order, is_first


# Zero where the triangle is thinner than a nanometre.
def _areas_m2(corners_m: NDArray[np.float64]) -> NDArray[np.float64]:
    edges_m = np.roll(corners_m, -1, axis=1) - corners_m
    areas_m2 = np.linalg.norm(np.cross(edges_m[:, 0], edges_m[:, 1]), axis=1) / 2
    longest_m = np.linalg.norm(edges_m, axis=2).max(axis=1, initial=0.0)
    return np.where(areas_m2 > 1e-9 * longest_m, areas_m2, 0.0)


# The number of each vertex when those at one place are one.
def _merged(vertices_m: NDArray[np.float64]) -> NDArray[np.int64]:
    cells = np.round(vertices_m / SAME_M).astype(np.int64)
    order, is_first = _in_groups(*cells.T[::-1])
    merged = np.empty(len(cells), dtype=np.int64)
    merged[order] = np.cumsum(is_first) - 1
    return merged


def _bodies_of(faces: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    edges = np.sort(np.stack((faces, np.roll(faces, -1, axis=1)), axis=2).reshape(-1, 2), axis=1)
    keys = edges[:, 0] * (faces.max(initial=0) + 1) + edges[:, 1]
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    lengths = np.diff(starts, append=len(order))
    pairs = starts[lengths == 2]
    owner = order // 3
    roots = np.arange(len(faces))
    join_inplace(roots, owner[pairs], owner[pairs + 1])
    _, body = np.unique(roots, return_inverse=True)
    closed = np.ones(int(body.max(initial=-1)) + 1, dtype=np.bool_)
    # Bodies that touch share edges: of each edge, a body's own triangles count.
    owners = np.repeat(body, 3)
    order, is_first = _in_groups(keys, owners)
    starts = np.flatnonzero(is_first)
    n_triangles = np.diff(starts, append=len(order))
    closed[owners[order[starts[n_triangles != 2]]]] = False
    return body.astype(np.int32), closed


@dataclass(frozen=True, kw_only=True)
class Crossings:
    """Crossings of surfaces with the lines between centres of neighbouring cells, ordered by line, body, and place.

    `link` is axis * n_cells + the flat index of the lower cell, `triangle` the index of what crosses it, `place` where
    on the axis, in cells from the grid's lower corner.
    """

    link: NDArray[np.int64]
    triangle: NDArray[np.int64]
    place: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SurfaceVoxels:
    """Surfaces on a grid. `marks` is (nx, ny, nz) uint8 with the bits of `triangle_kernels`."""

    grid: Grid
    surfaces: Surfaces
    marks: NDArray[np.uint8]
    crossings: Crossings


def voxelize_surfaces(surfaces: Surfaces, grid: Grid) -> SurfaceVoxels:
    """Return which cells the surfaces touch and which lines between cells they cross."""
    triangles = (surfaces.corners_m - grid.origin_m) / grid.cell_m
    marks = np.zeros(grid.shape, dtype=np.uint8)
    mark_touched_inplace(marks, triangles)
    crossings = _crossings_of(surfaces, triangles, grid)
    axis, cell = np.divmod(np.unique(crossings.link), marks.size)
    np.bitwise_or.at(marks.reshape(-1), cell, (CROSSED << axis).astype(np.uint8))
    return SurfaceVoxels(grid=grid, surfaces=surfaces, marks=marks, crossings=crossings)


def find_certain_air(voxels: SurfaceVoxels, cells: NDArray[np.int64]) -> Cells:
    """Return the cells that no surface touches and that the air of (n, 3) cells reaches, through whole faces of cells.

    Cells that a surface touches, or outside the grid, are passed over.
    """
    cells = cells[voxels.grid.contains_cell(cells)]
    return flood_untouched(voxels.marks, np.ravel_multi_index(tuple(cells.T), voxels.grid.shape).astype(np.int64))


def find_air(voxels: SurfaceVoxels, is_surely_air: Cells) -> Cells:
    """Return the cells whose centre is in the air, those that a surface passes included."""
    return assign_touched_cells(voxels.marks, is_surely_air)


def thin_bodies(voxels: SurfaceVoxels, box_m: NDArray[np.float64]) -> Cells:
    """Return the cells that bodies take although they hold no centre of a cell there: plates, posts and small things.

    Each takes the cell that holds the middle of its thickness, so that gas and sight never pass through a thin plate.

    Args:
        voxels: The surfaces.
        box_m: (3, 2) where the air's box begins and ends on each axis, world frame [m]; what lies beyond takes none,
            so that walls around the air do not grow into it.
    """
    is_solid = np.zeros(voxels.grid.shape, dtype=np.bool_)
    spans = _spans(voxels, is_by_body=True)
    box = (box_m - np.asarray(voxels.grid.origin_m)[:, np.newaxis]) / voxels.grid.cell_m
    axis = (spans[0] // is_solid.size).astype(np.int64)
    is_within = (spans[1] < box[axis, 1] - EPS) & (spans[2] > box[axis, 0] + EPS)
    _fill_middles_inplace(is_solid, spans[:, is_within & (spans[2] - spans[1] > 1e-6)])
    _fill_posts_inplace(is_solid, voxels)
    return is_solid


def find_sheets(voxels: SurfaceVoxels, is_air: Cells) -> Cells:
    """Return the cells that surfaces take that have air on both sides: the cell that holds the surface.

    A surface on the border of two cells takes the upper one. What remains as air has nothing between its cells.
    """
    is_solid = np.zeros(voxels.grid.shape, dtype=np.bool_)
    spans = _spans(voxels, is_by_body=False)
    lower, upper = _ends(spans, is_air.shape)
    is_between = is_air.reshape(-1)[lower] & is_air.reshape(-1)[upper]
    _fill_middles_inplace(is_solid, spans[:, is_between])
    return is_solid


def air_extent_m(voxels: SurfaceVoxels, is_air: Cells, axis: int) -> tuple[float, float]:
    """Return where the air ends on an axis, at the farthest of the walls that bound it [m].

    Columns of cells that end at an opening count only where all do: behind a door's frame the air goes on.
    """
    columns = np.moveaxis(is_air, axis, 0)
    has_air = columns.any(axis=0)
    first = np.argmax(columns, axis=0)[has_air]
    last = len(columns) - 1 - np.argmax(columns[::-1], axis=0)[has_air]
    cells = np.argwhere(has_air)
    low = _walls_at(voxels, axis, np.insert(cells, axis, first - 1, axis=1), is_last=True)
    high = _walls_at(voxels, axis, np.insert(cells, axis, last, axis=1), is_last=False)
    origin_m, cell_m = voxels.grid.origin_m[axis], voxels.grid.cell_m
    least = low.min() if len(low) else float(first.min())
    most = high.max() if len(high) else float(last.max() + 1)
    return origin_m + least * cell_m, origin_m + most * cell_m


def _crossings_of(surfaces: Surfaces, triangles: NDArray[np.float64], grid: Grid) -> Crossings:
    shape = np.array(grid.shape, dtype=np.int64)
    none = np.empty(0, dtype=np.int64)
    n = find_crossings(triangles, shape, none, none, np.empty(0))
    links, owners, places = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    if n:
        find_crossings(triangles, shape, links, owners, places)
    order = np.lexsort((places, surfaces.body[owners], links))
    return Crossings(link=links[order], triangle=owners[order], place=places[order])


# The lines that are crossed, by each body or by all, without those of openings: (3, n) of line, first and last place.
def _spans(voxels: SurfaceVoxels, *, is_by_body: bool, has_openings: bool = False) -> NDArray[np.float64]:
    crossings, surfaces = voxels.crossings, voxels.surfaces
    chosen = has_openings | ~surfaces.is_opening(crossings.triangle)
    link, place = crossings.link[chosen], crossings.place[chosen]
    if not len(link):
        return np.empty((3, 0))
    is_start = np.diff(link, prepend=-1) != 0
    if is_by_body:
        is_start |= np.diff(surfaces.body[crossings.triangle[chosen]], prepend=-1) != 0
    starts = np.flatnonzero(is_start)
    return np.stack(
        (link[starts].astype(np.float64), np.minimum.reduceat(place, starts), np.maximum.reduceat(place, starts))
    )


# Where walls cross the lines from cells (n, 3) to the next along an axis, for those that do; openings if nothing else.
def _walls_at(voxels: SurfaceVoxels, axis: int, cells: NDArray[np.int64], *, is_last: bool) -> NDArray[np.float64]:
    wanted = axis * voxels.marks.size + np.ravel_multi_index(tuple(cells.T), voxels.grid.shape)
    for has_openings in (False, True):
        links, firsts, lasts = _spans(voxels, is_by_body=False, has_openings=has_openings)
        found = np.isin(links, wanted)
        if found.any():
            return (lasts if is_last else firsts)[found]
    return np.empty(0)


# The flat indices of the cells at both ends of lines.
def _ends(spans: NDArray[np.float64], shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    axis, lower = np.divmod(spans[0].astype(np.int64), math.prod(shape))
    return lower, lower + np.array((shape[1] * shape[2], shape[2], 1))[axis]


def _fill_middles_inplace(is_solid: Cells, spans: NDArray[np.float64]) -> None:
    lower, upper = _ends(spans, is_solid.shape)
    axis = (spans[0] // is_solid.size).astype(np.int64)
    border = np.stack(np.unravel_index(upper, is_solid.shape), axis=1)[np.arange(len(upper)), axis]
    # A thousandth off: a middle on the border belongs to the upper cell, whatever the last digits say.
    chosen = np.where((spans[1] + spans[2]) / 2 + 1e-3 >= border, upper, lower)
    is_solid.reshape(-1)[chosen] = True


# Closed bodies thinner than a cell along two axes may meet no line between centres at all.
def _fill_posts_inplace(is_solid: Cells, voxels: SurfaceVoxels) -> None:
    surfaces, grid = voxels.surfaces, voxels.grid
    corners = (surfaces.corners_m - grid.origin_m) / grid.cell_m
    order = np.argsort(surfaces.body, kind="stable")
    if not len(order):
        return
    starts = np.flatnonzero(np.diff(surfaces.body[order], prepend=-1))
    lows = np.minimum.reduceat(corners.min(axis=1)[order], starts)
    highs = np.maximum.reduceat(corners.max(axis=1)[order], starts)
    bodies = surfaces.body[order][starts]
    is_post = surfaces.closed[bodies] & (np.sum(highs - lows < 1, axis=1) >= 2)
    for low, high in zip(lows[is_post], highs[is_post], strict=True):
        ranges = [_cells_of(low[axis], high[axis], grid.shape[axis]) for axis in range(3)]
        is_solid[tuple(ranges)] = True


# The same rule as for boxes: cells whose centre lies in [low, high), or the one that holds the middle.
def _cells_of(low: float, high: float, n: int) -> slice:
    low, high = round(low, 4), round(high, 4)
    first, last = int(np.ceil(low - 0.5)), int(np.ceil(high - 0.5))
    if first >= last:
        first = int(np.floor((low + high) / 2))
        last = first + 1
    return slice(min(max(first, 0), n), min(max(last, 0), n))


@dataclass(frozen=True, kw_only=True)
class Leak:
    """A hole: its middle, how long its two longer sides are, and the part of the geometry next to it."""

    middle_m: tuple[float, float, float]
    size_m: tuple[float, float]
    part: str


def has_leak(is_air: Cells) -> bool:
    """Return whether air reaches the border of a grid that is larger than the geometry."""
    return any(bool(np.take(is_air, [0, -1], axis=axis).any()) for axis in range(3))


def find_leaks(voxels: SurfaceVoxels, is_air: Cells, seed: NDArray[np.int64]) -> list[Leak]:
    """Return the holes between a cell and the outside, the largest first.

    Args:
        voxels: The surfaces.
        is_air: (nx, ny, nz) what the air of the cell reaches.
        seed: (3,) the cell.
    """
    width = clearances(voxels.marks, is_air, _MOST_STEPS)
    sides = split_at_narrows(voxels.marks, width, int(np.ravel_multi_index(tuple(seed.tolist()), is_air.shape)))
    mouths = [_leak_of(cells, voxels) for cells in _clusters(_meeting_cells(voxels, sides))]
    return sorted(mouths, key=lambda leak: -leak.size_m[0] * leak.size_m[1])


def describe_leaks(leaks: list[Leak], surfaces: Surfaces) -> Problem:
    """Return the holes as one problem that says where they are and what to do."""
    texts = [
        f"a hole of about {leak.size_m[0]:.3g} x {leak.size_m[1]:.3g} m near {point_text(leak.middle_m)} m beside "
        f"{leak.part}"
        for leak in leaks[:MAX_SHOWN]
    ]
    more = f", and {len(leaks) - MAX_SHOWN} more" if len(leaks) > MAX_SHOWN else ""
    low_m, high_m = surfaces.corners_m.min(axis=(0, 1)), surfaces.corners_m.max(axis=(0, 1))
    return Problem(
        where="environment.geometry",
        expected="surfaces and openings that close the air in",
        found=", ".join(texts) + more,
        remedy="Close the mesh there, declare an opening there, take larger cells than the hole with wind.cell_m, or "
        "cut the air off with bounds_m: the geometry's box is "
        f"{{min_m: {point_text(low_m.tolist())}, max_m: {point_text(high_m.tolist())}}}.",
    )


# Cells of the seed's side next to one of the outside's.
def _meeting_cells(voxels: SurfaceVoxels, sides: NDArray[np.uint8]) -> NDArray[np.int64]:
    meets = np.zeros(sides.shape, dtype=np.bool_)
    for axis in range(3):
        low, high = (
            tuple(s if a == axis else slice(None) for a in range(3)) for s in (slice(None, -1), slice(1, None))
        )
        is_open = (voxels.marks[low] & (BORDER << axis)) == 0
        meets[low] |= is_open & (sides[low] == 1) & (sides[high] == 2)
        meets[high] |= is_open & (sides[high] == 1) & (sides[low] == 2)
    return np.argwhere(meets)


def _clusters(cells: NDArray[np.int64]) -> Iterable[NDArray[np.int64]]:
    left = {tuple(cell) for cell in cells.tolist()}
    around = [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)]
    while left:
        cluster = waiting = [left.pop()]
        for i, j, k in waiting:
            near = {(i + a, j + b, k + c) for a, b, c in around} & left
            left -= near
            cluster.extend(sorted(near))
        yield np.array(cluster)


def _leak_of(cells: NDArray[np.int64], voxels: SurfaceVoxels) -> Leak:
    grid: Grid = voxels.grid
    low, high = cells.min(axis=0), cells.max(axis=0) + 1
    middle_m = np.asarray(grid.origin_m) + (low + high) / 2 * grid.cell_m
    _, shorter, longer = sorted(((high - low) * grid.cell_m).tolist())
    corners_m = voxels.surfaces.corners_m
    outside_m = np.maximum(corners_m.min(axis=1) - middle_m, middle_m - corners_m.max(axis=1)).clip(min=0)
    nearest = int(np.argmin(np.linalg.norm(outside_m, axis=1)))
    part = voxels.surfaces.part[nearest]
    x, y, z = middle_m.round(6).tolist()
    return Leak(
        middle_m=(x, y, z),
        size_m=(longer, shorter),
        part=voxels.surfaces.names[part] if part >= 0 else "a declared opening",
    )
