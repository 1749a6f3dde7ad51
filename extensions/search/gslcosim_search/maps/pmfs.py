# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""PMFS with a backward plume: mapping of hits over a known map, and sources by how well their plume explains it.

Held by:
    extensions/search/tests/unit/maps/test_pmfs.py
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
from gslcosim_search.maps.goal_cells import Cell, GoalCells
from gslcosim_search.maps.wind_map import factorise_lu_inplace, solve_transposed_lu_inplace
from gslcosim_search.motion.grid_paths import (
    STEP_UNITS,
    UNITS_PER_CELL,
    Free,
    is_line_free,
    visible_cells,
)
from gslcosim_search.random_stream import RandomStream

Array = NDArray[np.float64]
_TIE_UNITS = UNITS_PER_CELL // 10
# Cells of the window that are looked at directly, to each side.
_WINDOW = 2
_ROOT_2_PI = math.sqrt(2.0 * math.pi)
# So many factors of a score, each at least 0.01, are multiplied before a logarithm is taken.
_FACTORS_TOGETHER = 16
_LEAST_P, _MOST_P = 0.001, 0.999
# Sources are never ruled out by one cell alone.
_LEAST_FACTOR = 0.01
# Beyond so many cells exp(-distance) is nothing.
_VIEW_CELLS = 10.0


@numba.njit(cache=True, nogil=True, inline="always")
def _bernoulli(x):
    # x / (e^x - 1), which is 1 at 0; the series avoids the difference of nearly equal numbers.
    if abs(x) < 1e-4:
        return 1.0 - 0.5 * x + x * x / 12.0
    if x > 500.0:
        return 0.0
    return x / elementary.expm1(x)


@numba.njit(cache=True, nogil=True)
def transport_band(numbers, n_free, width, wind_m_s, diffusivity_m2_s, loss_per_s, cell_m):
    """Build the matrix of the steady balance of gas in the free cells of a plane, A c = release.

    sum over faces to free neighbours j of D (B(-Pe) c_i - B(Pe) c_j) + lambda h^2 c_i = release_i
    [m2/s] [1/m2] + [1/s] [m2] [1/m2] = [1/s]
    Pe = u h / D, u wind through the face away from i, B(x) = x / (e^x - 1)

    The flux between two cells is that of the steady one-dimensional equation between their centres, so no cell gets
    less than nothing at any wind. It enters both cells: what leaves one arrives in the other. Nothing passes walls and
    the edges of the grid; gas is lost at the rate lambda only.

    Args:
        numbers: (nx, ny) int64, number of each free cell, -1 in solid ones.
        width: Half the width of the band: no two neighbours' numbers differ by more.
        wind_m_s: (nx, ny, 2) wind at the cell centres, world frame [m/s].
        diffusivity_m2_s: Eddy diffusivity D [m2/s], > 0.
        loss_per_s: Rate lambda at which gas is lost [1/s], > 0.
        cell_m: Edge of the cells h [m].

    Returns:
        (n_free, 2 width + 1) band, band[i, width + j - i] = A[i, j], for `factorise_lu_inplace`.

    Source:
        Scharfetter and Gummel 1969, doi:10.1109/T-ED.1969.16566 (exponentially fitted fluxes).
    """
    nx, ny = numbers.shape
    band = np.zeros((n_free, 2 * width + 1))
    per_diffusion = 0.5 * cell_m / diffusivity_m2_s
    for i in range(nx):
        for j in range(ny):
            here = numbers[i, j]
            if here < 0:
                continue
            band[here, width] += loss_per_s * cell_m * cell_m
            for axis in range(2):
                a, b = i + 1 - axis, j + axis
                if a >= nx or b >= ny or numbers[a, b] < 0:
                    continue
                there = numbers[a, b]
                peclet = per_diffusion * (wind_m_s[i, j, axis] + wind_m_s[a, b, axis])
                leaving = diffusivity_m2_s * _bernoulli(-peclet)
                coming = diffusivity_m2_s * _bernoulli(peclet)
                band[here, width] += leaving
                band[here, width + there - here] -= coming
                band[there, width] += coming
                band[there, width + here - there] -= leaving
    return band


@dataclass(frozen=True, kw_only=True)
class PlumeModel:
    """A nominal plume in the plane: puffs per second, their eddy diffusivity, and how long they last on average."""

    puffs_per_s: float = 25.0
    diffusivity_m2_s: float = 0.025
    lifetime_s: float = 100.0


