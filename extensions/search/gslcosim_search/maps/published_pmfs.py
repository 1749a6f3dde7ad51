# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""PMFS as published: candidate sources are scored by simulations of filaments in the estimated wind.

Held by:
    extensions/search/tests/unit/maps/test_published_pmfs.py
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid, normalised_from_log
from gslcosim_search.maps.goal_cells import Cell
from gslcosim_search.maps.pmfs import Pmfs, PmfsSettings, add_log_score_inplace
from gslcosim_search.motion.grid_paths import Free, visible_cells
from gslcosim_search.random_stream import RandomStream

Array = NDArray[np.float64]
Region = tuple[int, int, int, int]
"""First cell along x and y, and numbers of cells along x and y."""

# A prime number of random numbers is gone through in a circle: filaments do not meet the same ones again by step.
_N_RANDOM = 65_537
# The published score has no floor; logarithms of products need one.
_LEAST_FACTOR = 1e-12
# Values of goals that differ by less are equal.
_TIE = 1e-9


@numba.njit(cache=True, nogil=True, inline="always")
def _move(free, x, y, dx, dy, is_open):
    # As far along a straight line as cells are free; True when it leaves the grid through an open edge.
    nx, ny = free.shape
    n = int(2.0 * max(abs(dx), abs(dy))) + 1
    dx, dy = dx / n, dy / n
    for _ in range(n):
        to_x, to_y = x + dx, y + dy
        if to_x < 0.0 or to_y < 0.0 or to_x >= nx or to_y >= ny:
            return is_open, x, y
        if not free[int(to_x), int(to_y)]:
            break
        x, y = to_x, to_y
    return False, x, y


@numba.njit(cache=True, nogil=True)
def simulate_hit_shares(
    free, wind_cells_s, low_i, low_j, n_i, n_j, n_released, step_s, noise_cells_s, n_warm_up, n_recorded, is_open,
    normals, fractions, first,
):  # fmt: skip
    """Return the share of the time that each cell holds a filament of a source somewhere in a region.

    x <- x + dt (W(x) + sigma n), n standard normal, along a straight line up to the first solid cell
    [cells] = [s] ([cells/s] + [cells/s])
    share(c) = recorded steps with at least one filament in c / recorded steps        pure number

    In each step some filaments begin, evenly over the region. Steps of double length warm the plume up until the first
    filament leaves the grid, or for so many steps; then the steps are recorded. Filaments that leave are gone.

    Args:
        free: (nx, ny) bool, whether a cell is free; index order ij.
        wind_cells_s: (nx, ny, 2) wind at the cell centres, world frame [cells/s].
        low_i: First cell of the region along x; so is `low_j` along y.
        low_j: See `low_i`.
        n_i: Number of its cells along x; so is `n_j` along y.
        n_j: See `n_i`.
        step_s: dt [s].
        noise_cells_s: sigma [cells/s], of each component.
        n_warm_up: Maximum number of steps of warming up.
        is_open: Whether filaments leave through the edges of the grid; otherwise edges are walls.
        normals: (n, 2) standard normal numbers, gone through in a circle.
        fractions: (n, 2) numbers uniform in [0, 1), of starts.

    Returns:
        (nx, ny) shares, and the index after the last number used.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2024, arXiv 2304.08879 (PMFS), by what the public code does [C].
    Deviation:
        Positions are checked each half cell on the way instead of by visibility of the end.
    """
    n_random = normals.shape[0]
    hits = np.zeros(free.shape)
    last_seen = np.full(free.shape, -1)
    x = np.empty((n_warm_up + n_recorded) * n_released)
    y = np.empty_like(x)
    n, at, is_warm = 0, first, n_warm_up == 0
    step, n_before = 0, 0
    while n_before + n_recorded > step:
        duration_s = step_s if is_warm else 2.0 * step_s
        for _ in range(n_released):
            x[n] = low_i + n_i * fractions[at, 0]
            y[n] = low_j + n_j * fractions[at, 1]
            at = at + 1 if at + 1 < n_random else 0
            n += 1
        has_left = False
        k = 0
        while k < n:
            i, j = int(x[k]), int(y[k])
            if is_warm and last_seen[i, j] != step:
                last_seen[i, j] = step
                hits[i, j] += 1.0
            dx = duration_s * (wind_cells_s[i, j, 0] + noise_cells_s * normals[at, 0])
            dy = duration_s * (wind_cells_s[i, j, 1] + noise_cells_s * normals[at, 1])
            at = at + 1 if at + 1 < n_random else 0
            is_gone, to_x, to_y = _move(free, x[k], y[k], dx, dy, is_open)
            if is_gone:
                has_left = True
                n -= 1
                x[k], y[k] = x[n], y[n]
                continue
            x[k], y[k] = to_x, to_y
            k += 1
        step += 1
        if not is_warm:
            n_before = step
            is_warm = has_left or step >= n_warm_up
    return hits / n_recorded, at


