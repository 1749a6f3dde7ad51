# pyright: basic
"""Hidden Markov chains of plumes: parcels of air hop from cell to cell, unseen but where a sensor meets gas.

Held by:
    extensions/search/tests/unit/bayes/test_hidden_markov.py
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.elementary import distance

N_MOVES = 9
STAY = 4
NOWHERE = -1
# Below this a chance is rounding: the cell is left out.
LEAST_CHANCE = 1e-12
Array = NDArray[np.float64]
Cell = tuple[int, int]
# A hop of more than this part of a cell leaves too little room for the spread.
_LONGEST_HOP = 0.7


@numba.njit(cache=True)
def axis_chances(shift_cells, variance_cells2):
    """Return the chances that a parcel hops one cell back, stays, or hops one cell ahead, along one axis.

    p-, p0, p+ = (v + m^2 - m) / 2,  1 - v - m^2,  (v + m^2 + m) / 2
    [1]; m mean shift in cells, v variance in cells squared: the hops have exactly this mean and this variance.

    A variance below |m| (1 - |m|) cannot be had with three cells and is raised to that: the wind itself spreads what
    it carries by part of a cell.

    Args:
        shift_cells: m, from -1 to 1.
        variance_cells2: v, with v + m^2 <= 1.

    Source:
        Our derivation: three chances, three moments (0, 1 and 2).
    """
    spread = max(variance_cells2, abs(shift_cells) * (1.0 - abs(shift_cells))) + shift_cells * shift_cells
    return 0.5 * (spread - shift_cells), 1.0 - spread, 0.5 * (spread + shift_cells)


@numba.njit(cache=True)
def hop_chances(wind_m_s, step_s, cell_m, spread_m_sqrt_s):
    """Return the chances of hops along both axes for each cell.

    m = W dt / c,  v = s^2 dt / c^2        [1] = [m/s] [s] / [m],  [1] = [m2/s] [s] / [m2]

    Args:
        wind_m_s: (n_x, n_y, 2) wind W, world frame [m/s]; n_x = n_y = 1: the same everywhere.
        step_s: Time of a hop dt [s], short enough: see `count_hops_per_step`.
        cell_m: Edge of a cell c [m].
        spread_m_sqrt_s: A parcel wanders by s times the root of its age on each axis [m / sqrt(s)].

    Returns:
        (n_x, n_y, 2, 3): axis; back, stay, ahead.
    """
    n_x, n_y = wind_m_s.shape[0], wind_m_s.shape[1]
    chances = np.empty((n_x, n_y, 2, 3))
    variance = spread_m_sqrt_s * spread_m_sqrt_s * step_s / (cell_m * cell_m)
    for i in range(n_x):
        for j in range(n_y):
            for axis in range(2):
                back, stay, ahead = axis_chances(wind_m_s[i, j, axis] * step_s / cell_m, variance)
                chances[i, j, axis, 0] = back
                chances[i, j, axis, 1] = stay
                chances[i, j, axis, 2] = ahead
    return chances


@numba.njit(cache=True)
def _of_step(chances, m):
    return chances[min(m, chances.shape[0] - 1)]


@numba.njit(cache=True)
def _moves(chances, is_solid, i, j, move):
    # Fills move[3 (di + 1) + dj + 1] for a parcel in cell (i, j). Out of the grid it is gone; a wall keeps it.
    a = i if chances.shape[0] > 1 else 0
    b = j if chances.shape[1] > 1 else 0
    n_x, n_y = is_solid.shape
    kept = 0.0
    for di in range(-1, 2):
        for dj in range(-1, 2):
            chance = chances[a, b, 0, di + 1] * chances[a, b, 1, dj + 1]
            k = 3 * (di + 1) + dj + 1
            move[k] = chance
            x, y = i + di, j + dj
            if x < 0 or x >= n_x or y < 0 or y >= n_y:
                move[k] = 0.0
            elif is_solid[x, y] or (is_solid[x, j] and is_solid[i, y]):
                move[k] = 0.0
                kept += chance
    move[STAY] += kept


@numba.njit(cache=True)
def pull_back(chances, is_solid, last, n_steps):
    """Return the chance that a parcel in each cell at each time is, at the last time, where `last` says.

    b_m(i) = sum over j of a_ij(m) b_(m+1)(j),  b_n = last        a_ij(m) chance to hop from i to j in step m
    [1]

    Args:
        chances: (n_steps or 1, n_x or 1, n_y or 1, 2, 3) chances of hops by step (1: all alike) and cell.
        is_solid: (n_x, n_y) bool; parcels do not enter, and do not slip between two solid cells that touch in a corner.
        last: (n_x, n_y) what is observed at the last time: 1 in the sensor's cell, 0 elsewhere.

    Returns:
        (n_steps + 1, n_x, n_y), the last time at the end.

    Source:
        Rabiner 1989, A tutorial on hidden Markov models, doi:10.1109/5.18626, equation 25 (without observations on
        the way); as the model of a plume: Farrell, Pang, Li 2003 (remembered, unverified).
    Held by:
        extensions/search/tests/unit/bayes/test_hidden_markov.py (against all paths of a tiny grid)
    """
    n_x, n_y = is_solid.shape
    chance = np.zeros((n_steps + 1, n_x, n_y))
    chance[n_steps] = last
    move = np.empty(N_MOVES)
    low_i, high_i, low_j, high_j = _support(last)
    for m in range(n_steps - 1, -1, -1):
        # What was not within one cell of the parcels that arrive cannot arrive either.
        low_i, high_i = max(low_i - 1, 0), min(high_i + 1, n_x)
        low_j, high_j = max(low_j - 1, 0), min(high_j + 1, n_y)
        _pull_step(_of_step(chances, m), is_solid, chance[m + 1], chance[m], move, low_i, high_i, low_j, high_j)
        low_i, high_i, low_j, high_j = _trimmed(chance[m], low_i, high_i, low_j, high_j)
        if low_i >= high_i:
            break
    return chance


@numba.njit(cache=True)
def _pull_step(chances, is_solid, later, earlier, move, low_i, high_i, low_j, high_j):
    for i in range(low_i, high_i):
        for j in range(low_j, high_j):
            if is_solid[i, j]:
                continue
            _moves(chances, is_solid, i, j, move)
            total = 0.0
            for k in range(N_MOVES):
                if move[k] > 0.0:
                    total += move[k] * later[i + k // 3 - 1, j + k % 3 - 1]
            earlier[i, j] = total


@numba.njit(cache=True)
def _support(values):
    n_x, n_y = values.shape
    return _trimmed(values, 0, n_x, 0, n_y)


@numba.njit(cache=True)
def _trimmed(values, low_i, high_i, low_j, high_j):
    # The smallest window that holds all that matters; an empty one has low >= high.
    first_i, last_i, first_j, last_j = high_i, low_i, high_j, low_j
    for i in range(low_i, high_i):
        for j in range(low_j, high_j):
            if values[i, j] > LEAST_CHANCE:
                first_i, last_i = min(first_i, i), max(last_i, i + 1)
                first_j, last_j = min(first_j, j), max(last_j, j + 1)
    return first_i, last_i, first_j, last_j


@numba.njit(cache=True)
def best_back(chances, is_solid, last, n_steps):
    """Return, for each cell and time, how likely the best single path to `last` is, and its first hop.

    d_m(i) = max over j of a_ij(m) d_(m+1)(j),  d_n = last
    [1]; scaled to a maximum of 1 at each time, the logarithms of the scales are returned

    Arguments as in `pull_back`.

    Returns:
        d, (n_steps + 1, n_x, n_y); hops, (n_steps, n_x, n_y) int8: 3 (di + 1) + dj + 1, -1 where no path is; and
        log_scale, (n_steps + 1,): the likelihood is exp(log_scale[m]) d_m.

    Source:
        Viterbi's algorithm backward in time: Rabiner 1989, doi:10.1109/5.18626, equations 32 to 35.
    Held by:
        extensions/search/tests/unit/bayes/test_hidden_markov.py (against all paths of a tiny grid)
    """
    n_x, n_y = is_solid.shape
    best = np.zeros((n_steps + 1, n_x, n_y))
    hop = np.full((n_steps, n_x, n_y), NOWHERE, np.int8)
    log_scale = np.zeros(n_steps + 1)
    best[n_steps] = last
    move = np.empty(N_MOVES)
    low_i, high_i, low_j, high_j = _support(last)
    for m in range(n_steps - 1, -1, -1):
        low_i, high_i = max(low_i - 1, 0), min(high_i + 1, n_x)
        low_j, high_j = max(low_j - 1, 0), min(high_j + 1, n_y)
        highest = 0.0
        for i in range(low_i, high_i):
            for j in range(low_j, high_j):
                if is_solid[i, j]:
                    continue
                _moves(_of_step(chances, m), is_solid, i, j, move)
                for k in range(N_MOVES):
                    if move[k] <= 0.0:
                        continue
                    value = move[k] * best[m + 1, i + k // 3 - 1, j + k % 3 - 1]
                    if value > best[m, i, j]:
                        best[m, i, j] = value
                        hop[m, i, j] = k
                highest = max(highest, best[m, i, j])
        log_scale[m] = log_scale[m + 1]
        if highest <= 0.0:
            break
        log_scale[m] += elementary.log(highest)
        best[m, low_i:high_i, low_j:high_j] /= highest
    return best, hop, log_scale


def count_hops_per_step(step_s: float, fastest_m_s: float, cell_m: float, spread_m_sqrt_s: float) -> int:
    """Return into how many hops a step must be divided so that none is longer than a part of a cell.

    Smallest n with W dt / (n c) <= 0.7 and (W dt / (n c))^2 + s^2 dt / (n c^2) <= 1

    Args:
        step_s: Step dt [s].
        fastest_m_s: Fastest wind W along an axis [m/s].
        cell_m: Edge of a cell c [m].
        spread_m_sqrt_s: Spread s of parcels [m / sqrt(s)].
    """
    n = max(1, math.ceil(fastest_m_s * step_s / (_LONGEST_HOP * cell_m)))
    hop, spread = fastest_m_s * step_s / cell_m, spread_m_sqrt_s * spread_m_sqrt_s * step_s / (cell_m * cell_m)
    while hop * hop / (n * n) + spread / n > 1.0:
        n += 1
    return n


@dataclass(frozen=True, kw_only=True)
class ParcelChain:
    """The chain of a parcel over the last hops: `chances` as `hop_chances` gives them, the oldest first.

    `is_solid` are the cells that no parcel enters; `hop_s` is the time of a hop.
    """

    grid: CellGrid
    is_solid: NDArray[np.bool_]
    chances: Array
    n_hops: int
    hop_s: float


def build_chain_in_uniform_wind(
    grid: CellGrid, is_solid: NDArray[np.bool_], winds_m_s: Array, *, step_s: float, spread_m_sqrt_s: float
) -> ParcelChain:
    """Return the chain in a wind that changes in time and is the same everywhere.

    Args:
        is_solid: Cells that no parcel enters, of the grid's shape.
        winds_m_s: (n_steps, 2) wind of each step, the oldest first, world frame [m/s].
        spread_m_sqrt_s: Spread of parcels on each axis [m / sqrt(s)].
    """
    fastest_m_s = float(np.abs(winds_m_s).max(initial=0.0))
    n = count_hops_per_step(step_s, fastest_m_s, grid.cell_m, spread_m_sqrt_s)
    by_step = [hop_chances(wind[None, None, :], step_s / n, grid.cell_m, spread_m_sqrt_s) for wind in winds_m_s]
    chances = np.repeat(np.array(by_step).reshape(-1, 1, 1, 2, 3), n, axis=0)
    return ParcelChain(grid=grid, is_solid=is_solid, chances=chances, n_hops=len(chances), hop_s=step_s / n)


def build_chain_in_wind_field(
    grid: CellGrid, is_solid: NDArray[np.bool_], field_m_s: Array, *, window_s: float, spread_m_sqrt_s: float
) -> ParcelChain:
    """Return the chain in a steady wind that differs from cell to cell.

    Args:
        is_solid: Cells that no parcel enters, of the grid's shape.
        field_m_s: (nx, ny, 2) wind of each cell, world frame [m/s].
        window_s: How far back the chain goes [s].
        spread_m_sqrt_s: Spread of parcels on each axis [m / sqrt(s)].
    """
    fastest_m_s = float(np.abs(field_m_s).max(initial=0.0))
    n = count_hops_per_step(1.0, fastest_m_s, grid.cell_m, spread_m_sqrt_s)
    chances = hop_chances(field_m_s, 1.0 / n, grid.cell_m, spread_m_sqrt_s)[None]
    return ParcelChain(grid=grid, is_solid=is_solid, chances=chances, n_hops=max(1, round(window_s * n)), hop_s=1.0 / n)


def compute_arrival_probabilities(plume: ParcelChain, sensor: Cell) -> Array:
    """Return the chance that a parcel which left each cell at each hop is in the sensor's cell now.

    Returns:
        (n_hops + 1, nx, ny); the last is now, where it is 1 in the sensor's cell and 0 elsewhere.
    """
    return pull_back(plume.chances, plume.is_solid, _only(plume.grid, sensor), plume.n_hops)


def compute_finding_likelihoods(
    chance: Array, *, detection_probability: float, puffs_per_hop: float
) -> tuple[Array, Array]:
    """Return the likelihoods of a detection and of its absence for a source in each cell, as in puff tracing.

    detection: beta_i = mean over m of b_m(i);  none: ln gamma_i = r sum over m of ln(1 - mu b_m(i))
    [1]; b as `compute_arrival_probabilities` gives it, r puffs released in the time of a hop, mu their chance to be
    detected where met

    Source:
        Pang and Farrell 2006, IEEE Trans. SMC-B 36, 1068, with the chain's chances in place of a uniform wind's.
    """
    missed = elementary.log1p_each(-detection_probability * chance)
    return chance.mean(axis=0), puffs_per_hop * missed.sum(axis=0)


@dataclass(frozen=True, kw_only=True)
class PlumePath:
    """The cells that a parcel most likely went through, from a source to the sensor, and that path's log likelihood."""

    cells: tuple[Cell, ...]
    log_likelihood: float


