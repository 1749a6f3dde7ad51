# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Wind map over the free cells of a room, from readings at a few places, and its solver of banded equations.

The wind is a Gaussian Markov random field: what is believed of it before any reading is a sparse matrix that depends on
the room alone. It is factorised once. Each place where the wind was read then costs two back substitutions and the
estimate a small dense system, so nothing large is solved in flight and no iteration has to converge.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.motion.grid_paths import Free, nearest_free

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Central differences, and half as much of those across the diagonals: what each neighbour's x and y count.
_ACROSS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
# An equation kind: the unknowns of each row, (n, k) with -1 for the zeros of solid cells, their factors, a weight.
_Equations = tuple[Index, tuple[float, ...], float]


@numba.njit(cache=True, nogil=True)
def factorise_cholesky_inplace(band):
    """Factorise a symmetric positive matrix into a triangle times its mirror image: A = L L^T.

    Args:
        band: (n, w + 1) lower band of A, band[i, w - (i - j)] = A[i, j] for i - w <= j <= i, zero where j < 0; replaced
            by L in the same form. Pure numbers.

    Returns:
        Whether it worked: False where A is not positive.

    Source:
        Golub and Van Loan 2013, Matrix Computations, section 4.3 (banded Cholesky).
    Held by:
        extensions/search/tests/unit/maps/test_wind_map.py (against numpy's dense solver)
    """
    n, width = band.shape[0], band.shape[1] - 1
    column = np.empty(width + 1)
    for j in range(n):
        pivot = band[j, width]
        if not pivot > 0.0:
            return False
        pivot = math.sqrt(pivot)
        band[j, width] = pivot
        m = min(width, n - 1 - j)
        for d in range(1, m + 1):
            column[d] = band[j + d, width - d] / pivot
            band[j + d, width - d] = column[d]
        for d in range(1, m + 1):
            factor = column[d]
            if factor == 0.0:
                continue
            row = band[j + d, width - d : width + 1]
            for k in range(1, d + 1):
                row[k] -= factor * column[k]
    return True


@numba.njit(cache=True, nogil=True)
def solve_cholesky_inplace(band, values):
    """Solve L L^T x = b for several right sides.

    Args:
        band: (n, w + 1) lower band of L, as `factorise_cholesky_inplace` leaves it.
        values: (m, n) right sides b, one a row, replaced by the solutions x.

    Held by:
        extensions/search/tests/unit/maps/test_wind_map.py (against numpy's dense solver)
    """
    n, width = band.shape[0], band.shape[1] - 1
    for c in range(values.shape[0]):
        x = values[c]
        for i in range(n):
            first = max(0, i - width)
            row, before = band[i, width - (i - first) :], x[first : i + 1]
            total = x[i]
            for k in range(i - first):
                total -= row[k] * before[k]
            x[i] = total / band[i, width]
        for i in range(n - 1, -1, -1):
            first = max(0, i - width)
            row, before = band[i, width - (i - first) :], x[first : i + 1]
            value = x[i] / band[i, width]
            x[i] = value
            for k in range(i - first):
                before[k] -= row[k] * value


@numba.njit(cache=True, nogil=True)
def factorise_lu_inplace(band):
    """Factorise a matrix into a lower and an upper triangle, A = L U, without exchanging rows.

    Stable where each diagonal number outweighs the rest of its column, as in balances of what flows between cells.

    Args:
        band: (n, 2 w + 1) band of A, band[i, w + j - i] = A[i, j] for |i - j| <= w, zero outside of A; replaced by U
            and, below the diagonal, by L without its ones. Pure numbers.

    Source:
        Golub and Van Loan 2013, Matrix Computations, section 4.3 (banded LU).
    Held by:
        extensions/search/tests/unit/maps/test_wind_map.py (against numpy's dense solver)
    """
    n, width = band.shape[0], band.shape[1] // 2
    for k in range(n):
        above = band[k, width + 1 :]
        m = min(width, n - 1 - k)
        for d in range(1, m + 1):
            if band[k + d, width - d] == 0.0:
                continue
            factor = band[k + d, width - d] / band[k, width]
            band[k + d, width - d] = factor
            row = band[k + d, width - d + 1 : 2 * width - d + 1]
            for c in range(m):
                row[c] -= factor * above[c]


@numba.njit(cache=True, nogil=True)
def solve_transposed_lu_inplace(band, values):
    """Solve A^T X = B for several right sides, where A = L U.

    Args:
        band: (n, 2 w + 1) band of L and U, as `factorise_lu_inplace` leaves it.
        values: (n, m) right sides B, replaced by X.

    Held by:
        extensions/search/tests/unit/maps/test_wind_map.py (against numpy's dense solver)
    """
    n, width = band.shape[0], band.shape[1] // 2
    m = values.shape[1]
    for i in range(n):
        for c in range(m):
            values[i, c] /= band[i, width]
        for j in range(i + 1, min(n, i + width + 1)):
            factor = band[i, width + j - i]
            for c in range(m):
                values[j, c] -= factor * values[i, c]
    for i in range(n - 1, -1, -1):
        for j in range(max(0, i - width), i):
            factor = band[i, width + j - i]
            for c in range(m):
                values[j, c] -= factor * values[i, c]


