"""Occupancy map of a room: solid points, free lines, and the free cells of a grid.

Held by:
    extensions/search/tests/unit/motion/test_legs.py
    extensions/search/tests/unit/test_occupancy.py
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import KnownMap
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.elementary import distance

Free = NDArray[np.bool_]
Point = tuple[float, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class OccupancyMap:
    """Solid cells of a room: shape (nx, ny) or (nx, ny, nz), the lower corner and the edge of the cells [m]."""

    origin_m: Point
    cell_m: float
    solid: NDArray[np.bool_]

    @classmethod
    def of(cls, known_map: KnownMap, *, height_m: float | None = None, clearance_m: float = 0.0) -> Self:
        """Return the solid cells of a granted map, inflated by a clearance.

        Args:
            height_m: Cut a map with three axes at this height [m].
            clearance_m: Cells whose centres are no farther from a solid cell's centre than this are solid too [m].
        """
        solid = known_map.occupied.to_array() != 0
        origin_m: Point = known_map.origin_m
        if solid.ndim == 3 and height_m is not None:
            level = math.floor((height_m - origin_m[2]) / known_map.cell_m)
            solid = solid[:, :, max(0, min(solid.shape[2] - 1, level))]
        grown = _grown(solid, clearance_m / known_map.cell_m)
        return cls(origin_m=origin_m[: solid.ndim], cell_m=known_map.cell_m, solid=grown)

    def free_at_centres(self, grid: CellGrid) -> Free:
        """Return the cells of a grid whose centres lie in free cells of the map; outside of the map none is.

        A map in space is cut to the plane for a grid in the plane at its middle; a plane map holds at all heights.
        """
        solid = self.solid
        if grid.dimensions < solid.ndim:
            solid = solid[:, :, solid.shape[2] // 2]
        offsets_m = grid.centres_m()[:, : solid.ndim] - self.origin_m[: solid.ndim]
        index = np.floor(offsets_m / self.cell_m).astype(np.int64)
        inside = np.all((index >= 0) & (index < solid.shape), axis=1)
        free = np.zeros(grid.n_cells, np.bool_)
        free[inside] = ~solid[tuple(index[inside].T)]
        return free.reshape(grid.shape)

    def free_throughout(self, grid: CellGrid) -> Free:
        """Return the cells of a grid in the plane that nothing solid reaches into; outside of the map none is free.

        A wall thinner than a cell stays a wall: gas and ways do not slip through. Gaps narrower than two cells may
        close. The map has two axes.
        """
        solid_before = np.zeros((self.solid.shape[0] + 1, self.solid.shape[1] + 1), np.int64)
        solid_before[1:, 1:] = self.solid.cumsum(axis=0).cumsum(axis=1)
        (x_low, x_high, x_inside), (y_low, y_high, y_inside) = (self._overlapped(grid, axis) for axis in (0, 1))
        n_solid = (
            solid_before[np.ix_(x_high, y_high)]
            - solid_before[np.ix_(x_low, y_high)]
            - solid_before[np.ix_(x_high, y_low)]
            + solid_before[np.ix_(x_low, y_low)]
        )
        return (n_solid == 0) & x_inside[:, None] & y_inside[None, :]

    # First and last cell but one of the map that each cell reaches into along an axis, and if its centre is inside.
    def _overlapped(self, grid: CellGrid, axis: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Free]:
        n = self.solid.shape[axis]
        low = (grid.axis_m(axis) - 0.5 * grid.cell_m - self.origin_m[axis]) / self.cell_m
        high = low + grid.cell_m / self.cell_m
        middle = 0.5 * (low + high)
        first = np.clip(np.floor(low + 1e-6), 0, n).astype(np.int64)
        last = np.clip(np.ceil(high - 1e-6), 0, n).astype(np.int64)
        return first, np.maximum(last, first), (middle >= 0) & (middle < n)

    def is_solid(self, point_m: Sequence[float]) -> bool:
        """Return True if a point is in a solid cell; outside the cells nothing is known to be solid."""
        index = tuple(math.floor((x - low) / self.cell_m) for x, low in zip(point_m, self.origin_m))
        return all(0 <= i < n for i, n in zip(index, self.solid.shape)) and bool(self.solid[index])

    def is_free_line(self, start_m: Sequence[float], end_m: Sequence[float]) -> bool:
        """Return True if a straight line meets no solid cell.

        The line is cut where it crosses the planes between cells; the middle of each piece tells its cell. Cells that
        the line touches in an edge only do not count. A line that begins in a solid cell, where the vehicle is already
        (a map may be coarser than the vehicle's own sight), may leave it.
        """
        cuts = sorted({0.0, 1.0, *self._crossings(start_m, end_m)})
        middles = ((a + b) / 2.0 for a, b in pairwise(cuts))
        hits = [self.is_solid([s + t * (e - s) for s, e in zip(start_m, end_m)]) for t in middles]
        n_leaving = next((i for i, is_hit in enumerate(hits) if not is_hit), 0)
        return not any(hits[n_leaving:])

    # Fractions of the way at which the line passes from a cell to the next.
    def _crossings(self, start_m: Sequence[float], end_m: Sequence[float]) -> Iterator[float]:
        for start, end, low in zip(start_m, end_m, self.origin_m):
            a, b = sorted(((start - low) / self.cell_m, (end - low) / self.cell_m))
            for plane in range(math.ceil(a), math.floor(b) + 1):
                t = (low + plane * self.cell_m - start) / (end - start) if end != start else 0.0
                if 0.0 < t < 1.0:
                    yield t


def free_cells(known_map: KnownMap | None, grid: CellGrid) -> Free:
    """Return the cells of a grid that are free at their centres; all of them without a map."""
    return np.ones(grid.shape, np.bool_) if known_map is None else OccupancyMap.of(known_map).free_at_centres(grid)


# Every cell whose centre is within so many cells of a solid one.
def _grown(solid: NDArray[np.bool_], radius_cells: float) -> NDArray[np.bool_]:
    reach = math.floor(radius_cells)
    if reach < 1:
        return solid
    padded = np.pad(solid, reach)
    grown = np.zeros_like(solid)
    for offset in np.ndindex((2 * reach + 1,) * solid.ndim):
        if distance(offset, (reach,) * solid.ndim) <= radius_cells:
            grown |= padded[tuple(slice(i, i + n) for i, n in zip(offset, solid.shape))]
    return grown
