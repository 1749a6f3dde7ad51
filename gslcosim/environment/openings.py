"""Openings and boxes: the face of the environment on which each lies, and how they become whole cells."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import OBSTACLE_RGBA, Box, Environment, Grid, Opening, point_text
from gslcosim.scenario.models.scenario import OpeningSpec

# Width (along y) and height of inlet and outlet, Table 9.2 of the GSL-Bench thesis.
THESIS_OPENING_M = (1.5, 2.4)
# Small rooms: an opening takes at most these shares of the room's y and z size (chosen; 15 x 15 x 8 m is not affected).
MAX_WIDTH_FRAC, MAX_HEIGHT_FRAC = 0.4, 0.6

_AXES = "xyz"
# How far from a face an opening may be written and still be meant to lie on it [m].
_ON_FACE_M = 1e-6


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
        """The sign of a velocity along `axis` that enters the room through this face."""
        return -1 if self.is_upper else 1

    def coordinate_m(self, grid: Grid) -> float:
        """Return where the face lies on its axis, world frame [m]."""
        return grid.max_m[self.axis] if self.is_upper else grid.origin_m[self.axis]


FACES = tuple(Face(axis=axis, is_upper=is_upper) for axis in range(3) for is_upper in (False, True))


def default_inlet(size_m: Vec3, opening_m: tuple[float, float] | None = None) -> OpeningSpec:
    """Return the thesis's inlet: on the face x = 0, from the corner y = 0, on the floor; `opening_m` is y by z."""
    width_m, height_m = opening_m or _default_size_m(size_m)
    return OpeningSpec(min_m=(0.0, 0.0, 0.0), max_m=(0.0, width_m, height_m))


def default_outlet(size_m: Vec3, opening_m: tuple[float, float] | None = None) -> OpeningSpec:
    """Return the thesis's outlet: as large as the inlet, on the face x = x_max, in the far corner."""
    width_m, height_m = opening_m or _default_size_m(size_m)
    x_m, y_m, _ = size_m
    return OpeningSpec(min_m=(x_m, y_m - width_m, 0.0), max_m=(x_m, y_m, height_m))


def find_face(opening: OpeningSpec | Opening, grid: Grid) -> Face | None:
    """Return the face of the room that an opening lies flat on, if there is one."""
    for face in FACES:
        where_m = face.coordinate_m(grid)
        corners_m = (opening.min_m[face.axis], opening.max_m[face.axis])
        if all(abs(corner_m - where_m) <= _ON_FACE_M for corner_m in corners_m):
            return face
    return None


def find_opening_problems(opening: OpeningSpec, grid: Grid, path: str) -> list[Problem]:
    """Return what is wrong with the place of an opening; `path` is where it stands in the scenario."""
    face = find_face(opening, grid)
    if face is None:
        return [
            Problem(
                where=path,
                expected=f"a rectangle flat on one face of the room, {_span(grid)}",
                found=f"{_box(opening.min_m, opening.max_m)}",
                remedy="Give min_m and max_m one coordinate in common, on the face, such as x = 0 in both.",
            )
        ]
    problems: list[Problem] = []
    for axis in (axis for axis in range(3) if axis != face.axis):
        low_m, high_m = opening.min_m[axis], opening.max_m[axis]
        room_low_m, room_high_m = grid.origin_m[axis], grid.max_m[axis]
        if low_m < room_low_m - _ON_FACE_M or high_m > room_high_m + _ON_FACE_M:
            problems.append(
                Problem(
                    where=path,
                    expected=f"{_AXES[axis]} inside the face, from {room_low_m:g} to {room_high_m:g} m",
                    found=f"{low_m:g} to {high_m:g} m",
                )
            )
    return problems


def snap_to_cells(opening: OpeningSpec, grid: Grid, face: Face) -> tuple[Vec3, Vec3]:
    """Return an opening's corners (min, max) [m] moved to borders of cells, at least one cell wide.

    Each edge goes to the nearest border; an edge half-way goes outward, so 1.5 m becomes 1.6 m with 0.2 m cells.
    """
    lows_m: list[float] = []
    highs_m: list[float] = []
    for axis in range(3):
        if axis == face.axis:
            lows_m.append(face.coordinate_m(grid))
            highs_m.append(face.coordinate_m(grid))
            continue
        first, last = snap_range(opening.min_m[axis], opening.max_m[axis], grid, axis, is_outward=True)
        lows_m.append(border_m(grid, axis, first))
        highs_m.append(border_m(grid, axis, last))
    return (lows_m[0], lows_m[1], lows_m[2]), (highs_m[0], highs_m[1], highs_m[2])