def list_regions(free: Free, max_cells: int) -> list[Region]:
    """Return regions of free cells that together are all of them, each at most so many cells wide.

    The grid is cut into squares; those with something solid are halved along both axes until each part is free.

    Args:
        free: (nx, ny) whether a cell is free.
        max_cells: Largest edge of a region [cells].
    """
    nx, ny = free.shape
    waiting: list[Region] = [
        (i, j, min(max_cells, nx - i), min(max_cells, ny - j))
        for i in range(0, nx, max_cells)
        for j in range(0, ny, max_cells)
    ][::-1]
    regions: list[Region] = []
    while waiting:
        region = waiting.pop()
        i, j, n_i, n_j = region
        part = free[i : i + n_i, j : j + n_j]
        if part.all():
            regions.append(region)
        elif part.any():
            waiting += split_region(region)[::-1]
    return regions


def split_region(region: Region) -> list[Region]:
    """Return the halves of a region along both axes, at most four; none of a single cell."""
    i, j, n_i, n_j = region
    if n_i == n_j == 1:
        return []
    halves_i = [(i, (n_i + 1) // 2), (i + (n_i + 1) // 2, n_i // 2)]
    halves_j = [(j, (n_j + 1) // 2), (j + (n_j + 1) // 2, n_j // 2)]
    return [(a, b, n_a, n_b) for a, n_a in halves_i for b, n_b in halves_j if n_a > 0 and n_b > 0]


@dataclass(frozen=True, kw_only=True)
class FilamentSettings:
    """Figures of PMFS's simulations of filaments and of when they are made.

    In each `step_s`, `filaments_per_step` begin in the source's region; all move with the wind and white noise of
    `noise_m_s` in each step. At most `warm_up_steps` of double length come before `recorded_steps`. Regions have edges
    of at most `max_region_cells`; the fraction `refine_frac` with the best scores is halved, level by level, down to
    cells. `discrimination` is how much a difference counts in the score. Sources are scored at every
    `stops_per_update`-th stop. `edges` says whether filaments leave through the edges of the map.
    """

    step_s: float = 0.2
    filaments_per_step: int = 5
    noise_m_s: float = 0.25
    warm_up_steps: int = 500
    recorded_steps: int = 200
    max_region_cells: int = 5
    refine_frac: float = 0.1
    discrimination: float = 1.0
    stops_per_update: int = 3
    edges: str = "open"


class PublishedPmfs(Pmfs):
    """PMFS with forward simulations of filaments, the score and the goals of the paper.

    Hit map and trust are those of `Pmfs`, without bounds on the log odds.

    3. Source score, every few stops: each region is simulated as a source (`simulate_hit_shares`); its score is the
       product over all free cells of 1 - conf k |measured - simulated|, and that of all its cells. The best regions
       are halved and simulated again, down to cells. Normalised the scores are the belief, without tempering.
    4. Motion: among all cells that were in sight within `reach_cells` of a stop, the one with the largest variance of
       the simulated shares, over the first regions weighted by their scores, times 1 - conf. The cells around a goal
       are closed with it. To explore, or where that variance is 0: max sum (1 - conf) exp(-distance) over cells in
       sight.

    State: that of `Pmfs` without a backward plume; the variance of the simulated shares; stops; random numbers.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2024, T-RO, arXiv 2304.08879; what the abstract and these pages do not say is as
        in the group's public code and launch files [C].
    Deviation:
        The first regions are squares, halved where something is solid, instead of fused leaves of a quadtree. Of
        equally good goals one is drawn: the public code takes the first in the order of a hash table. Random numbers
        are a fixed set from the agent's seed.
    """

    bounds_log_odds: ClassVar[bool] = False

    def __init__(
        self,
        free: Free,
        grid: CellGrid,
        settings: PmfsSettings,
        filaments: FilamentSettings,
        draws: RandomStream,
        *,
        flyable: Free | None = None,
    ) -> None:
        """Begin without knowledge.

        Args:
            free: (nx, ny) cells that gas can reach.
            settings: Figures of the hit map, of trust and of motion; those of the backward plume do not count.
            draws: Where random numbers of the simulations come from.
            flyable: Those of the free cells that the robot can be sent to; absent: all.
        """
        super().__init__(free, grid, settings, flyable=flyable)
        self._filaments = filaments
        generator = draws.generator("pmfs.filaments")
        self._normals = generator.standard_normal((_N_RANDOM, 2))
        # Never so near to 1 that a start is rounded into the next region.
        self._fractions = np.minimum(generator.random((_N_RANDOM, 2)), 1.0 - 1e-9)
        self._i_random = 0
        self._regions = list_regions(free, filaments.max_region_cells)
        self._variance = np.zeros(free.shape)
        self._n_stops = 0
        self._in_sight: dict[Cell, tuple[NDArray[np.int64], Array]] = {}

    def visit(self, point_m: Sequence[float]) -> None:
        """Take note of a stop: cells in sight near it come into reach, and those around it are no goals any more."""
        cell = self._cell(point_m)
        self._is_open |= self._near_in_sight(cell)
        self._is_closed[_around(cell, 1)] = True

    def is_update_due(self, *, has_findings: bool) -> bool:
        """Count a stop, with findings or without, and return whether sources are to be scored at it."""
        del has_findings
        self._n_stops += 1
        return self._n_stops >= self.settings.explore_first and self._n_stops % self._filaments.stops_per_update == 0

    def score(self, wind_m_s: Array) -> None:
        """Believe again, in a wind; see `Pmfs.score`."""
        wind_cells_s = np.ascontiguousarray(wind_m_s / self.grid.cell_m)
        log_score = np.full(self.free.shape, -np.inf)
        shares, scores = self._simulate(self._regions, wind_cells_s, log_score)
        self._variance = _weighted_variance(shares, normalised_from_log(scores))
        level = self._regions
        while level:
            n_best = math.ceil(self._filaments.refine_frac * len(level))
            best = np.argsort(-scores, kind="stable")[:n_best]
            level = [half for i in best for half in split_region(level[int(i)])]
            if level:
                _, scores = self._simulate(level, wind_cells_s, log_score)
        self.p[self.free] = normalised_from_log(log_score[self.free])

    # The shares of all cells and the logarithm of the score, by region; the scores become those of their cells.
    def _simulate(self, regions: list[Region], wind_cells_s: Array, log_score: Array) -> tuple[Array, Array]:
        f = self._filaments
        shares = np.empty((len(regions), *self.free.shape))
        for n, region in enumerate(regions):
            shares[n], self._i_random = simulate_hit_shares(
                self.free, wind_cells_s, *region, f.filaments_per_step, f.step_s, f.noise_m_s / self.grid.cell_m,
                f.warm_up_steps, f.recorded_steps, f.edges == "open", self._normals, self._fractions, self._i_random,
            )  # fmt: skip
        scores = np.zeros(len(regions))
        add_log_score_inplace(
            scores,
            np.ascontiguousarray(shares[:, self.free].T),
            self.hit_probability[self.free],
            f.discrimination * self.confidence[self.free],
            _LEAST_FACTOR,
        )
        for (i, j, n_i, n_j), score in zip(regions, scores, strict=True):
            log_score[i : i + n_i, j : j + n_j] = score
        return shares, scores

    def next_goal(self, point_m: Sequence[float], draws: RandomStream) -> Cell | None:
        """Return the next cell to measure in; None when no cell is left. Draws two numbers."""
        explores = draws.fraction() < self.settings.explore_frac or self._n_goals < self.settings.explore_first
        lot = draws.fraction()
        cells = [(int(i), int(j)) for i, j in np.argwhere(self._is_open & ~self._is_closed)]
        if not cells:
            return None
        self._n_goals += 1
        at, unknown = tuple(np.array(cells).T), 1.0 - self.confidence
        worth = self._variance[at] * unknown[at]
        if explores or not worth.max() > 0.0:
            worth = np.array([self._exploration_value(cell, unknown) for cell in cells])
        best = np.flatnonzero(worth >= worth.max() * (1.0 - _TIE))
        goal = cells[int(best[int(lot * len(best))])]
        self._is_closed[_around(goal, 1)] = True
        return goal

    # What a cell sees depends on the room alone.
    def _exploration_value(self, cell: Cell, unknown: Array) -> float:
        if cell not in self._in_sight:
            seen = np.argwhere(self._near_in_sight(cell))
            away = np.linalg.norm(seen - cell, axis=1)
            self._in_sight[cell] = (np.ravel_multi_index(tuple(seen.T), self.free.shape), elementary.exp_each(-away))
        at, weight = self._in_sight[cell]
        return float((unknown.reshape(-1)[at] * weight).sum())

    def _near_in_sight(self, cell: Cell) -> Free:
        reach = int(self.settings.reach_cells)
        near = np.zeros(self.free.shape, np.bool_)
        near[_around(cell, reach)] = True
        return near & visible_cells(self.free, cell, 1.5 * reach)


def warm_up() -> None:
    """Load or compile what a search runs, on a few cells, so that nothing is compiled in flight."""
    free = np.ones((6, 6), np.bool_)
    filaments = FilamentSettings(warm_up_steps=2, recorded_steps=2)
    method = PublishedPmfs(free, CellGrid((0.0, 0.0), 1.0, free.shape), PmfsSettings(), filaments, RandomStream(1))
    method.update((2.0, 2.0), (True, False), (0.5, 0.0))
    method.score(np.ones((6, 6, 2)))
    method.next_goal((2.0, 2.0), RandomStream(1))


# The window of cells up to a distance from a cell along each axis; what is outside of the grid is left out.
def _around(cell: Sequence[int], reach: int) -> tuple[slice, slice]:
    i, j = cell
    return slice(max(0, i - reach), i + reach + 1), slice(max(0, j - reach), j + reach + 1)


# (nx, ny) variance over the first axis, with weights that sum to 1.
def _weighted_variance(shares: Array, weights: Array) -> Array:
    mean, variance = np.zeros(shares.shape[1:]), np.zeros(shares.shape[1:])
    for share, weight in zip(shares, weights, strict=True):
        mean += weight * share
    for share, weight in zip(shares, weights, strict=True):
        variance += weight * np.square(share - mean)
    return variance
