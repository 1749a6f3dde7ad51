# pyright: basic
"""GrGSL: a belief over free cells, shaped by hits and the wind of the moment, that goes round obstacles as gas does.

Held by:
    extensions/search/tests/unit/maps/test_gr_gsl.py
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid, normalised_from_log
from gslcosim_search.elementary import distance
from gslcosim_search.maps.goal_cells import Cell, GoalCells
from gslcosim_search.motion.grid_paths import STEP_UNITS, Free

# A way of more than three steps to a cell of the window leads around something.
_WINDOW_UNITS = 3 * STEP_UNITS[1]
# Paths that differ by less than a tenth of a cell count as equally long.
_TIE_UNITS = STEP_UNITS[1] // 10
Array = NDArray[np.float64]
_NO_DIRECTION = math.nan
# Logarithms of probabilities closer than this are those of equal ones, rounded.
_EQUAL = 1e-9


@numba.njit(cache=True, nogil=True)
def spread_weights(free, length, order, direction_rad, sigma_rad, core_rad):
    """Give every cell the weight of the neighbouring cell through which the robot's way to it leads.

    psi = direction from the cell to the robot, a = |psi - direction| in [0, pi]
    w = exp(-a^2 / (2 sigma^2))            in the 5 x 5 cells around the robot, but its 3 x 3 core
    w = exp(-core^2 / (2 sigma^2))         in the core
    w(c) = max of w(n) over the neighbours n of c with L(n) + step(n, c) <= L(c) + 0.1 cells, elsewhere
    pure numbers; L is the length of the shortest path from the robot.

    Args:
        free: (nx, ny) bool, whether a cell is free; index order ij.
        length: (nx ny,) lengths of the shortest paths from the robot's cell, as of `path_tree` [units].
        order: (n_reached,) cells, nearest first; the robot's is the first.
        direction_rad: Direction that the cells should see the robot in, world frame [rad]; NaN where there is none:
            then all cells but the core weigh 1.
        sigma_rad: Standard deviation of directions [rad].
        core_rad: Deviation that the core counts as [rad]: 0 makes it the most likely, pi the least.

    Returns:
        (nx ny,) weights relative to the greatest possible; 0 where no path leads.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2021, RA-L (GrGSL), windows and ties as in the public code [C].
    Deviation:
        Cells of the window that only a way around an obstacle leads to inherit, as those outside do.
    """
    nx, ny = free.shape
    weight = np.zeros(nx * ny)
    core = elementary.exp(-0.5 * (core_rad / sigma_rad) ** 2)
    i0, j0 = order[0] // ny, order[0] % ny
    for cell in order:
        i, j = cell // ny, cell % ny
        di, dj = i - i0, j - j0
        away = max(abs(di), abs(dj))
        if away <= 1:
            weight[cell] = core
        elif math.isnan(direction_rad):
            weight[cell] = 1.0
        elif away == 2 and length[cell] <= _WINDOW_UNITS:
            turn = (elementary.atan2(-dj, -di) - direction_rad) / (2.0 * math.pi)
            deviation = 2.0 * math.pi * (turn - math.floor(turn + 0.5))
            weight[cell] = elementary.exp(-0.5 * (deviation / sigma_rad) ** 2)
        else:
            weight[cell] = _inherited(free, length, weight, i, j)
    return weight


@numba.njit(cache=True, nogil=True, inline="always")
def _inherited(free, length, weight, i, j):
    nx, ny = free.shape
    cell = i * ny + j
    most = 0.0
    for di in range(-1, 2):
        for dj in range(-1, 2):
            a, b = i + di, j + dj
            if (di == 0 and dj == 0) or a < 0 or b < 0 or a >= nx or b >= ny:
                continue
            if not (free[a, b] and free[a, j] and free[i, b]):
                continue
            step = STEP_UNITS[abs(di) + abs(dj)]
            if length[a * ny + b] + step <= length[cell] + _TIE_UNITS:
                most = max(most, weight[a * ny + b])
    return most


@numba.njit(cache=True, nogil=True)
def information_gain_nats(p, hit_weight, miss_weight):
    """Return the expected information gain of a measurement, with each cell as an independent binary variable.

    h = sum p w_hit                                         chance of a hit
    gain = h K(p_hit, p) + (1 - h) K(p_miss, p),  p_z = p w_z / sum p w_z
    K(q, p) = sum over cells of q ln(q / p) + (1 - q) ln((1 - q) / (1 - p))        [nat]

    Args:
        p: (n,) belief, sums to 1.
        hit_weight: (n,) weights of the cells if gas were found, relative to the greatest possible.
        miss_weight: (n,) the same if none were.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2021, RA-L (GrGSL): expected divergence of hit and miss [C].
    Deviation:
        The chance of a hit is the weighted belief: in full where all mass is straight upwind.
    """
    chance, missed = 0.0, 0.0
    for c in range(p.size):
        chance += p[c] * hit_weight[c]
        missed += p[c] * miss_weight[c]
    if not (chance > 0.0 and missed > 0.0):
        return 0.0
    hit, miss = 0.0, 0.0
    for c in range(p.size):
        if p[c] > 0.0:
            hit += _divergence(p[c] * hit_weight[c] / chance, p[c])
            miss += _divergence(p[c] * miss_weight[c] / missed, p[c])
    chance = min(1.0, chance)
    return chance * hit + (1.0 - chance) * miss


@numba.njit(cache=True, nogil=True, inline="always")
def _divergence(q, p):
    total = 0.0
    if q > 0.0:
        total += q * elementary.log(q / p)
    if q < 1.0 and p < 1.0:
        total += (1.0 - q) * elementary.log((1.0 - q) / (1.0 - p))
    return total


@dataclass(frozen=True, kw_only=True)
class GrGslSettings:
    """Settings of GrGSL: sharpness of directions [rad], range ahead [cells], and number of places compared."""

    sigma_hit_rad: float = 1.0
    sigma_miss_rad: float = 2.0
    reach_cells: float = 5.0
    candidates: int = 60


class GrGsl(GoalCells):
    """Believes where the source is, cell by cell, from hits and misses with the wind at the robot.

    1. A hit favours the cells upwind of the robot, a miss those back towards the last hit; before the first hit a miss
       says only that the source is not right here. What a direction says holds for all cells that the way in that
       direction leads to (`spread_weights`).
    2. The belief is multiplied with these weights and normalised.
    3. Where to measure next is chosen among the free cells within `reach_cells` of way from cells visited: the most
       probable one, or the one that tells most (`information_gain_nats`). The 3 x 3 cells around a visited one and
       places given up are left out.
    4. Before the first hit all places tell about as much, and what is chosen among them is a matter of their order: so
       it goes to the place in reach that is farthest from all visited ones (`least_explored`).

    State: the logarithm of the belief, the place of the last hit, cells visited, cells in reach, cells given up, and
    the trees of paths from cells that were looked at (which depend on the room alone).

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2021, Evaluation of gas source localization algorithms, RA-L; parameters as in
        the group's public code [C].
    Deviation:
        In the public code the robot waits for gas before it searches; rule 4 is ours. There the place of the last hit
        begins at the start; here there is none. A hit without a wind moves that place, and changes the belief no more
        than there. At most `candidates` places are compared, the most probable ones; of equally probable ones such as
        lie evenly over the plan. There all are.
    """

    def __init__(
        self, free: Free, grid: CellGrid, settings: GrGslSettings | None = None, *, flyable: Free | None = None
    ) -> None:
        """Begin without knowledge: all free cells are equally likely.

        Args:
            free: (nx, ny) cells that gas can reach.
            flyable: Those of them that the robot can be sent to; absent: all.
        """
        self.settings = settings or GrGslSettings()
        super().__init__(free, grid, reach_cells=self.settings.reach_cells, flyable=flyable)
        self.last_hit_m: tuple[float, ...] | None = None
        self._distance_cells = np.full(free.shape, np.inf)
        self._log_p = np.where(free, 0.0, -np.inf)

    @property
    def p(self) -> Array:
        """The belief: (nx, ny) probabilities, 0 in solid cells."""
        return normalised_from_log(self._log_p)

    def visit(self, point_m: Sequence[float]) -> None:
        """Take note of a place where the robot was: cells near it come into reach, those around it are no goals."""
        super().visit(point_m)
        i, j = self._cell(point_m)
        self._is_closed[max(0, i - 1) : i + 2, max(0, j - 1) : j + 2] = True
        di, dj = (np.arange(n) - k for n, k in zip(self.free.shape, (i, j), strict=True))
        self._distance_cells = np.minimum(self._distance_cells, np.sqrt(np.square(di)[:, None] + np.square(dj)))

    def update(self, point_m: Sequence[float], *, is_hit: bool, downwind_rad: float | None) -> None:
        """Take in a measurement at a point: gas or none, and where the wind goes [rad]; None when it is calm."""
        self.visit(point_m)
        cell = self._cell(point_m)
        if is_hit and downwind_rad is None:
            self.last_hit_m = self.grid.centre_m(cell)
            return
        weight = self._hit_weight(cell, downwind_rad) if is_hit else self._miss_weight(cell)
        self._log_p = self._log_p + elementary.log_each(weight).reshape(self.free.shape)
        self._log_p -= self._log_p.max()
        if is_hit:
            self.last_hit_m = self.grid.centre_m(cell)

    def candidates(self) -> list[Cell]:
        """Return the cells that are in reach and not visited, at most `candidates`, the most probable ones first.

        Of those as probable as the least probable one of them, such as lie evenly among all of these in C order.
        """
        cells, n = np.argwhere(self._is_open & ~self._is_closed), self.settings.candidates
        log_p = self._log_p[tuple(cells.T)]
        likely = np.argsort(-log_p, kind="stable")
        if len(cells) > n:
            least = log_p[likely[n - 1]]
            surer, equal = likely[log_p[likely] > least + _EQUAL], np.flatnonzero(np.abs(log_p - least) <= _EQUAL)
            surer = surer[: n - 1]
            left = n - len(surer)
            likely = np.concatenate([surer, equal[np.arange(left) * len(equal) // left]])
        return [(int(i), int(j)) for i, j in cells[likely]]

    def least_explored(self, point_m: Sequence[float]) -> Cell | None:
        """Return the cell in reach that is farthest from all visited ones, of equal ones the nearest to a point.

        None when none is left. Half a cell counts as equal.
        """
        is_left = self._is_open & ~self._is_closed
        if not is_left.any():
            return None
        best = is_left & (self._distance_cells >= self._distance_cells[is_left].max() - 0.5)
        length, _ = self._tree(self._cell(point_m))
        i, j = np.unravel_index(int(np.where(best, length.reshape(self.free.shape), np.inf).argmin()), self.free.shape)
        return int(i), int(j)

    def most_likely(self, point_m: Sequence[float]) -> Cell | None:
        """Return the cell in reach with the highest belief, of equal ones the farthest; None when none is left."""
        is_left = self._is_open & ~self._is_closed
        if not is_left.any():
            return None
        best = is_left & (self._log_p >= self._log_p[is_left].max() - _EQUAL)
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
        downwind_rad = elementary.atan2(wind_m_s[1], wind_m_s[0]) if wind_m_s.any() else _NO_DIRECTION
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
        if self.last_hit_m is None or distance(point_m, self.last_hit_m) < 0.5 * self.grid.cell_m:
            return _NO_DIRECTION
        return elementary.atan2(point_m[1] - self.last_hit_m[1], point_m[0] - self.last_hit_m[0])


def warm_up() -> None:
    """Load or compile what a search runs, on a few cells, so that nothing is compiled in flight."""
    free = np.ones((6, 6), np.bool_)
    method = GrGsl(free, CellGrid((0.0, 0.0), 1.0, free.shape))
    for is_hit in (True, False):
        method.update((2.0, 2.0), is_hit=is_hit, downwind_rad=0.0)
    method.most_informative(np.ones((6, 6, 2)))