def likeliest_path(plume: ParcelChain, sensor: Cell, source: Array) -> PlumePath | None:
    """Return the single most likely way of a parcel from a source to the sensor; absent where none leads there.

    argmax over m, i of p(i) d_m(i)        p the belief in the source, d as `best_back` gives it

    The parcel may have left at any hop of the window but the last; of equally good ways the one that left last.

    Args:
        sensor: The sensor's cell.
        source: (nx, ny) probability of each cell to hold the source.

    Source:
        Viterbi's algorithm, as for plumes in Farrell, Pang, Li 2003 (remembered, unverified).
    Held by:
        extensions/search/tests/unit/bayes/test_hidden_markov.py (against all paths of a tiny grid)
    """
    n = plume.n_hops
    best, hop, log_scale = best_back(plume.chances, plume.is_solid, _only(plume.grid, sensor), n)
    highest, start = -math.inf, (0, 0, 0)
    for m in range(n - 1, -1, -1):
        together = source * best[m]
        peak = float(together.max())
        value = elementary.log(peak) + float(log_scale[m]) if peak > 0.0 else -math.inf
        if value > highest + 1e-12:
            i, j = np.unravel_index(int(together.argmax()), together.shape)
            highest, start = value, (m, int(i), int(j))
    return PlumePath(cells=_followed(hop, start), log_likelihood=highest) if math.isfinite(highest) else None


