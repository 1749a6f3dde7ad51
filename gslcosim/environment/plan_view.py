"""Plan view of a room: solids at a height and below it, openings, and arrows of wind.

Recordings, pictures, films, figures and reports draw it, each with a painter of its own.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Box, Cell, Environment, EnvironmentGeometry, Grid, Opening
from gslcosim.environment.variants import find_door_boxes

# An arrow of `REFERENCE_LENGTH_SPACINGS` stands for this percentile of the speeds of all arrows. With the maximum
# instead, the few jets at inlets would turn all other arrows into dots.
REFERENCE_PERCENTILE = 80
REFERENCE_LENGTH_SPACINGS = 0.9
MAX_LENGTH_SPACINGS = 1.3

Extent = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class PlanOpening:
    """An inlet, an outlet or an open side from above.

    Attributes:
        opening: The opening.
        corners_m: Two opposite corners (x, y), world frame [m]: the ends of a line where it lies at a side.
        inward: Unit vector (x, y) into the room; (0, 0) where it lies in the floor or the ceiling.
    """

    opening: Opening
    corners_m: tuple[tuple[float, float], tuple[float, float]]
    inward: tuple[float, float]

    @property
    def is_inlet(self) -> bool:
        """True for an inlet."""
        return self.opening.kind == "inlet"

    @property
    def is_at_side(self) -> bool:
        """True for a line at a side; otherwise it is a rectangle in the floor or the ceiling."""
        return self.inward != (0.0, 0.0)

    def path_m(self) -> list[tuple[float, float]]:
        """Return the points (x, y) of its line, world frame [m]: that of a rectangle is closed."""
        (x0, y0), (x1, y1) = self.corners_m
        return [(x0, y0), (x1, y1)] if self.is_at_side else [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanView:
    """A room from above, cut at a height.

    Attributes:
        room: The room.
        height_m: Height of the cut, world frame [m].
        layer: Index along z of the cells at the cut; the lowest or topmost for a cut outside the grid.
    """

    room: Environment | EnvironmentGeometry
    height_m: float
    layer: int

    @classmethod
    def of(cls, room: Environment | EnvironmentGeometry, height_m: float) -> "PlanView":
        """Return the plan of a room at a height [m]."""
        return cls(room=room, height_m=height_m, layer=room.grid.index_at(2, height_m))

    @property
    def grid(self) -> Grid:
        """The cells of the room."""
        return self.room.grid

    @property
    def extent_m(self) -> Extent:
        """Sides of the plan: least and greatest x, least and greatest y, world frame [m]."""
        (x0, y0, _), (x1, y1, _) = self.grid.origin_m, self.grid.max_m
        return x0, x1, y0, y1

    @cached_property
    def solid(self) -> NDArray[np.bool_]:
        """True in the (nx, ny) cells that are solid at the height."""
        return self.room.occupancy[:, :, self.layer] == Cell.SOLID

    @cached_property
    def below(self) -> NDArray[np.bool_]:
        """True in the (nx, ny) cells that are air at the height and solid somewhere below it."""
        return (self.room.occupancy[:, :, : self.layer] == Cell.SOLID).any(axis=2) & ~self.solid

    @cached_property
    def openings(self) -> tuple[PlanOpening, ...]:
        """Openings of the room, in their order."""
        return tuple(self._seen_from_above(opening) for opening in self.room.openings)

    def _seen_from_above(self, opening: Opening) -> PlanOpening:
        (x0, y0, _), (x1, y1, _) = opening.min_m, opening.max_m
        from_x, to_x, from_y, to_y = self.extent_m
        inward = (0.0, 0.0)
        if x0 == x1:
            inward = (1.0 if x0 < (from_x + to_x) / 2 else -1.0, 0.0)
        elif y0 == y1:
            inward = (0.0, 1.0 if y0 < (from_y + to_y) / 2 else -1.0)
        return PlanOpening(opening=opening, corners_m=((x0, y0), (x1, y1)), inward=inward)

    def outline_m(self, cells: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the border of some of the (nx, ny) cells as (n, 2, 2) straight lines: ends, then (x, y) [m]."""
        lines = np.concatenate([_border_lines(cells), _border_lines(cells.T)[..., ::-1]]).astype(np.float64)
        return np.array(self.grid.origin_m[:2]) + lines * self.grid.cell_m