@numba.njit(cache=True, nogil=True)
def add_rows_inplace(total, factors, rows):
    """Add a weighted sum of rows, in their order: total += sum over r of f_r rows_r.

    Args:
        total: (n,) sums; modified.
        factors: (n_rows,) weights.
        rows: (n_rows, n) what is added.

    Held by:
        extensions/search/tests/unit/maps/test_wind_map.py
    """
    for r in range(rows.shape[0]):
        factor = factors[r]
        for i in range(rows.shape[1]):
            total[i] += factor * rows[r, i]


@dataclass(frozen=True, kw_only=True)
class WindWeights:
    """Weights of each kind of equation, all winds in the same unit.

    `smoothness`: neighbours have equal wind. `divergence`: what flows into a cell flows out of it. `wall`: no wind into
    a wall. `reading`: the wind is as it was read. `calm`: the wind is zero; a trace of it decides where nothing else
    does. `forgetting`: the share of their weight that earlier readings lose with every new one.
    """

    smoothness: float = 1.0
    divergence: float = 1e4
    wall: float = 10.0
    reading: float = 10.0
    calm: float = 1e-5
    forgetting: float = 0.0


class WindMap:
    """Estimates the wind in every free cell of a room in the plane.

    W minimises  a_s sum |W_i - W_j|^2  over neighbours i, j
               + a_d sum (div W)_i^2    over free cells, (div W)_i in central differences over two cells
               + a_w sum (W_i . n)^2    over the faces n of free cells towards solid ones
               + a_r sum |W_k - y_k|^2  over readings y_k        + a_c sum |W_i|^2
    [m2/s2] each; the weights a are pure numbers. W is 0 in solid cells.

    Solved as W = U (H U + diag(1/a_r))^-1 y, U = Q^-1 H^T, where Q is the matrix of all terms but the readings and H
    picks the cells that were read. Q is banded in the order of the cells; U is kept.

    State: readings by cell (weight and mean), and one pair of columns of U for each such cell.

    Source:
        Monroy, Jaimez, Gonzalez-Jimenez 2017, Online estimation of 2D wind maps for olfactory robots, ISOEN; terms and
        weights as in the group's public code [C].
    Deviation:
        Solved by the factors of the prior instead of again for each reading, which is the same to rounding. `calm` is
        ours: without it a room that is open all round has no unique answer. Edges of the grid are walls, or open.
    Held by:
        extensions/search/tests/unit/maps/test_wind_map.py (against numpy's dense least squares)
    """

    def __init__(
        self,
        free: Free,
        grid: CellGrid,
        *,
        weights: WindWeights | None = None,
        edges: Literal["walls", "open"] = "walls",
    ) -> None:
        """Factorise what is known of the wind in a room before any reading.

        Args:
            free: (nx, ny) whether a cell is free.
            weights: How much each term counts.
            edges: Whether the edges of the grid are walls, or whether the wind passes them.
        """
        self._free, self._grid, self._weights = free, grid, weights or WindWeights()
        self._numbers = _numbered(free)
        self._factors = _prior_matrix(free, self._numbers, self._weights, edges)
        assert factorise_cholesky_inplace(self._factors), "the calm term makes the matrix positive"
        self._sums: dict[int, tuple[float, float, float]] = {}  # by cell's number: weight, weighted x and y
        self._columns: dict[int, Array] = {}
        self._estimate: Array | None = None

    def add(self, point_m: Sequence[float], wind_world_m_s: Sequence[float]) -> None:
        """Take note of the wind at a point, [m] and [m/s]; it counts for the free cell nearest to it."""
        cell = nearest_free(self._free, self._grid, point_m)
        if cell is None:
            return
        number = int(self._numbers[cell])
        if number not in self._columns:
            self._columns[number] = self._columns_of(number)
        kept = 1.0 - self._weights.forgetting
        self._sums = {n: (kept * w, kept * x, kept * y) for n, (w, x, y) in self._sums.items()}
        weight, x, y = self._sums.get(number, (0.0, 0.0, 0.0))
        a = self._weights.reading
        self._sums[number] = (weight + a, x + a * wind_world_m_s[0], y + a * wind_world_m_s[1])
        self._estimate = None

    def wind_m_s(self) -> Array:
        """Return the wind at the cell centres, (nx, ny, 2), world frame [m/s]; 0 in solid cells."""
        if self._estimate is None:
            self._estimate = self._estimated()
        return self._estimate

    # Two rows: the field that belongs to a unit of x, and of y, in that cell.
    def _columns_of(self, number: int) -> Array:
        columns = np.zeros((2, len(self._factors)))
        columns[0, 2 * number] = columns[1, 2 * number + 1] = 1.0
        solve_cholesky_inplace(self._factors, columns)
        return columns

    def _estimated(self) -> Array:
        wind_m_s = np.zeros((*self._free.shape, 2))
        if not self._sums:
            return wind_m_s
        numbers = list(self._sums)
        columns = np.concatenate([self._columns[number] for number in numbers])
        at = np.array([2 * number + axis for number in numbers for axis in (0, 1)])
        weight = np.repeat([self._sums[number][0] for number in numbers], 2)
        sums = np.array([self._sums[number][1:] for number in numbers]).reshape(-1)
        shares = _solved(columns[:, at] + np.diag(1.0 / weight), sums / weight)
        field_m_s = np.zeros(columns.shape[1])
        add_rows_inplace(field_m_s, shares, columns)
        wind_m_s[self._free] = field_m_s.reshape(-1, 2)[self._numbers[self._free]]
        return wind_m_s