def snap_range(low_m: float, high_m: float, grid: Grid, axis: int, *, is_outward: bool) -> tuple[int, int]:
    """Return the cells [first, last) of a span on one axis, clipped to the grid, at least one where it overlaps it.

    Ends go to the nearest border of cells. An end half-way between two borders goes outward or, otherwise, up, which
    takes the cells whose centre lies in [low_m, high_m).
    A span that would vanish takes the cell that holds its middle; first == last: nothing of it lies in the grid.
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
    """Return the coordinate [m] of the lower border of cells i, free of the last digits of a float product."""
    if i == grid.shape[axis]:
        return grid.max_m[axis]
    return round(grid.origin_m[axis] + i * grid.cell_m, 9)


def cells_at(opening: Opening, grid: Grid) -> tuple[slice, slice, slice]:
    """Return the layer of cells, one deep, that an opening on the room's face touches.

    Raises:
        ValueError: the opening is on no face of the grid.
    """
    face = find_face(opening, grid)
    if face is None:
        raise ValueError(f"opening {opening.name} is on no face of the grid: {_box(opening.min_m, opening.max_m)}")
    slices: list[slice] = []
    for axis in range(3):
        if axis == face.axis:
            slices.append(slice(-1, None) if face.is_upper else slice(0, 1))
        else:
            slices.append(slice(*snap_range(opening.min_m[axis], opening.max_m[axis], grid, axis, is_outward=True)))
    return slices[0], slices[1], slices[2]


def are_overlapping(a: Opening, b: Opening, grid: Grid) -> bool:
    """Return whether two openings lie on one face and share a part of it, not only an edge."""
    face = find_face(a, grid)
    if face is None or face != find_face(b, grid):
        return False
    return all(
        min(a.max_m[axis], b.max_m[axis]) - max(a.min_m[axis], b.min_m[axis]) > _ON_FACE_M
        for axis in range(3)
        if axis != face.axis
    )


def find_inflow_problems(velocity_m_s: Vec3, face: Face) -> Sequence[Problem]:
    """Return what is wrong with the wind at an inlet: still air is fine, air that does not enter is not."""
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


def describe_snapping(kind: str, before: OpeningSpec, after: tuple[Vec3, Vec3], cell_m: float) -> str | None:
    """Return a sentence that says how far an opening moved to whole cells; nothing when it did not."""
    moved_m = max(abs(b - a) for b, a in zip((*before.min_m, *before.max_m), (*after[0], *after[1]), strict=True))
    if moved_m <= _ON_FACE_M:
        return None
    return (
        f"The {kind} {_box(before.min_m, before.max_m)} is taken as {_box(*after)}, "
        f"which is whole cells of {cell_m:g} m."
    )


def _default_size_m(size_m: Vec3) -> tuple[float, float]:
    width_m, height_m = THESIS_OPENING_M
    return min(width_m, MAX_WIDTH_FRAC * size_m[1]), min(height_m, MAX_HEIGHT_FRAC * size_m[2])


def _box(min_m: Vec3, max_m: Vec3) -> str:
    return f"{point_text(min_m)} to {point_text(max_m)} m"


def _span(grid: Grid) -> str:
    return f"which reaches from {point_text(grid.origin_m)} to {point_text(grid.max_m)} m"


def voxelize(boxes: Iterable[Box], grid: Grid) -> NDArray[np.bool_]:
    """Return which of the (nx, ny, nz) cells are solid.

    A cell is solid when its centre lies in a box (its lower faces included). A box that is thinner than a cell and
    holds no centre along an axis takes the cell that holds its middle there, so that gas and sight never pass
    through a thin plate. Boxes outside the grid take no cell.
    """
    is_solid = np.zeros(grid.shape, dtype=np.bool_)
    for box in boxes:
        (i0, i1), (j0, j1), (k0, k1) = (
            snap_range(box.min_m[axis], box.max_m[axis], grid, axis, is_outward=False) for axis in range(3)
        )
        is_solid[i0:i1, j0:j1, k0:k1] = True
    return is_solid


Cells = tuple[slice, slice, slice]


def boxes_from_solid(is_solid: NDArray[np.bool_], grid: Grid) -> tuple[Box, ...]:
    """Return boxes named `solid_0`, `solid_1`, … that together hold exactly the solid cells, without overlap.

    Each box starts at the first cell not yet held, in index order, and grows as far as it can along x, then y, then z.
    That is not the least number of boxes, but a few per straight wall or shelf.
    """
    left = is_solid.copy()
    boxes: list[Box] = []
    # Cells are taken off `left` as boxes grow; those already taken are passed over.
    for i, j, k in np.argwhere(is_solid).tolist():
        if not left[i, j, k]:
            continue
        cells = _grown(left, i, j, k)
        left[cells] = False
        low = (grid.origin_m[axis] + cells[axis].start * grid.cell_m for axis in range(3))
        high = (grid.origin_m[axis] + cells[axis].stop * grid.cell_m for axis in range(3))
        x0, y0, z0, x1, y1, z1 = (round(corner_m, 9) for corner_m in (*low, *high))
        boxes.append(
            Box(
                name=f"solid_{len(boxes)}",
                kind="obstacle",
                min_m=(x0, y0, z0),
                max_m=(x1, y1, z1),
                rgba=OBSTACLE_RGBA,
            )
        )
    return tuple(boxes)


def _grown(left: NDArray[np.bool_], i: int, j: int, k: int) -> Cells:
    i1 = i + _run(left[i:, j, k])
    j1 = j + _run(np.asarray(left[i:i1, j:, k].all(axis=0)))
    k1 = k + _run(np.asarray(left[i:i1, j:j1, k:].all(axis=(0, 1))))
    return slice(i, i1), slice(j, j1), slice(k, k1)


# How many values are true before the first that is not.
def _run(values: NDArray[np.bool_]) -> int:
    return len(values) if values.all() else int(np.argmin(values))


def solid_boxes(environment: Environment) -> list[Box]:
    """Return the boxes of a room; one without a floor of its own (an imported one, say) gets one to stand on.

    Raises:
        EnvironmentDataError: two boxes have one name.
    """
    boxes = list(environment.boxes)
    doubles = sorted(name for name, n in Counter(box.name for box in boxes).items() if n > 1)
    if doubles:
        raise EnvironmentDataError(f"environment {environment.name}: expected boxes of different names, was {doubles}.")
    if not any(box.kind == "floor" for box in boxes):
        (x0, y0, z0), (x1, y1, _) = environment.grid.origin_m, environment.grid.max_m
        boxes.append(Box(name="floor", kind="floor", min_m=(x0, y0, z0 - 0.2), max_m=(x1, y1, z0)))
    return boxes
