"""Environment from the user's own geometry: files of surfaces to cells of air, with openings."""

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid_kernels import find_reachable_cells, reachable_cells
from gslcosim.environment.model import (
    MAX_CELLS,
    Cell,
    EnvironmentGeometry,
    Grid,
    Opening,
    VisualMesh,
    closing_boxes,
    point_text,
    raise_if_any,
)
from gslcosim.environment.openings import Face, are_overlapping, border_m, cells_at, snap_range
from gslcosim.scenario.models.scenario import SolverSpec
from gslcosim_formats.geometry.cell_kernels import TOUCHED
from gslcosim_formats.geometry.mesh_formats import Part, load_parts
from gslcosim_formats.geometry.surfaces import (
    Cells,
    Surfaces,
    SurfaceVoxels,
    air_extent_m,
    build_surfaces,
    describe_leaks,
    find_air,
    find_certain_air,
    find_leaks,
    find_sheets,
    has_leak,
    thin_bodies,
    voxelize_surfaces,
)
from gslcosim_formats.scenario_keys import GeometryOpeningSpec, GeometrySpec
from gslcosim_formats.solid_boxes import boxes_from_solid

OPENINGS_PATH = "environment.geometry.openings"

# How far from an opening its air may begin, in cells: walls have a thickness, and files their errors.
_REACH = 1.6
# How far outside the air's box an opening may lie: at the outer end of a hole in a wall. Chosen [m].
_MOST_WALL_M = 1.0
_AUTOMATIC = re.compile(r"^(inlet|outlet)", re.IGNORECASE)
# Openings nearer than this are one: the slats of a grille, the two sides of a pane. Chosen [m].
_LEAST_GAP_M = 0.2
# A piece is flat if so much of its area lies across one axis; chosen.
_FLAT_SHARE = 0.8
GEOMETRY_PATH = "environment.geometry"
# Cells around the geometry, so that what escapes can be seen outside of it.
_MARGIN = 3
# The boxes that close the grid from outside [m].
_CLOSING_WALL_M = 0.2
# Where air is looked for when there is no opening: points per axis of the geometry's box.
_N_TRIES = 5


@dataclass(frozen=True, kw_only=True)
class GeometryOpening:
    """An opening as the geometry has it: flat, or thinnest, along `axis`, from `min_m` to `max_m`, world frame.

    `corners_m` is (n, 3, 3): the triangles that close it. `path` is its place in the scenario.
    """

    name: str
    kind: Literal["inlet", "outlet", "open"]
    axis: int
    min_m: NDArray[np.float64]
    max_m: NDArray[np.float64]
    corners_m: NDArray[np.float64]
    path: str
    velocity_m_s: Vec3 | None = None


@dataclass(frozen=True, kw_only=True)
class PlacedOpening:
    """An opening on a side of the grid, and the (nx, ny, nz) cells of the duct that leads there from the air."""

    opening: Opening
    is_duct: NDArray[np.bool_]
    duct_m: float


def find_geometry_openings(
    spec: GeometrySpec, parts: Sequence[Part]
) -> tuple[list[GeometryOpening], list[Part], list[Problem]]:
    """Return the openings, the parts that are not openings, and openings whose surface is not in the files."""
    plugs: list[GeometryOpening] = []
    problems: list[Problem] = []
    used: set[int] = set()
    for i, opening in enumerate(spec.openings):
        path = f"{OPENINGS_PATH}[{i}]"
        if opening.box is not None:
            plugs.append(_plug_of_box(opening, path))
            continue
        found = [j for j, part in enumerate(parts) if opening.surface in part.names or opening.surface == part.name]
        if not found:
            problems.append(_missing(opening, parts, path))
            continue
        used.update(found)
        surface = [parts[j] for j in found]
        plugs += _plugs_of_parts(opening.name, opening.kind, surface, path, opening.velocity_m_s)
    taken = {plug.name for plug in plugs}
    for j, part in enumerate(parts):
        if j not in used and (word := _automatic_word(part)):
            used.add(j)
            kind: Literal["inlet", "outlet"] = "inlet" if word.lower().startswith("inlet") else "outlet"
            name = _free_name(word, taken)
            plugs += _plugs_of_parts(name, kind, [part], "environment.geometry.files")
            taken |= {plug.name for plug in plugs}
    return plugs, [part for j, part in enumerate(parts) if j not in used], problems


