"""Openings and boxes on the grid: the face of each opening, and the whole cells of both."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Box, Environment, Grid, Opening, span_text
from gslcosim.scenario.models.scenario import OpeningSpec

_AXES = "xyz"
# Greatest distance from a face at which an opening still lies on it [m].
_ON_FACE_M = 1e-6

Cells = tuple[slice, slice, slice]


@dataclass(frozen=True, kw_only=True)
class Face:
    """One of the six faces of the box of air; `axis` 0, 1, 2 is x, y, z."""

    axis: int
    is_upper: bool

    @property
    def name(self) -> str:
        """For example `x_max`."""
        return f"{_AXES[self.axis]}_{'max' if self.is_upper else 'min'}"

    @property
    def inward(self) -> int:
        """Sign of a velocity along `axis` that enters the room through this face."""
        return -1 if self.is_upper else 1

    def coordinate_m(self, grid: Grid) -> float:
        """Return the face's coordinate on its axis, world frame [m]."""
        return grid.max_m[self.axis] if self.is_upper else grid.origin_m[self.axis]


FACES = tuple(Face(axis=axis, is_upper=is_upper) for axis in range(3) for is_upper in (False, True))


@dataclass(frozen=True)
class WantedOpening:
    """An opening of a scenario or of its layout, and the place in the scenario that is responsible for it.

    Attributes:
        velocity_m_s: The inlet's; zero for the others.
        is_wind_checked: True when its velocity has to enter the room.
        overlap_path: Place of the problem when it overlaps an earlier opening; absent: `path`.
        is_optional: True when it is left out where it would overlap an earlier opening.
    """

    name: str
    kind: Literal["inlet", "outlet", "open"]
    spec: OpeningSpec
    path: str
    velocity_m_s: Vec3 = (0.0, 0.0, 0.0)
    is_wind_checked: bool = False
    overlap_path: str | None = None
    is_optional: bool = False


def place_openings(
    wanted: Sequence[WantedOpening], grid: Grid
) -> tuple[tuple[Opening, ...], list[Problem], tuple[str, ...]]:
    """Move openings to whole cells of a room's faces.

    Each edge goes to the nearest cell border; one half-way goes outward, so 1.5 m becomes 1.6 m with 0.2 m cells.

    Returns:
        The openings that can be placed, all problems of the others and between them, and a notice for each opening
        that moved.
    """
    placed: list[Opening] = []
    problems: list[Problem] = []
    notices: list[str] = []
    for i, each in enumerate(wanted):
        if not each.is_optional and each.name in {other.name for other in placed}:
            problems.append(
                Problem(
                    where=f"{each.path}.name",
                    expected="a name that no other opening has",
                    found=each.name,
                    remedy=f"For example {each.name}_{i}.",
                )
            )
        face = find_face(each.spec, grid)
        found = _find_place_problems(each, grid, face)
        if face is None or found:
            problems += found
            continue
        if each.is_wind_checked:
            problems += find_inflow_problems(each.velocity_m_s, face)
        low_m, high_m = list(each.spec.min_m), list(each.spec.max_m)
        for axis in range(3):
            low_m[axis] = high_m[axis] = face.coordinate_m(grid)
            if axis != face.axis:
                first, last = snap_range(each.spec.min_m[axis], each.spec.max_m[axis], grid, axis, is_outward=True)
                low_m[axis], high_m[axis] = border_m(grid, axis, first), border_m(grid, axis, last)
        min_m, max_m = (low_m[0], low_m[1], low_m[2]), (high_m[0], high_m[1], high_m[2])
        opening = Opening(name=each.name, kind=each.kind, min_m=min_m, max_m=max_m, velocity_m_s=each.velocity_m_s)
        overlapped = [other for other in placed if are_overlapping(other, opening, grid)]
        if overlapped and each.is_optional:
            continue
        problems += [
            Problem(
                where=each.overlap_path or each.path,
                expected=f"{other.name} and {opening.name} apart from each other",
                found=f"{other.name} {span_text(other.min_m, other.max_m)} and {opening.name} "
                f"{span_text(min_m, max_m)}, which overlap",
                remedy="Move one of them.",
            )
            for other in overlapped
        ]
        placed.append(opening)
        moves_m = zip((*each.spec.min_m, *each.spec.max_m), (*min_m, *max_m), strict=True)
        if max(abs(before_m - after_m) for before_m, after_m in moves_m) > _ON_FACE_M:
            notices.append(
                f"The {each.name} {span_text(each.spec.min_m, each.spec.max_m)} is taken as "
                f"{span_text(min_m, max_m)}, which is whole cells of {grid.cell_m:g} m."
            )
    return tuple(placed), problems, tuple(notices)


def find_face(opening: OpeningSpec | Opening, grid: Grid) -> Face | None:
    """Return the face of the room that an opening lies flat on; None without one."""
    for face in FACES:
        where_m = face.coordinate_m(grid)
        corners_m = (opening.min_m[face.axis], opening.max_m[face.axis])
        if all(abs(corner_m - where_m) <= _ON_FACE_M for corner_m in corners_m):
            return face
    return None


