"""Grids of cells over a room, in the plane or in space, on which methods keep what they believe."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Bounds, KnownMap


@dataclass(frozen=True)
class CellGrid:
    """Equal cells: squares in the plane (2 numbers each) or cubes (3). The first cell touches `origin_m`.

    Arrays over the cells have the grid's shape, index order (x, y) or (x, y, z); flat arrays are in C order.
    """

    origin_m: tuple[float, ...]
    cell_m: float
    shape: tuple[int, ...]

    @classmethod
    def covering(
        cls, bounds: Bounds, cell_m: float, dimensions: Literal[2, 3] = 2, *, max_cells: int | None = None
    ) -> Self:
        """Return a grid over a box, the last cells of each axis cut by nothing: they may reach beyond the box.

        Args:
            bounds: The box, world frame [m].
            cell_m: Edge of a cell [m].
            dimensions: 2 for the floor plan, 3 for the volume.
            max_cells: With this, cells grow until there are at most so many.
        """
        low, high = bounds.min_m[:dimensions], bounds.max_m[:dimensions]
        spans_m = [b - a for a, b in zip(low, high, strict=True)]
        shape = _counts(spans_m, cell_m)
        while max_cells is not None and math.prod(shape) > max_cells:
            cell_m *= 1.05
            shape = _counts(spans_m, cell_m)
        return cls(tuple(low), cell_m, shape)

    @classmethod
    def of_map(cls, known_map: KnownMap) -> Self:
        """Return the grid of a granted map."""
        shape = known_map.occupied.shape
        return cls(known_map.origin_m[: len(shape)], known_map.cell_m, shape)

    @property
    def dimensions(self) -> int:
        """2 in the plane, 3 in space."""
        return len(self.shape)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    def centres_m(self) -> NDArray[np.float64]:
        """Return the (n_cells, dimensions) centres of the cells, world frame [m], in C order."""
        axes_m = [self.axis_m(axis) for axis in range(self.dimensions)]
        return np.stack(np.meshgrid(*axes_m, indexing="ij"), axis=-1).reshape(-1, self.dimensions)

    def axis_m(self, axis: int) -> NDArray[np.float64]:
        """Return the coordinates of the centres along an axis, world frame [m]."""
        return self.origin_m[axis] + (np.arange(self.shape[axis], dtype=np.float64) + 0.5) * self.cell_m

    def index_at(self, point_m: Sequence[float]) -> tuple[int, ...]:
        """Return the index of the cell that holds a point; it may lie outside. Further coordinates are ignored."""
        pairs = zip(point_m[: self.dimensions], self.origin_m, strict=True)
        return tuple(math.floor((value - low) / self.cell_m) for value, low in pairs)

    def cell_at(self, point_m: Sequence[float]) -> tuple[int, ...] | None:
        """Return the index of the cell that holds a point, None outside the grid."""
        index = self.index_at(point_m)
        return index if self.contains(index) else None

    def nearest_cell(self, point_m: Sequence[float]) -> tuple[int, ...]:
        """Return the index of the cell nearest to a point."""
        return tuple(min(max(i, 0), n - 1) for i, n in zip(self.index_at(point_m), self.shape, strict=True))

    def contains(self, index: Sequence[int]) -> bool:
        """Return whether an index is one of the grid's."""
        return all(0 <= i < n for i, n in zip(index, self.shape, strict=True))

    def centre_m(self, index: Sequence[int]) -> tuple[float, ...]:
        """Return the centre of a cell, world frame [m]."""
        return tuple(low + (i + 0.5) * self.cell_m for low, i in zip(self.origin_m, index, strict=True))

    def free_cells(self, known_map: KnownMap) -> NDArray[np.bool_]:
        """Return which cells are free in a map: their centres lie in free cells of it. Outside of the map none is.

        A map in space is cut to the plane for a grid in the plane at its middle; a plane map holds at all heights.
        """
        occupied = known_map.occupied.to_array()
        if self.dimensions < occupied.ndim:
            occupied = occupied[:, :, occupied.shape[2] // 2]
        of_map = CellGrid(known_map.origin_m[: occupied.ndim], known_map.cell_m, occupied.shape)
        index = np.floor((self.centres_m()[:, : occupied.ndim] - of_map.origin_m) / of_map.cell_m).astype(np.int64)
        inside = np.all((index >= 0) & (index < occupied.shape), axis=1)
        free = np.zeros(self.n_cells, np.bool_)
        free[inside] = occupied[tuple(index[inside].T)] == 0
        return free.reshape(self.shape)


def _counts(spans_m: Sequence[float], cell_m: float) -> tuple[int, ...]:
    return tuple(max(1, math.ceil(span_m / cell_m - 1e-9)) for span_m in spans_m)