def seed_cells(plug: GeometryOpening, grid: Grid) -> NDArray[np.int64]:
    """Return the (n, 3) cells one to three cells before and behind places spread over an opening."""
    middle_m = (plug.min_m + plug.max_m) / 2
    half_m = (plug.max_m[plug.axis] - plug.min_m[plug.axis]) / 2
    away_m = half_m + grid.cell_m * np.array((1.0, 2.0, 3.0))
    points_m: list[NDArray[np.float64]] = []
    for shares in itertools.product((0.5, 0.1, 0.9), repeat=2):
        point_m = middle_m.copy()
        for axis, share in zip((axis for axis in range(3) if axis != plug.axis), shares, strict=True):
            point_m[axis] = plug.min_m[axis] + share * (plug.max_m[axis] - plug.min_m[axis])
        is_across = np.arange(3) == plug.axis
        points_m += [point_m + np.where(is_across, away, 0.0) for away in (*away_m, *-away_m)]
    return grid.cell_of(np.array(points_m))


def place_opening(
    plug: GeometryOpening, grid: Grid, is_air: NDArray[np.bool_], inlet_velocity_m_s: Vec3
) -> PlacedOpening | Problem:
    """Return an opening on the side of the grid that its air looks at.

    The opening is the rectangle of whole cells around those columns of cells, across its plane, that have air beside
    it. Where it lies farther inside than the side of the grid, a duct leads straight out.

    Args:
        plug: The opening.
        grid: The air's grid.
        is_air: (nx, ny, nz) cells of the grid that are air.
        inlet_velocity_m_s: Its length is the speed of inlets that say none.

    Returns:
        The place, or why there is none.
    """
    axis, (b, c) = plug.axis, (other for other in range(3) if other != plug.axis)
    spans = [slice(*snap_range(plug.min_m[o], plug.max_m[o], grid, o, is_outward=True)) for o in (b, c)]
    columns = np.moveaxis(is_air, axis, 0)[:, spans[0], spans[1]]
    low, high = (
        min(max((end_m[axis] - grid.origin_m[axis]) / grid.cell_m, 0.0), grid.shape[axis])
        for end_m in (plug.min_m, plug.max_m)
    )
    beyond_m = max(grid.origin_m[axis] - plug.max_m[axis], plug.min_m[axis] - grid.max_m[axis])
    below, above = _air_beside(columns if beyond_m < _MOST_WALL_M else np.zeros_like(columns), low, high)
    n_below, n_above = int(below.any(axis=0).sum()), int(above.any(axis=0).sum())
    if max(n_below, n_above) == 0:
        return _problem(plug, "air beside it", "none: it lies in a wall or outside")
    if 2 * min(n_below, n_above) > max(n_below, n_above):
        return _problem(plug, "air on one side of it", "air on both: it lies within the room")
    is_upper = n_below > n_above
    beside = below if is_upper else above
    duct = _duct(beside, is_upper=is_upper)
    if (duct & columns).any():
        return _problem(plug, "nothing but walls between it and the outside", "air of another part of the room")
    face = Face(axis=axis, is_upper=is_upper)
    is_duct = np.zeros(grid.shape, dtype=np.bool_)
    np.moveaxis(is_duct, axis, 0)[:, spans[0], spans[1]] = duct
    velocity_m_s = _velocity_m_s(plug, face, inlet_velocity_m_s)
    if plug.kind == "inlet" and velocity_m_s[axis] * face.inward <= 0 and any(velocity_m_s):
        return _problem(plug, f"a velocity that enters through {face.name}", point_text(velocity_m_s))
    opening = _opening(plug, face, grid, np.asarray(beside.any(axis=0)), spans, velocity_m_s)
    return PlacedOpening(opening=opening, is_duct=is_duct, duct_m=int(duct.sum(axis=0).max()) * grid.cell_m)


