"""Openings of a geometry: surfaces that close the air in, and their places on the sides of the grid."""

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.geometry.mesh_formats import Part
from gslcosim.environment.grid import Grid, point_text
from gslcosim.environment.model import Opening
from gslcosim.environment.openings import Face, border_m, snap_range
from gslcosim.scenario.models.geometry import GeometryOpeningSpec, GeometrySpec
from gslcosim.scenario.problems import Problem

OPENINGS_PATH = "environment.geometry.openings"

# How far from an opening its air may begin, in cells: walls have a thickness, and files their errors.
_REACH = 1.6
# How far outside the air's box an opening may lie: at the outer end of a hole in a wall. Chosen [m].
_MOST_WALL_M = 1.0
_AUTOMATIC = re.compile(r"^(inlet|outlet)", re.IGNORECASE)


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
        plugs.append(_plug_of_surface(opening, [parts[j] for j in found], path))
    taken = {plug.name for plug in plugs}
    for j, part in enumerate(parts):
        if j not in used and (word := _automatic_word(part)):
            used.add(j)
            kind: Literal["inlet", "outlet"] = "inlet" if word.lower().startswith("inlet") else "outlet"
            plugs.append(_plug_of_parts(_free_name(word, taken), kind, [part], "environment.geometry.files"))
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


def _plug_of_surface(opening: GeometryOpeningSpec, parts: Sequence[Part], path: str) -> GeometryOpening:
    return _plug_of_parts(opening.name, opening.kind, parts, path, opening.velocity_m_s)


def _plug_of_parts(
    name: str,
    kind: Literal["inlet", "outlet", "open"],
    parts: Sequence[Part],
    path: str,
    velocity_m_s: Vec3 | None = None,
) -> GeometryOpening:
    corners_m = np.concatenate([part.vertices_m[part.faces] for part in parts])
    low_m, high_m = corners_m.min(axis=(0, 1)), corners_m.max(axis=(0, 1))
    return GeometryOpening(
        name=name,
        kind=kind,
        axis=int(np.argmin(high_m - low_m)),
        min_m=low_m,
        max_m=high_m,
        corners_m=corners_m,
        path=path,
        velocity_m_s=velocity_m_s,
    )


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
        path=f"{path}.surface",
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
        path=plug.path,
        expected=f"at {plug.name}, {span}, {expected}",
        found=found,
        remedy="Move the opening onto the wall of the air, or say with free_point_m where the air is.",
    )