class BackwardPlume:
    """Gives the fraction of the time that a puff of a source in any cell is in a given cell, in a steady wind.

    A c = e_s for a source of one puff a second in cell s (A as of `transport_band`); c_m(s) = g_m(s), A^T g_m = e_m
    N = q h^2 g_m(s)        puffs in cell m on average: [1] = [1/s] [m2] [s/m2]
    share = 1 - exp(-N)     of the time at least one, where puffs come independently

    One solution of the transposed equations for each cell that is asked for serves all sources at once.

    State: the factors of A, for the wind it was made with.

    Source:
        The adjoint of the advection-diffusion equation; in place of the simulations of filaments of PMFS (Ojeda,
        Monroy, Gonzalez-Jimenez 2024, arXiv 2304.08879).
    """

    def __init__(self, free: Free, cell_m: float, wind_m_s: Array, model: PlumeModel) -> None:
        """Factorise the balance of gas.

        Args:
            free: (nx, ny) whether a cell is free.
            wind_m_s: (nx, ny, 2) wind at the cell centres, world frame [m/s].
        """
        self._free, self._puffs = free, model.puffs_per_s * cell_m * cell_m
        self._numbers = _numbered(free)
        self._factors = transport_band(
            self._numbers,
            int(free.sum()),
            min(free.shape),
            np.ascontiguousarray(wind_m_s, np.float64),
            model.diffusivity_m2_s,
            1.0 / model.lifetime_s,
            cell_m,
        )
        factorise_lu_inplace(self._factors)

    def shares(self, cells: Sequence[Sequence[int]]) -> Array:
        """Return (n_cells, n_free) the share of the time with gas in each of some cells, by source.

        Returns:
            Sources in the order of `array[free]`, C order of the free cells.
        """
        at = [int(self._numbers[tuple(cell)]) for cell in cells]
        values = np.zeros((len(self._factors), len(at)))
        values[at, np.arange(len(at))] = 1.0
        solve_transposed_lu_inplace(self._factors, values)
        return -elementary.expm1_each(-self._puffs * values[self._numbers[self._free]].T)


# Along the shorter axis first, so that the band is narrow.
def _numbered(free: Free) -> NDArray[np.int64]:
    if free.shape[0] < free.shape[1]:
        return np.ascontiguousarray(_numbered(free.T).T)
    numbers = np.full(free.shape, -1, np.int64)
    numbers[free] = np.arange(int(free.sum()))
    return numbers


@numba.njit(cache=True, nogil=True)
def stretched_kernel(free, length, order, wind_x, wind_y, sigma, stretch):
    """Weigh cells by how much they share of what is measured at one: more along the wind, by the way gas would take.

    w(c) = exp(-(p^2 / a^2 + q^2 / b^2) / 2),  a = sigma + k |W|,  b = sigma / (1 + k |W| / sigma)
    p, q: parts of the offset of c along and across the wind [cells]
    A cell within two cells that is in plain sight has its own offset. Any other is put as far away as the way to it is
    long, in the direction in which that way leaves the window; of equally long ways the one with the largest weight
    counts. So nothing passes a wall.

    Args:
        free: (nx, ny, 1) bool, whether a cell is free; index order ij.
        length: (nx ny,) lengths of the shortest paths from the cell of the measurement, as of `path_tree` [units].
        order: (n_reached,) cells, nearest first; that of the measurement is the first.
        wind_x: Wind, world frame [m/s].
        wind_y: Its second component.
        sigma: Standard deviation without wind [cells].
        stretch: k [cells s/m].

    Returns:
        (nx ny,) weights, 1 at the measurement, 0 where no path leads.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2024, arXiv 2304.08879 (PMFS), with the public code's window [C].
    """
    nx, ny, _ = free.shape
    weight = np.zeros(nx * ny)
    ahead = np.zeros((nx * ny, 2))
    speed = math.sqrt(wind_x * wind_x + wind_y * wind_y)
    ux, uy = (wind_x / speed, wind_y / speed) if speed > 0.0 else (1.0, 0.0)
    along, across = sigma + stretch * speed, sigma / (1.0 + stretch * speed / sigma)
    i0, j0 = order[0] // ny, order[0] % ny
    for cell in order:
        i, j = cell // ny, cell % ny
        di, dj = float(i - i0), float(j - j0)
        far = length[cell] / UNITS_PER_CELL
        if far > 8.0 * max(along, across) + _WINDOW:
            break
        is_near = max(abs(di), abs(dj)) <= _WINDOW
        if is_near and is_line_free(free, i0 + 0.5, j0 + 0.5, 0.5, i + 0.5, j + 0.5, 0.5):
            away = math.sqrt(di * di + dj * dj)
            if away > 0.0:
                ahead[cell, 0], ahead[cell, 1] = di / away, dj / away
            weight[cell] = _gaussian(di, dj, ux, uy, along, across)
            continue
        for step in range(9):
            a, b = i + step // 3 - 1, j + step % 3 - 1
            if step == 4 or a < 0 or b < 0 or a >= nx or b >= ny:
                continue
            if not (free[a, b, 0] and free[a, j, 0] and free[i, b, 0]):
                continue
            before = a * ny + b
            if length[before] + STEP_UNITS[abs(a - i) + abs(b - j)] > length[cell] + _TIE_UNITS:
                continue
            dx, dy = ahead[before, 0], ahead[before, 1]
            through = _gaussian(far * dx, far * dy, ux, uy, along, across)
            if through > weight[cell] or (ahead[cell, 0] == 0.0 and ahead[cell, 1] == 0.0):
                weight[cell] = through
                ahead[cell, 0], ahead[cell, 1] = dx, dy
    return weight