def _plug_of_box(opening: GeometryOpeningSpec, path: str) -> GeometryOpening:
    assert opening.box is not None, "checked by the caller"
    low_m, high_m = np.array(opening.box.min_m), np.array(opening.box.max_m)
    axis = int(np.argmin(high_m - low_m))
    corners_m = np.repeat(low_m[np.newaxis], 4, axis=0)
    b, c = (axis + 1) % 3, (axis + 2) % 3
    corners_m[1:3, b] = high_m[b]
    corners_m[2:4, c] = high_m[c]
    corners_m[:, axis] = (low_m[axis] + high_m[axis]) / 2
    return GeometryOpening(
        name=opening.name,
        kind=opening.kind,
        axis=axis,
        min_m=low_m,
        max_m=high_m,
        corners_m=corners_m[[(0, 1, 2), (0, 2, 3)]],
        path=path,
        velocity_m_s=opening.velocity_m_s,
    )


# A surface may close openings in several walls; each flat piece of it is one.
def _plugs_of_parts(
    name: str,
    kind: Literal["inlet", "outlet", "open"],
    parts: Sequence[Part],
    path: str,
    velocity_m_s: Vec3 | None = None,
) -> list[GeometryOpening]:
    corners_m = np.concatenate([part.vertices_m[part.faces] for part in parts])
    plugs: list[GeometryOpening] = []
    for i, piece_m in enumerate(_flat_pieces(corners_m)):
        low_m, high_m = piece_m.min(axis=(0, 1)), piece_m.max(axis=(0, 1))
        plugs.append(
            GeometryOpening(
                name=name if i == 0 else f"{name}_{i + 1}",
                kind=kind,
                axis=int(np.argmin(high_m - low_m)),
                min_m=low_m,
                max_m=high_m,
                corners_m=piece_m,
                path=path,
                velocity_m_s=velocity_m_s,
            )
        )
    return plugs