def snap_range(low_m: float, high_m: float, grid: Grid, axis: int, *, is_outward: bool) -> tuple[int, int]:
    """Return the cells [first, last) of a span on one axis, clipped to the grid; (0, 0) for a span outside.

    Ends go to the nearest cell border. An end half-way between two borders goes outward or, otherwise, up, which
    takes the cells with a centre in [low_m, high_m). A span without a cell takes the one that holds its middle.
    """
    n = grid.shape[axis]
    # Rounded, so that 13.4 / 0.2 counts as 67 and not as a little less.
    low = round((low_m - grid.origin_m[axis]) / grid.cell_m, 6)
    high = round((high_m - grid.origin_m[axis]) / grid.cell_m, 6)
    if high <= 0 or low >= n:
        return 0, 0
    first = math.ceil(low - 0.5)
    last = math.floor(high + 0.5) if is_outward else math.ceil(high - 0.5)
    if first >= last:
        first = math.floor((low + high) / 2)
        last = first + 1
    first, last = max(first, 0), min(last, n)
    return (first, last) if first < last else (0, 0)


def border_m(grid: Grid, axis: int, i: int) -> float:
    """Return the coordinate [m] of the lower border of cells i, without the rounding error of a product."""
    if i == grid.shape[axis]:
        return grid.max_m[axis]
    return round(grid.origin_m[axis] + i * grid.cell_m, 9)


def cells_at(opening: Opening, grid: Grid) -> Cells:
    """Return the layer of cells, one deep, at an opening on a face of the room."""
    face = find_face(opening, grid)
    if face is None:
        span = span_text(opening.min_m, opening.max_m)
        raise ValueError(f"opening {opening.name} is on no face of the grid: {span}")
    slices: list[slice] = []
    for axis in range(3):
        if axis == face.axis:
            slices.append(slice(-1, None) if face.is_upper else slice(0, 1))
        else:
            slices.append(slice(*snap_range(opening.min_m[axis], opening.max_m[axis], grid, axis, is_outward=True)))
    return slices[0], slices[1], slices[2]


def are_overlapping(a: Opening, b: Opening, grid: Grid) -> bool:
    """Return whether two openings on one face overlap, by more than an edge."""
    face = find_face(a, grid)
    if face is None or face != find_face(b, grid):
        return False
    return all(
        min(a.max_m[axis], b.max_m[axis]) - max(a.min_m[axis], b.min_m[axis]) > _ON_FACE_M
        for axis in range(3)
        if axis != face.axis
    )


def find_inflow_problems(velocity_m_s: Vec3, face: Face) -> Sequence[Problem]:
    """Return the problem of wind that does not enter at an inlet; still air has none."""
    if not any(velocity_m_s) or velocity_m_s[face.axis] * face.inward > 0:
        return ()
    sign = "+" if face.inward > 0 else "-"
    return (
        Problem(
            where="wind.inlet_velocity_m_s",
            expected=f"a wind that enters the room through the inlet on {face.name}, with a part along "
            f"{sign}{_AXES[face.axis]}",
            found=f"[{velocity_m_s[0]:g}, {velocity_m_s[1]:g}, {velocity_m_s[2]:g}]",
            remedy="Turn the wind, or put the inlet on the face that it comes from.",
        ),
    )


def voxelize(boxes: Iterable[Box], grid: Grid) -> NDArray[np.bool_]:
    """Return which of the (nx, ny, nz) cells are solid.

    A cell is solid when its centre lies in a box (lower faces included). A box without a centre along an axis takes the
    cell that holds its middle there, so that gas and sight never pass through a thin plate. Boxes outside the grid take
    no cell.
    """
    is_solid = np.zeros(grid.shape, dtype=np.bool_)
    for box in boxes:
        (i0, i1), (j0, j1), (k0, k1) = (
            snap_range(box.min_m[axis], box.max_m[axis], grid, axis, is_outward=False) for axis in range(3)
        )
        is_solid[i0:i1, j0:j1, k0:k1] = True
    return is_solid


def solid_boxes(environment: Environment) -> list[Box]:
    """Return the boxes of a room, with a floor to stand on for a room without one, such as an imported room."""
    boxes = list(environment.boxes)
    doubles = sorted(name for name, n in Counter(box.name for box in boxes).items() if n > 1)
    if doubles:
        raise EnvironmentDataError(f"environment {environment.name}: expected boxes of different names, was {doubles}.")
    if not any(box.kind == "floor" for box in boxes):
        (x0, y0, z0), (x1, y1, _) = environment.grid.origin_m, environment.grid.max_m
        boxes.append(Box(name="floor", kind="floor", min_m=(x0, y0, z0 - 0.2), max_m=(x1, y1, z0)))
    return boxes


def _find_place_problems(wanted: WantedOpening, grid: Grid, face: Face | None) -> list[Problem]:
    low_m, high_m = grid.origin_m, grid.max_m
    min_m, max_m = wanted.spec.min_m, wanted.spec.max_m
    if face is None:
        return [
            Problem(
                where=wanted.path,
                expected=f"a rectangle flat on one face of the room, which reaches from {span_text(low_m, high_m)}",
                found=span_text(min_m, max_m),
                remedy="Give min_m and max_m one coordinate in common, on the face, such as x = 0 in both.",
            )
        ]
    return [
        Problem(
            where=wanted.path,
            expected=f"{_AXES[axis]} inside the face, from {low_m[axis]:g} to {high_m[axis]:g} m",
            found=f"{min_m[axis]:g} to {max_m[axis]:g} m",
        )
        for axis in range(3)
        if axis != face.axis and (min_m[axis] < low_m[axis] - _ON_FACE_M or max_m[axis] > high_m[axis] + _ON_FACE_M)
    ]


# Number of true values before the first false one.
