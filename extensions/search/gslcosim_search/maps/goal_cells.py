"""Cells of a room to which a search from stop to stop may go next."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.motion.grid_paths import UNITS_PER_CELL, Free, nearest_free, path_tree

Cell = tuple[int, ...]

# Trees of paths that are kept: those to places that were looked at lately.
_KEPT_TREES = 600


class GoalCells:
    """The cells within reach of those visited, without those visited themselves and those given up.

    State: cells in reach, cells visited or given up, and the trees of paths from cells that were looked at (which
    depend on the room alone).
    """

    def __init__(self, free: Free, grid: CellGrid, *, reach_cells: float, flyable: Free | None = None) -> None:
        """Begin without a cell in reach.

        Args:
            free: (nx, ny) cells that gas can reach.
            reach_cells: How far from a visited cell goals may lie, along the way [cells].
            flyable: Those of the free cells that the robot can be sent to; absent: all.
        """
        self.free, self.grid = np.ascontiguousarray(free), grid
        self._reach_cells = reach_cells
        self._is_open = np.zeros(free.shape, np.bool_)
        self._is_closed = np.zeros(free.shape, np.bool_) if flyable is None else ~flyable
        self._trees: dict[Cell, tuple[NDArray[np.int64], NDArray[np.int32]]] = {}

    def visit(self, point_m: Sequence[float]) -> None:
        """Take note of a place where the robot was: cells near it come into reach, and it is no goal any more."""
        cell = self._cell(point_m)
        length, _ = self._tree(cell)
        reach = self._reach_cells * UNITS_PER_CELL
        self._is_open |= ((length >= 0) & (length <= reach)).reshape(self.free.shape)
        self._is_closed[cell] = True

    def give_up(self, point_m: Sequence[float]) -> None:
        """Leave the cell of a place out from now on: it cannot be flown to."""
        self._is_closed[self._cell(point_m)] = True

    # Length of the way to each cell, and the cells by it; flat.
    def _tree(self, cell: Cell) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        if cell not in self._trees:
            if len(self._trees) >= _KEPT_TREES:
                self._trees.pop(next(iter(self._trees)))
            length, _, order = path_tree(self.free[:, :, None], int(np.ravel_multi_index(cell, self.free.shape)))
            self._trees[cell] = (length, order)
        return self._trees[cell]

    def _cell(self, point_m: Sequence[float]) -> Cell:
        cell = nearest_free(self.free, self.grid, point_m)
        assert cell is not None, "a room without a free cell is refused before"
        return cell
