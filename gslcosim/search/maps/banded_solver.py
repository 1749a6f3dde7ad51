"""Solver of banded linear equations, as of fields over the cells of a room."""

# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
# pyright: basic

import math

import numba
import numpy as np


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
        tests/unit/search/maps/test_banded_solver.py (against numpy's dense solver)
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
        tests/unit/search/maps/test_banded_solver.py (against numpy's dense solver)
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
        tests/unit/search/maps/test_banded_solver.py (against numpy's dense solver)
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
        tests/unit/search/maps/test_banded_solver.py (against numpy's dense solver)
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
        tests/unit/search/maps/test_banded_solver.py
    """
    for r in range(rows.shape[0]):
        factor = factors[r]
        for i in range(rows.shape[1]):
            total[i] += factor * rows[r, i]