# Corners (n, 3, 3) as pieces: what is connected; of that, if it is neither flat nor closed, what looks along
# one axis; and of these, those close to each other together.
def _flat_pieces(corners_m: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    pieces: list[NDArray[np.float64]] = []
    for connected_m in _connected(corners_m):
        areas_m2 = np.abs(np.cross(connected_m[:, 1] - connected_m[:, 0], connected_m[:, 2] - connected_m[:, 0]))
        axes = np.argmax(areas_m2, axis=1)
        if areas_m2.sum(axis=0).max() >= _FLAT_SHARE * areas_m2.sum() or _is_closed(connected_m):
            pieces.append(connected_m)
        else:
            pieces += [piece_m for axis in range(3) for piece_m in _connected(connected_m[axes == axis])]
    merged: list[NDArray[np.float64]] = []
    for piece_m in pieces:
        low_m, high_m = piece_m.min(axis=(0, 1)) - _LEAST_GAP_M, piece_m.max(axis=(0, 1)) + _LEAST_GAP_M
        axis = int(np.argmin(high_m - low_m))
        near = [
            other
            for other in merged
            if axis == int(np.argmin(np.ptp(other.reshape(-1, 3), axis=0)))
            and (other.min(axis=(0, 1)) <= high_m).all()
            and (other.max(axis=(0, 1)) >= low_m).all()
        ]
        merged = [other for other in merged if not any(other is each for each in near)]
        merged.append(np.concatenate([*near, piece_m]))
    return merged


# By shared corners, to a hundredth of a millimetre.
def _connected(corners_m: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    _, places = np.unique(corners_m.reshape(-1, 3).round(5), axis=0, return_inverse=True)
    faces = places.reshape(-1, 3)
    labels = np.arange(places.max(initial=-1) + 1)
    while True:
        lowest = labels.copy()
        np.minimum.at(lowest, faces, labels[faces].min(axis=1, keepdims=True))
        if (lowest == labels).all():
            break
        labels = lowest
    return [corners_m[labels[faces[:, 0]] == label] for label in np.unique(labels)]


def _is_closed(corners_m: NDArray[np.float64]) -> bool:
    _, places = np.unique(corners_m.reshape(-1, 3).round(5), axis=0, return_inverse=True)
    edges = np.sort(places.reshape(-1, 3)[:, [(0, 1), (1, 2), (2, 0)]].reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())


def _automatic_word(part: Part) -> str | None:
    return next((name for name in (part.name, *sorted(part.names)) if _AUTOMATIC.match(name)), None)


def _free_name(word: str, taken: set[str]) -> str:
    base = re.sub(r"[^a-z0-9_]+", "_", word.lower())[:36].strip("_")
    name, n = base, 2
    while name in taken:
        name, n = f"{base}_{n}", n + 1
    taken.add(name)
    return name


def _missing(opening: GeometryOpeningSpec, parts: Sequence[Part], path: str) -> Problem:
    names = sorted({name for part in parts for name in (part.name, *part.names)})
    shown = ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
    return Problem(
        where=f"{path}.surface",
        expected=f"the name of a part of the files: {shown}",
        found=f"{opening.surface}",
        remedy="Name a mesh, node, group, material, solid or geom, or give the place as a box.",
    )


# The cells with air within reach, below and above the middle of the opening, as (n, b, c) like the columns.
def _air_beside(columns: NDArray[np.bool_], low: float, high: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    centres = (np.arange(len(columns)) + 0.5)[:, np.newaxis, np.newaxis]
    middle = (low + high) / 2
    below = columns & (centres < middle) & (centres + 0.5 >= low - _REACH)
    above = columns & (centres >= middle) & (centres - 0.5 <= high + _REACH)
    return below, above


# From the air cell that is nearest to the side of the grid on to that side.
def _duct(beside: NDArray[np.bool_], *, is_upper: bool) -> NDArray[np.bool_]:
    towards_side = beside if is_upper else beside[::-1]
    is_behind = np.cumsum(towards_side, axis=0) == towards_side.sum(axis=0)
    duct = is_behind & towards_side.any(axis=0) & ~towards_side
    return duct if is_upper else duct[::-1]


def _velocity_m_s(plug: GeometryOpening, face: Face, inlet_velocity_m_s: Vec3) -> Vec3:
    if plug.kind != "inlet":
        return (0.0, 0.0, 0.0)
    if plug.velocity_m_s is not None:
        return plug.velocity_m_s
    speed_m_s = round(float(np.linalg.norm(inlet_velocity_m_s)), 9) * face.inward
    return tuple(speed_m_s if axis == face.axis else 0.0 for axis in range(3))  # pyright: ignore[reportReturnType]


def _opening(
    plug: GeometryOpening,
    face: Face,
    grid: Grid,
    is_used: NDArray[np.bool_],
    spans: Sequence[slice],
    velocity_m_s: Vec3,
) -> Opening:
    min_m, max_m = [face.coordinate_m(grid)] * 3, [face.coordinate_m(grid)] * 3
    others = [axis for axis in range(3) if axis != face.axis]
    for axis, span, used in zip(others, spans, (is_used.any(axis=1), is_used.any(axis=0)), strict=True):
        places = np.flatnonzero(used) + span.start
        min_m[axis] = border_m(grid, axis, int(places[0]))
        max_m[axis] = border_m(grid, axis, int(places[-1]) + 1)
    return Opening(
        name=plug.name,
        kind=plug.kind,
        min_m=(min_m[0], min_m[1], min_m[2]),
        max_m=(max_m[0], max_m[1], max_m[2]),
        velocity_m_s=velocity_m_s,
    )


def _problem(plug: GeometryOpening, expected: str, found: str) -> Problem:
    span = f"{point_text(plug.min_m.tolist())} to {point_text(plug.max_m.tolist())} m"
    return Problem(
        where=plug.path,
        expected=f"at {plug.name}, {span}, {expected}",
        found=found,
        remedy="Move the opening onto the wall of the air, or say with free_point_m where the air is.",
    )


@dataclass(frozen=True, kw_only=True)
class _Case:
    """Input of a voxelization: surfaces, openings, and the size of cells."""

    spec: GeometrySpec
    wind: SolverSpec
    surfaces: Surfaces
    plugs: tuple[GeometryOpening, ...]


def geometry_from_files(spec: GeometrySpec, wind: SolverSpec, *, base_dir: Path) -> EnvironmentGeometry:
    """Return the room that files of geometry describe, without wind.

    The grid covers the air's box: its lower corner lies exactly on the farthest walls, its upper one within half a cell
    of them. A cell is air when its centre is, and when air reaches it from the free point through holes of at least
    one cell. What is thinner than a cell takes the cell that holds its middle.

    Args:
        spec: The files and what is said of them.
        wind: Gives the cell of the grid and the speed of inlets that say none.
        base_dir: What relative paths are relative to, the scenario's folder.
    """
    parts = _load(spec, base_dir)
    plugs, walls, problems = find_geometry_openings(spec, parts)
    problems += _problems_of_kinds(plugs, wind)
    raise_if_any(problems)
    corners_m = np.concatenate((np.empty((0, 3, 3)), *(plug.corners_m for plug in plugs)))
    case = _Case(spec=spec, wind=wind, surfaces=build_surfaces(walls, corners_m), plugs=tuple(plugs))
    grid, is_air = _air_in_bounds(case) if spec.bounds_m is not None else _air_within_walls(case)
    is_air, openings, notices = _with_openings(case, grid, is_air)
    occupancy = _occupancy(is_air, openings, grid)
    return EnvironmentGeometry(
        name=_name_of(spec),
        grid=grid,
        occupancy=occupancy,
        boxes=(
            *closing_boxes(grid.origin_m, grid.max_m, _CLOSING_WALL_M),
            *boxes_from_solid(occupancy == Cell.SOLID, grid),
        ),
        openings=openings,
        notices=(*notices, _notice_of_extent(case, grid)),
        meshes=tuple(_visual_meshes(walls)),
    )


def _load(spec: GeometrySpec, base_dir: Path) -> list[Part]:
    parts: list[Part] = []
    problems: list[str] = []
    for i, file in enumerate(spec.files):
        path = Path(file).expanduser()
        try:
            parts += load_parts(base_dir / path, scale=spec.scale, up=spec.up, translate_m=spec.translate_m)
        except EnvironmentDataError as error:
            problems.append(f"{GEOMETRY_PATH}.files[{i}]: {error}")
    if problems:
        raise EnvironmentDataError("\n".join(problems))
    return parts


def _problems_of_kinds(plugs: Sequence[GeometryOpening], wind: SolverSpec) -> list[Problem]:
    if not wind.solves:
        return []
    return [
        Problem(
            where=OPENINGS_PATH,
            expected=f"at least one {kind}, since wind.solver is {wind.kind_name}",
            found="none",
            remedy=f"List one, or name a surface of the files {kind}; or take wind.solver: uniform.",
        )
        for kind in ("inlet", "outlet")
        if not any((plug.kind == "inlet") == (kind == "inlet") for plug in plugs)
    ]


def _air_in_bounds(case: _Case) -> tuple[Grid, Cells]:
    grid = _grid_of_bounds(case)
    voxels = voxelize_surfaces(case.surfaces, grid)
    seeds = _seeds(case, voxels, is_closed=True)
    is_air = find_air(voxels, find_certain_air(voxels, seeds))
    return grid, _without_thin_things(voxels, is_air, np.stack((grid.origin_m, grid.max_m), axis=1))


# First on a grid that covers the whole geometry; the air found there says where the final grid has to lie.
def _air_within_walls(case: _Case) -> tuple[Grid, Cells]:
    rough = voxelize_surfaces(case.surfaces, _grid_around(case))
    is_surely_air = find_certain_air(rough, _seeds(case, rough, is_closed=False))
    is_air = find_air(rough, is_surely_air)
    box_m = np.array([air_extent_m(rough, is_air, axis) for axis in range(3)])
    grid = _grid_of_air(box_m, case.wind.cell_m)
    shape = (grid.shape[0] + 2 * _MARGIN, grid.shape[1] + 2 * _MARGIN, grid.shape[2] + 2 * _MARGIN)
    origin_m = tuple(low_m - _MARGIN * grid.cell_m for low_m in grid.origin_m)
    wide = Grid(origin_m=origin_m, cell_m=grid.cell_m, shape=shape)  # pyright: ignore[reportArgumentType]
    voxels = voxelize_surfaces(case.surfaces, wide)
    seeds = wide.cell_of(
        np.asarray(rough.grid.origin_m, dtype=np.float64) + (np.argwhere(is_surely_air) + 0.5) * grid.cell_m
    )
    is_surely_air = find_certain_air(voxels, seeds)
    _check_closed(case, voxels, is_surely_air, seeds)
    is_air = _without_thin_things(voxels, find_air(voxels, is_surely_air), box_m)
    return grid, is_air[tuple(slice(_MARGIN, -_MARGIN) for _ in range(3))]


def _without_thin_things(voxels: SurfaceVoxels, is_air: Cells, box_m: NDArray[np.float64]) -> Cells:
    is_air = is_air & ~thin_bodies(voxels, box_m)
    return is_air & ~find_sheets(voxels, is_air)


def _seeds(case: _Case, voxels: SurfaceVoxels, *, is_closed: bool) -> NDArray[np.int64]:
    if case.spec.free_point_m is not None:
        seeds = _seed_of_point(case.spec.free_point_m, voxels)
        if not is_closed:
            _check_closed(case, voxels, find_certain_air(voxels, seeds), seeds)
        return seeds
    leaking = None
    for group in _candidates(case, voxels):
        best, n_best = None, 0
        is_seen = np.zeros(voxels.grid.shape, dtype=np.bool_)
        for cell in group:
            if is_seen[tuple(cell)]:
                continue
            is_air = find_certain_air(voxels, cell[np.newaxis])
            is_seen |= is_air
            if not is_closed and has_leak(is_air):
                leaking = cell if leaking is None else leaking
            elif (n := int(is_air.sum())) > n_best:
                best, n_best = cell, n
        if best is not None:
            return best[np.newaxis]
    if leaking is not None:
        _check_closed(case, voxels, find_certain_air(voxels, leaking[np.newaxis]), leaking[np.newaxis])
    raise_if_any([_no_air(case)])
    raise AssertionError("unreachable: raise_if_any has raised")


# Beside the first inlet, the side towards the middle first; beside the other openings. Without openings: in the middle,
# or else anywhere.
def _candidates(case: _Case, voxels: SurfaceVoxels) -> Iterator[NDArray[np.int64]]:
    grid = voxels.grid
    if case.spec.bounds_m is not None:
        low_m, high_m = np.array(case.spec.bounds_m.min_m), np.array(case.spec.bounds_m.max_m)
    else:
        low_m, high_m = case.surfaces.corners_m.min(axis=(0, 1)), case.surfaces.corners_m.max(axis=(0, 1))
    middle = grid.cell_of((low_m + high_m) / 2)
    groups = [
        sorted(seed_cells(plug, grid).tolist(), key=lambda cell: math.dist(cell, middle.tolist()))
        for plug in sorted(case.plugs, key=lambda plug: plug.kind != "inlet")
    ]
    shares = (np.arange(_N_TRIES) + 0.5) / _N_TRIES
    anywhere = [grid.cell_of(low_m + (high_m - low_m) * share) for share in itertools.product(shares, repeat=3)]
    # Without the openings' word, air in a body could be taken for the room's.
    for group in groups or ([middle.tolist()], anywhere):
        cells = np.array(group)
        cells = cells[grid.contains_cell(cells)]
        usable = cells[(voxels.marks[tuple(cells.T)] & TOUCHED) == 0]
        if len(usable):
            yield usable


def _seed_of_point(point_m: Vec3, voxels: SurfaceVoxels) -> NDArray[np.int64]:
    cell = voxels.grid.cell_of(np.array(point_m))
    if bool(voxels.grid.contains_cell(cell)) and find_certain_air(voxels, cell[np.newaxis]).any():
        return cell[np.newaxis]
    is_inside = bool(voxels.grid.contains_cell(cell))
    raise_if_any(
        [
            Problem(
                where=f"{GEOMETRY_PATH}.free_point_m",
                expected="a point in the air, at least a cell away from all surfaces",
                found=f"{point_text(point_m)}, {'in a cell that a surface passes' if is_inside else 'outside'}",
                remedy="Take a point in the middle of the air.",
            )
        ]
    )
    raise AssertionError("unreachable: raise_if_any has raised")


def _check_closed(case: _Case, voxels: SurfaceVoxels, is_air: Cells, seeds: NDArray[np.int64]) -> None:
    if has_leak(is_air):
        reached = seeds[voxels.grid.contains_cell(seeds)]
        leaks = find_leaks(voxels, is_air, reached[is_air[tuple(reached.T)]][0])
        raise_if_any([describe_leaks(leaks, case.surfaces)])


def _no_air(case: _Case) -> Problem:
    return Problem(
        where=f"{GEOMETRY_PATH}.free_point_m",
        expected=f"cells of {case.wind.cell_m:g} m that no surface touches, beside an opening or in the middle",
        found="none",
        remedy="Say where the air is, check scale, or take smaller cells with wind.cell_m.",
    )


def _grid_of_bounds(case: _Case) -> Grid:
    bounds, cell_m = case.spec.bounds_m, case.wind.cell_m
    assert bounds is not None, "checked by the caller"
    lengths = [(high - low) / cell_m for low, high in zip(bounds.min_m, bounds.max_m, strict=True)]
    _check_size(lengths, cell_m)
    raise_if_any(
        [
            Problem(
                where=f"{GEOMETRY_PATH}.bounds_m.max_m[{axis}]",
                expected=f"a whole number of the {cell_m:g} m cells of wind.cell_m above {bounds.min_m[axis]:g} m",
                found=f"{bounds.max_m[axis]:g} m, which is {length:.4g} cells",
                remedy=f"Nearest: {bounds.min_m[axis] + max(1, round(length)) * cell_m:g} m.",
            )
            for axis, length in enumerate(lengths)
            if abs(length - round(length)) > 1e-6 or round(length) < 1
        ]
    )
    nx, ny, nz = (round(length) for length in lengths)
    return Grid(origin_m=bounds.min_m, cell_m=cell_m, shape=(nx, ny, nz))


def _grid_around(case: _Case) -> Grid:
    corners_m, cell_m = case.surfaces.corners_m, case.wind.cell_m
    low_m, high_m = corners_m.min(axis=(0, 1)).round(5), corners_m.max(axis=(0, 1)).round(5)
    lengths = ((high_m - low_m) / cell_m + 2 * _MARGIN).tolist()
    _check_size(lengths, cell_m)
    nx, ny, nz = (math.ceil(length - 1e-4) for length in lengths)
    x_m, y_m, z_m = (low_m - _MARGIN * cell_m).tolist()
    return Grid(origin_m=(x_m, y_m, z_m), cell_m=cell_m, shape=(nx, ny, nz))


def _check_size(lengths: Sequence[float], cell_m: float) -> None:
    n_cells = math.prod(lengths)
    if n_cells > MAX_CELLS:
        sides_m = " x ".join(f"{length * cell_m:.4g}" for length in lengths)
        raise_if_any(
            [
                Problem(
                    where="wind.cell_m",
                    expected=f"cells that divide the geometry into at most {MAX_CELLS:.3g}",
                    found=f"{cell_m:g} m, which makes {n_cells:.3g} of {sides_m} m",
                    remedy=f"Take cells of at least {cell_m * (n_cells / MAX_CELLS) ** (1 / 3):.2g} m; files in "
                    "millimetres need scale: 0.001.",
                )
            ]
        )


def _grid_of_air(box_m: NDArray[np.float64], cell_m: float) -> Grid:
    # Coordinates of files have single precision; a tenth of a millimetre is none of the wall's.
    x_m, y_m, z_m = (round(float(low_m), 4) + 0.0 for low_m in box_m[:, 0])
    nx, ny, nz = (max(1, math.ceil((high_m - low_m) / cell_m - 0.5 - 1e-3)) for low_m, high_m in box_m)
    return Grid(origin_m=(x_m, y_m, z_m), cell_m=cell_m, shape=(nx, ny, nz))


def _with_openings(case: _Case, grid: Grid, is_air: Cells) -> tuple[Cells, tuple[Opening, ...], list[str]]:
    placed = [place_opening(plug, grid, is_air, case.wind.inlet_velocity_m_s) for plug in case.plugs]
    raise_if_any([problem for problem in placed if isinstance(problem, Problem)])
    good = [place for place in placed if isinstance(place, PlacedOpening)]
    openings = tuple(place.opening for place in good)
    raise_if_any(
        [
            Problem(
                where=OPENINGS_PATH,
                expected="openings apart from each other",
                found=f"{first.name} and {second.name} that overlap",
                remedy="Move one of them, or list them as one.",
            )
            for first, second in itertools.combinations(openings, 2)
            if are_overlapping(first, second, grid)
        ]
    )
    for place in good:
        is_air = is_air | place.is_duct
    notices = [
        f"The opening {place.opening.name} lies {place.duct_m:g} m inside the air's box; a duct leads straight out."
        for place in good
        if place.duct_m > 0
    ]
    return is_air, openings, notices


def _occupancy(is_air: Cells, openings: Sequence[Opening], grid: Grid) -> NDArray[np.uint8]:
    is_air = find_reachable_cells(is_air, openings, grid) if openings else _largest(is_air)
    occupancy = np.where(is_air, np.uint8(Cell.FREE), np.uint8(Cell.SOLID))
    for opening in openings:
        if opening.kind != "inlet":
            layer = occupancy[cells_at(opening, grid)]
            layer[layer == Cell.FREE] = Cell.OUTLET
    occupancy.setflags(write=False)
    return occupancy


def _largest(is_air: Cells) -> Cells:
    left, largest = is_air.copy(), np.zeros_like(is_air)
    while left.sum() > largest.sum():
        pocket = reachable_cells(left, np.argwhere(left)[:1])
        left &= ~pocket
        largest = pocket if pocket.sum() > largest.sum() else largest
    return largest


def _name_of(spec: GeometrySpec) -> str:
    return re.sub(r"[^a-z0-9_]+", "_", Path(spec.files[0]).stem.lower()).strip("_")[:40] or "geometry"


def _notice_of_extent(case: _Case, grid: Grid) -> str:
    n = " x ".join(map(str, grid.shape))
    return (
        f"The air of {len(case.surfaces.corners_m)} triangles lies from {point_text(grid.origin_m)} to "
        f"{point_text(grid.max_m)} m, {n} cells of {grid.cell_m:g} m."
    )


def _visual_meshes(parts: Sequence[Part]) -> list[VisualMesh]:
    names: set[str] = set()
    meshes: list[VisualMesh] = []
    for part in parts:
        numbered = (f"{part.name}_{i}" for i in itertools.count(2))
        name = next(name for name in itertools.chain([part.name], numbered) if name not in names)
        names.add(name)
        meshes.append(VisualMesh.of(name, part.vertices_m, part.faces, part.rgba))
    return meshes