@numba.njit(cache=True, nogil=True, inline="always")
def _gaussian(dx, dy, ux, uy, along, across):
    p, q = dx * ux + dy * uy, dy * ux - dx * uy
    return elementary.exp(-0.5 * ((p / along) ** 2 + (q / across) ** 2))


@numba.njit(cache=True, nogil=True)
def trust_inplace(omega, length, order, sigma):
    """Add to every cell what a measurement contributes to the trust in its hit probability.

    omega(c) += N(L(c); sigma) = exp(-L^2 / (2 sigma^2)) / (sigma sqrt(2 pi))        L length of the path [cells]

    Args:
        omega: (nx ny,) sums so far; modified.
        length: (nx ny,) lengths of the shortest paths from the cell of the measurement [units].
        order: (n_reached,) cells, nearest first.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2024, arXiv 2304.08879 (PMFS) [C].
    """
    for cell in order:
        far = length[cell] / (UNITS_PER_CELL * sigma)
        if far > 8.0:
            break
        omega[cell] += elementary.exp(-0.5 * far * far) / (sigma * _ROOT_2_PI)


@numba.njit(cache=True, nogil=True)
def add_log_score_inplace(log_score, shares, measured, confidence, least):
    """Add the logarithm of how well each source explains what was measured in some cells.

    log S(s) += sum over cells m of ln max(least, 1 - conf_m |h_m - share_m(s)|)        pure numbers

    Args:
        log_score: (n_sources,) sums; modified.
        shares: (n_cells, n_sources) share of the time with gas, by the model.
        measured: (n_cells,) probability of a hit, as measured.
        confidence: (n_cells,) trust in it, 0 to 1.
        least: Smallest factor, > 0: no cell alone rules out a source.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2024, arXiv 2304.08879 (PMFS): product of 1 - conf + conf (1 - kd |difference|)
        with kd = 1 [C].
    """
    product = np.ones(shares.shape[1])
    for m in range(shares.shape[0]):
        for s in range(shares.shape[1]):
            product[s] *= max(least, 1.0 - confidence[m] * abs(measured[m] - shares[m, s]))
        if m % _FACTORS_TOGETHER == _FACTORS_TOGETHER - 1 or m == shares.shape[0] - 1:
            for s in range(shares.shape[1]):
                log_score[s] += elementary.log(product[s])
                product[s] = 1.0


@numba.njit(cache=True, nogil=True)
def disagreement(shares, p):
    """Return the variance, under the belief over sources, of the modelled share of time with gas in each cell.

    v(m) = sum over sources s of p(s) (share_m(s) - mean_m)^2,  mean_m = sum p(s) share_m(s)        pure numbers

    Args:
        shares: (n_cells, n_sources) share of the time with gas, by the model.
        p: (n_sources,) belief, sums to 1.

    Returns:
        (n_cells,) variances.
    """
    variance = np.zeros(shares.shape[0])
    for m in range(shares.shape[0]):
        mean = 0.0
        for s in range(shares.shape[1]):
            mean += p[s] * shares[m, s]
        for s in range(shares.shape[1]):
            variance[m] += p[s] * (shares[m, s] - mean) ** 2
    return variance


