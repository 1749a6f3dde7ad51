"""GrGSL: a belief over free cells, shaped by hits and the wind of the moment, that goes round obstacles as gas does."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.beliefs import normalised_from_log
from gslcosim.search.grids import CellGrid
from gslcosim.search.maps.gr_gsl_kernels import information_gain_nats, spread_weights
from gslcosim.search.moving.grid_paths import Free, nearest_free
from gslcosim.search.moving.grid_paths_kernels import UNITS_PER_CELL, path_tree

Array = NDArray[np.float64]
Cell = tuple[int, ...]
_NO_DIRECTION = math.nan
# Trees of paths that are kept: those to places that were looked at lately.
_KEPT_TREES = 600


@dataclass(frozen=True, kw_only=True)
class GrGslSettings:
    """How sharply GrGSL reads directions [rad], how far it looks ahead [cells], and how many places it compares."""

    sigma_hit_rad: float = 1.0
    sigma_miss_rad: float = 2.0
    reach_cells: float = 5.0
    candidates: int = 60

    @classmethod
    def of(cls, settings: SimpleNamespace) -> "GrGslSettings":
        """Return the figures that go by these names in the settings of a method's card."""
        return cls(**{item.name: getattr(settings, item.name) for item in fields(cls)})


class GrGsl:
    """Believes where the source is, cell by cell, from hits and misses with the wind at the robot.

    1. A hit favours the cells upwind of the robot, a miss those back towards the last hit; before the first hit a miss
       says only that the source is not right here. What a direction says holds for all cells that the way in that
       direction leads to (`spread_weights`).
    2. The belief is multiplied with these weights and normalised.
    3. Where to measure next is chosen among the free cells within `reach_cells` of way from cells visited: the most
       probable one, or the one that tells most (`information_gain_nats`). Places given up are left out.

    State: the logarithm of the belief, the place of the last hit, cells visited, cells in reach, cells given up, and
    the trees of paths from cells that were looked at (which depend on the room alone).

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2021, Evaluation of gas source localization algorithms, RA-L; parameters as in
        the group's public code [C].
    Deviation:
        In the public code the place of the last hit begins at the start; here there is none. A hit without a wind is
        skipped. At most `candidates` places are compared, the most probable ones.
    Held by:
        tests/unit/search/maps/test_gr_gsl.py
    """

    def __init__(
        self, free: Free, grid: CellGrid, settings: GrGslSettings | None = None, *, flyable: Free | None = None
    ) -> None:
        """Begin without knowledge: all free cells are equally likely.

        Args:
            free: (nx, ny) cells that gas can reach.
            grid: The cells.
            settings: Its figures.
            flyable: Those of them that the robot can be sent to; absent: all.
        """
        self.free, self.grid = np.ascontiguousarray(free), grid
        self.settings = settings or GrGslSettings()
        self.last_hit_m: tuple[float, ...] | None = None
        self._log_p = np.where(free, 0.0, -np.inf)
        self._is_open = np.zeros(free.shape, np.bool_)
        self._is_closed = np.zeros(free.shape, np.bool_) if flyable is None else ~flyable
        self._trees: dict[Cell, tuple[NDArray[np.int64], NDArray[np.int32]]] = {}

    @property
    def p(self) -> Array:
        """The belief: (nx, ny) probabilities, 0 in solid cells."""
        return normalised_from_log(self._log_p)

    def update(self, point_m: Sequence[float], *, is_hit: bool, downwind_rad: float | None) -> None:
        """Take in a measurement at a point: gas or none, and where the wind goes [rad]; None when it is calm."""
        self.visit(point_m)
        if is_hit and downwind_rad is None:
            return
        cell = self._cell(point_m)
        weight = self._hit_weight(cell, downwind_rad) if is_hit else self._miss_weight(cell)
        with np.errstate(divide="ignore"):
            self._log_p = self._log_p + np.log(weight).reshape(self.free.shape)
        self._log_p -= self._log_p.max()
        if is_hit:
            self.last_hit_m = self.grid.centre_m(cell)

    def visit(self, point_m: Sequence[float]) -> None:
        """Take note of a place where the robot was: cells near it come into reach, and it is no goal any more."""
        cell = self._cell(point_m)
        length, _ = self._tree(cell)
        reach = self.settings.reach_cells * UNITS_PER_CELL
        self._is_open |= ((length >= 0) & (length <= reach)).reshape(self.free.shape)
        self._is_closed[cell] = True

    def give_up(self, point_m: Sequence[float]) -> None:
        """Leave the cell of a place out from now on: it cannot be flown to."""
        self._is_closed[self._cell(point_m)] = True

    def candidates(self) -> list[Cell]:
        """Return the cells that are in reach and not visited, at most `candidates`, the most probable ones first."""
        cells = np.argwhere(self._is_open & ~self._is_closed)
        likely = np.argsort(-self._log_p[tuple(cells.T)], kind="stable")[: self.settings.candidates]
        return [(int(i), int(j)) for i, j in cells[likely]]

    def most_likely(self, point_m: Sequence[float]) -> Cell | None:
        """Return the cell in reach with the highest belief, of equal ones the farthest; None when none is left."""
        is_left = self._is_open & ~self._is_closed
        if not is_left.any():
            return None
        best = is_left & (self._log_p >= self._log_p[is_left].max() - 1e-9)
        length, _ = self._tree(self._cell(point_m))
        farthest = np.where(best, length.reshape(self.free.shape), -2).argmax()
        i, j = np.unravel_index(int(farthest), self.free.shape)
        return int(i), int(j)

    def most_informative(self, wind_m_s: Array) -> Cell | None:
        """Return the candidate whose measurement is expected to change the belief most; None when none is left.

        Args:
            wind_m_s: (nx, ny, 2) wind as it is thought to be, world frame [m/s].
        """
        p, candidates = self.p.reshape(-1), self.candidates()
        gains = [self._gain_nats(cell, p, wind_m_s[cell]) for cell in candidates]
        return candidates[int(np.argmax(gains))] if candidates else None

    def _gain_nats(self, cell: Cell, p: Array, wind_m_s: Array) -> float:
        downwind_rad = math.atan2(wind_m_s[1], wind_m_s[0]) if wind_m_s.any() else _NO_DIRECTION
        return information_gain_nats(p, self._hit_weight(cell, downwind_rad), self._miss_weight(cell))

    def _hit_weight(self, cell: Cell, downwind_rad: float | None) -> Array:
        length, order = self._tree(cell)
        direction_rad = _NO_DIRECTION if downwind_rad is None else downwind_rad
        return spread_weights(self.free, length, order, direction_rad, self.settings.sigma_hit_rad, 0.0)

    def _miss_weight(self, cell: Cell) -> Array:
        length, order = self._tree(cell)
        direction_rad = self._from_last_hit_rad(self.grid.centre_m(cell))
        return spread_weights(self.free, length, order, direction_rad, self.settings.sigma_miss_rad, math.pi)

    def _from_last_hit_rad(self, point_m: Sequence[float]) -> float:
        if self.last_hit_m is None or math.dist(point_m, self.last_hit_m) < 0.5 * self.grid.cell_m:
            return _NO_DIRECTION
        return math.atan2(point_m[1] - self.last_hit_m[1], point_m[0] - self.last_hit_m[0])

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


def warm_up() -> None:
    """Load or compile what a search runs, on a few cells, so that nothing is compiled in flight."""
    free = np.ones((6, 6), np.bool_)
    method = GrGsl(free, CellGrid((0.0, 0.0), 1.0, free.shape))
    for is_hit in (True, False):
        method.update((2.0, 2.0), is_hit=is_hit, downwind_rad=0.0)
    method.most_informative(np.ones((6, 6, 2)))