# A full symmetric matrix is a band as wide as it is long. Not by numpy: how it shares work among threads must not show
# in the last bit.
def _solved(matrix: Array, side: Array) -> Array:
    n = len(matrix)
    band = np.zeros((n, n))
    for i in range(n):
        band[i, n - 1 - i :] = matrix[i, : i + 1]
    assert factorise_cholesky_inplace(band), "the weights of readings make the matrix positive"
    solution = side[None].copy()
    solve_cholesky_inplace(band, solution)
    return solution[0]


# Free cells get their numbers along the shorter axis first, so that neighbours have near ones.
def _numbered(free: Free) -> Index:
    if free.shape[0] < free.shape[1]:
        return _numbered(free.T).T
    numbers = np.full(free.shape, -1, np.int64)
    numbers[free] = np.arange(int(free.sum()))
    return numbers


def _prior_matrix(free: Free, numbers: Index, weights: WindWeights, edges: str) -> Array:
    """Return Q as a lower band: the sum over the equations of weight times row times row."""
    equations = [
        *_smoothness(numbers, weights.smoothness),
        *_divergence(numbers, weights.divergence, edges),
        *_walls(numbers, weights.wall, edges),
    ]
    equations = [equation for equation in equations if len(equation[0]) > 0]
    width = max((_spread(columns) for columns, _, _ in equations), default=0)
    band = np.zeros((2 * int(free.sum()), width + 1))
    band[:, width] = weights.calm
    for columns, factors, weight in equations:
        for a in range(columns.shape[1]):
            for b in range(columns.shape[1]):
                kept = (columns[:, b] >= 0) & (columns[:, a] >= columns[:, b])
                rows, before = columns[kept, a], columns[kept, b]
                np.add.at(band, (rows, width - (rows - before)), weight * factors[a] * factors[b])
    return band


# How far apart the unknowns of one equation are at most.
def _spread(columns: Index) -> int:
    least = np.where(columns < 0, columns.max(), columns).min(axis=1)
    return max(0, int((columns.max(axis=1) - least).max()))


def _smoothness(numbers: Index, weight: float) -> list[_Equations]:
    equations: list[_Equations] = []
    for here, there in ((numbers[:-1], numbers[1:]), (numbers[:, :-1], numbers[:, 1:])):
        both = (here >= 0) & (there >= 0)
        pairs = np.stack([here[both], there[both]], axis=1)
        equations += [(2 * pairs + axis, (1.0, -1.0), weight) for axis in (0, 1)]
    return equations


def _divergence(numbers: Index, weight: float, edges: str) -> list[_Equations]:
    padded = np.pad(numbers, 1, constant_values=-1)
    columns, factors = [], []
    for di, dj in _ACROSS:
        there = padded[1 + di : padded.shape[0] - 1 + di, 1 + dj : padded.shape[1] - 1 + dj]
        share = 0.5 if di == 0 or dj == 0 else 0.125
        for axis, step in ((0, di), (1, dj)):
            if step != 0:
                columns.append(np.where(there >= 0, 2 * there + axis, -1))
                factors.append(share * step)
    counted = numbers >= 0
    if edges == "open":
        counted[[0, -1]] = counted[:, [0, -1]] = False
    return [(np.stack([column[counted] for column in columns], axis=1), tuple(factors), weight)]


def _walls(numbers: Index, weight: float, edges: str) -> list[_Equations]:
    outside = -1 if edges == "walls" else 0
    padded = np.pad(numbers, 1, constant_values=outside)
    equations: list[_Equations] = []
    for axis, (di, dj) in ((0, (1, 0)), (0, (-1, 0)), (1, (0, 1)), (1, (0, -1))):
        there = padded[1 + di : padded.shape[0] - 1 + di, 1 + dj : padded.shape[1] - 1 + dj]
        touches = (numbers >= 0) & (there < 0)
        equations.append((2 * numbers[touches][:, None] + axis, (1.0,), weight))
    return equations


def warm_up() -> None:
    """Load or compile what a map runs, on a few cells, so that nothing is compiled in flight."""
    free = np.ones((3, 3), np.bool_)
    winds = WindMap(free, CellGrid((0.0, 0.0), 1.0, free.shape))
    winds.add((1.5, 1.5), (1.0, 0.0))
    winds.wind_m_s()