def _followed(hop: NDArray[np.int8], start: tuple[int, int, int]) -> tuple[Cell, ...]:
    m, i, j = start
    cells = [(i, j)]
    while m < len(hop) and (k := int(hop[m, i, j])) != NOWHERE:
        m, i, j = m + 1, i + k // 3 - 1, j + k % 3 - 1
        cells.append((i, j))
    return tuple(cells)


def _only(grid: CellGrid, cell: Cell) -> Array:
    here = np.zeros(grid.shape)
    here[cell] = 1.0
    return here


def place_along_m(path: PlumePath, grid: CellGrid, back_m: float) -> tuple[float, float]:
    """Return the centre of the path's cell that lies at least so far back from the sensor, or its start [m]."""
    places_m = [grid.centre_m(cell) for cell in path.cells]
    end_m = places_m[-1]
    x_m, y_m = next((place_m for place_m in reversed(places_m) if distance(place_m, end_m) >= back_m), places_m[0])
    return x_m, y_m


def warm_up() -> None:
    """Compile the kernels, or load them from the cache on disk, so that no decision has to wait for it."""
    grid, open_air = CellGrid((0.0, 0.0), 1.0, (2, 2)), np.zeros((2, 2), np.bool_)
    in_wind = build_chain_in_uniform_wind(grid, open_air, np.zeros((2, 2)), step_s=1.0, spread_m_sqrt_s=0.2)
    in_field = build_chain_in_wind_field(grid, open_air, np.zeros((2, 2, 2)), window_s=1.0, spread_m_sqrt_s=0.2)
    for plume in (in_wind, in_field):
        compute_arrival_probabilities(plume, (0, 0))
        likeliest_path(plume, (0, 0), np.full((2, 2), 0.25))