@dataclass(frozen=True, kw_only=True)
class PmfsSettings(PlumeModel):
    """Figures of PMFS; lengths in cells.

    Hit map: `prior`, `hit_target` and `miss_target` are probabilities; `kernel_cells` and `stretch_s_m` its reach.
    Trust: `trust_reach_cells` and `trust_scale`. Score: cells that are trusted more than `least_trust` count, at most
    `scored`, the most trusted ones, and the score is taken to the power `temper`. Motion: goals lie within
    `reach_cells` of way from visited cells, at most `candidates` are compared, `explore_frac` of the goals are chosen
    to explore, and so are the first `explore_first`.
    """

    prior: float = 0.3
    hit_target: float = 0.6
    miss_target: float = 0.1
    kernel_cells: float = 1.5
    stretch_s_m: float = 1.5
    trust_reach_cells: float = 1.0
    trust_scale: float = 1.0
    least_trust: float = 0.5
    scored: int = 200
    temper: float = 1.0
    reach_cells: float = 5.0
    candidates: int = 100
    explore_frac: float = 0.1
    explore_first: int = 5


class Pmfs(GoalCells):
    """Maps how likely gas is met in each cell, and believes in the sources whose plume would explain that map.

    1. Hit map: log odds of a hit in each cell. A measurement moves a cell's probability from the prior to its target
       (hit or miss) by the weight of `stretched_kernel`; log odds += logit P - logit prior.
    2. Trust in it: conf = 1 - exp(-omega / scale^2), omega summed by `trust_inplace`.
    3. Source score: for each source, the product over trusted cells of 1 - conf |measured - modelled| (in logarithms,
       `add_log_score_inplace`); modelled by `BackwardPlume` in the estimated wind. Normalised it is the belief.
    4. Motion: among the cells in sight that are in reach and not visited, the one where the sources that are believed
       in disagree most and the map is trusted least: max Var(share) (1 - conf). Or, to explore, where most is seen that
       is not known: max sum (1 - conf) exp(-distance).

    State: log odds, omega, the belief, the plume model of the last wind, cells visited, in reach and given up.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2024, Robotic gas source localization with probabilistic mapping and online
        dispersion simulation, T-RO, arXiv 2304.08879; figures as in the group's public code and launch files [C].
    Deviation:
        Sources are scored by the steady plume calculated backwards, in place of a simulation of filaments for each one
        of a few hundred candidates: every cell is a candidate, and nothing is drawn at random. The product runs over
        trusted cells only, so that cells nobody measured do not count. A score may be tempered: neighbouring cells
        share their measurements, and the model is not the room.
    """

    bounds_log_odds: ClassVar[bool] = True

    def __init__(
        self, free: Free, grid: CellGrid, settings: PmfsSettings | None = None, *, flyable: Free | None = None
    ) -> None:
        """Begin without knowledge.

        Args:
            free: (nx, ny) cells that gas can reach.
            flyable: Those of them that the robot can be sent to; absent: all.
        """
        self.settings = settings or PmfsSettings()
        super().__init__(free, grid, reach_cells=self.settings.reach_cells, flyable=flyable)
        self._log_odds = np.full(free.shape, _logit(self.settings.prior))
        self._omega = np.zeros(free.shape)
        self.p = np.where(free, 1.0 / free.sum(), 0.0)
        self._plume: BackwardPlume | None = None
        self._n_goals = 0

    @property
    def hit_probability(self) -> Array:
        """(nx, ny) probability that gas is met in a cell, as far as it was measured."""
        return 1.0 / (1.0 + elementary.exp_each(-self._log_odds))

    @property
    def confidence(self) -> Array:
        """(nx, ny) trust in the hit probability, 0 to 1; 0 in solid cells."""
        scale = self.settings.trust_scale * self.settings.trust_scale
        return np.where(self.free, -elementary.expm1_each(-self._omega / scale), 0.0)

    def update(self, point_m: Sequence[float], hits: Sequence[bool], wind_m_s: Sequence[float]) -> None:
        """Take in measurements at one place: hit or miss, one after the other, and the wind there [m/s]."""
        self.visit(point_m)
        length, order = self._tree(self._cell(point_m))
        s = self.settings
        weight = stretched_kernel(
            self.free[:, :, None], length, order, wind_m_s[0], wind_m_s[1], s.kernel_cells, s.stretch_s_m
        ).reshape(self.free.shape)
        for is_hit in hits:
            target = s.hit_target if is_hit else s.miss_target
            p = np.clip(s.prior + (target - s.prior) * weight, _LEAST_P, _MOST_P)
            self._log_odds += elementary.log_each(p / (1.0 - p)) - _logit(s.prior)
            trust_inplace(self._omega.reshape(-1), length, order, s.trust_reach_cells)
        if self.bounds_log_odds:
            self._log_odds = np.clip(self._log_odds, _logit(_LEAST_P), _logit(_MOST_P))

    def is_update_due(self, *, has_findings: bool) -> bool:
        """Return whether sources are to be scored at a stop: wherever something was found out."""
        return has_findings

    def score(self, wind_m_s: Array) -> None:
        """Believe again, in a wind.

        Args:
            wind_m_s: (nx, ny, 2) wind as it is estimated, world frame [m/s].
        """
        self._plume = BackwardPlume(self.free, self.grid.cell_m, wind_m_s, self.settings)
        confidence = self.confidence
        cells = _find_largest_cells(
            np.where(confidence > self.settings.least_trust, confidence, 0.0), self.settings.scored
        )
        if not cells:
            return
        at = tuple(np.array(cells).T)
        log_score = np.zeros(int(self.free.sum()))
        add_log_score_inplace(
            log_score, self._plume.shares(cells), self.hit_probability[at], confidence[at], _LEAST_FACTOR
        )
        self.p[self.free] = normalised_from_log(self.settings.temper * log_score)

    def next_goal(self, point_m: Sequence[float], draws: RandomStream) -> Cell | None:
        """Return the next cell to measure in; None when no cell is left. Draws one number."""
        cells = self._candidates(self._cell(point_m))
        explores = draws.fraction() < self.settings.explore_frac or self._n_goals < self.settings.explore_first
        if not cells:
            return None
        self._n_goals += 1
        if not explores and self._plume is not None:
            worth = self._disagreement(self._plume, cells)
            if worth.max() > 0.0:
                return cells[int(worth.argmax())]
        return cells[int(np.argmax([self._unknown_in_view(cell) for cell in cells]))]

    # Of the cells in reach those in sight, if there are any; the nearest ones.
    def _candidates(self, here: Cell) -> list[Cell]:
        is_left = self._is_open & ~self._is_closed
        if not is_left.any():
            return []
        in_sight = is_left & visible_cells(self.free, here)
        length, _ = self._tree(here)
        nearness = 1.0 / (1.0 + np.maximum(length, 0).reshape(self.free.shape))
        return _find_largest_cells(
            np.where(in_sight if in_sight.any() else is_left, nearness, 0.0), self.settings.candidates
        )

    def _disagreement(self, plume: BackwardPlume, cells: list[Cell]) -> Array:
        variance = disagreement(plume.shares(cells), self.p[self.free])
        return variance * (1.0 - self.confidence[tuple(np.array(cells).T)])

    def _unknown_in_view(self, cell: Cell) -> float:
        seen = np.argwhere(visible_cells(self.free, cell, _VIEW_CELLS))
        away = np.linalg.norm(seen - cell, axis=1)
        return float(((1.0 - self.confidence[tuple(seen.T)]) * elementary.exp_each(-away)).sum())


def warm_up() -> None:
    """Load or compile what a search runs, on a few cells, so that nothing is compiled in flight."""
    free = np.ones((6, 6), np.bool_)
    method = Pmfs(free, CellGrid((0.0, 0.0), 1.0, free.shape))
    method.update((2.0, 2.0), (True, False), (0.5, 0.0))
    method.score(np.ones((6, 6, 2)))
    method.next_goal((2.0, 2.0), RandomStream(1))


# At most n cells with the largest values above 0, the largest first; of equal ones the first in C order.
def _find_largest_cells(values: Array, n: int) -> list[Cell]:
    order = np.argsort(-values, axis=None, kind="stable")[:n]
    chosen = order[values.reshape(-1)[order] > 0.0]
    return [(int(i), int(j)) for i, j in zip(*np.unravel_index(chosen, values.shape), strict=True)]


def _logit(p: float) -> float:
    return elementary.log(p / (1.0 - p))