# Border lines of cells along y, in cells: (n, 2, 2).
def _border_lines(cells: NDArray[np.bool_]) -> NDArray[np.int64]:
    padded = np.pad(cells, 1)
    # A line continues only where the same side of it is solid.
    side = np.diff(padded.astype(np.int8), axis=0)[:, 1:-1]
    lines = [np.zeros((0, 2, 2), dtype=np.int64)]
    for sign in (1, -1):
        turns = np.diff(np.pad(side == sign, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        starts, ends = np.argwhere(turns == 1), np.argwhere(turns == -1)
        lines.append(np.stack([starts, ends], axis=1))
    return np.concatenate(lines)


def is_cut(box: Box, height_m: float) -> bool:
    """Return whether a horizontal plane at a height [m] goes through a box."""
    return box.min_m[2] <= height_m < box.max_m[2]


def visible_boxes(environment: Environment) -> list[Box]:
    """Return the obstacles and the walls inside the room, without doors that move.

    The outer walls lie outside its air: plans and recordings have an outline in their place.
    """
    low_m, high_m = np.array(environment.grid.origin_m), np.array(environment.grid.max_m)
    moving = {box.name for box in find_door_boxes(environment)}
    return [
        box
        for box in environment.boxes
        if box.name not in moving and (box.kind == "obstacle" or _stands_inside(box, low_m, high_m))
    ]


def _stands_inside(box: Box, low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> bool:
    return box.kind == "wall" and bool(np.all(np.array(box.max_m) > low_m) and np.all(np.array(box.min_m) < high_m))


def space_arrows(is_air: NDArray[np.bool_], per_side: int) -> tuple[NDArray[np.int64], int]:
    """Return the cells of a plane with arrows.

    Args:
        is_air: (n, m) cells of the plane that are air; the others have no arrow.
        per_side: Approximate number of arrows along the longer side.

    Returns:
        (k, 2) indices of cells, and the spacing of arrows in cells. An arrow represents a square of that side around
        the cell, with its middle `(cells + spacing / 2 - spacing // 2)` cells from the corner of the plane.
    """
    spacing = max(1, round(max(is_air.shape) / per_side))
    some = slice(spacing // 2, None, spacing)
    return np.argwhere(is_air[some, some]) * spacing + spacing // 2, spacing


def scale_of_arrows(speeds_m_s: NDArray[np.floating], spacing_m: float) -> float:
    """Return the length of an arrow per speed [m per m/s]; 0 in still air.

    Args:
        speeds_m_s: (…) speeds at all arrows.
        spacing_m: Their spacing [m], or in any other unit of the drawing.
    """
    reference_m_s = float(np.percentile(speeds_m_s, REFERENCE_PERCENTILE)) if speeds_m_s.size else 0.0
    return REFERENCE_LENGTH_SPACINGS * spacing_m / reference_m_s if reference_m_s > 0 else 0.0


def arrow_vectors(winds_m_s: NDArray[np.floating], spacing_m: float, m_per_m_s: float) -> NDArray[np.floating]:
    """Return (…, k) arrows for winds (…, k) [m/s], proportional to the speed up to `MAX_LENGTH_SPACINGS`."""
    lengths_m = np.linalg.norm(winds_m_s, axis=-1) * m_per_m_s
    shorten = np.minimum(1.0, MAX_LENGTH_SPACINGS * spacing_m / np.maximum(lengths_m, 1e-9))
    return winds_m_s * (m_per_m_s * shorten)[..., None]
