import numpy as np
import pytest

from gslcosim_search.maps.wind_map import (
    add_rows_inplace,
    factorise_cholesky_inplace,
    factorise_lu_inplace,
    solve_cholesky_inplace,
    solve_transposed_lu_inplace,
)

N, WIDTH = 40, 6


def banded_matrix(seed: int) -> np.ndarray:
    """Numbers near the diagonal only, each diagonal one more than the rest of its column together."""
    matrix = np.random.default_rng(seed).normal(size=(N, N))
    away = np.abs(np.arange(N)[:, None] - np.arange(N))
    matrix[(away > WIDTH) | (away == 0)] = 0.0
    return matrix + np.diag(np.abs(matrix).sum(axis=0) + 0.1)


def band_of(matrix: np.ndarray, above: int) -> np.ndarray:
    band = np.zeros((N, WIDTH + above + 1))
    for i in range(N):
        for j in range(max(0, i - WIDTH), min(N, i + above + 1)):
            band[i, WIDTH + j - i] = matrix[i, j]
    return band


@pytest.mark.parametrize("seed", range(5))
def test_cholesky_solves_as_a_dense_solver_does(seed):
    lower = np.tril(banded_matrix(seed))
    matrix = lower @ lower.T
    band = band_of(matrix, above=0)
    sides = np.random.default_rng(seed).normal(size=(N, 3))
    solution = np.ascontiguousarray(sides.T)
    assert factorise_cholesky_inplace(band)
    solve_cholesky_inplace(band, solution)
    assert np.linalg.solve(matrix, sides) == pytest.approx(solution.T, rel=1e-9, abs=1e-12)


def test_cholesky_refuses_a_matrix_that_is_not_positive():
    matrix = banded_matrix(1)
    matrix = matrix + matrix.T
    matrix[7, 7] = -1.0
    assert not factorise_cholesky_inplace(band_of(matrix, above=0))


@pytest.mark.parametrize("seed", range(5))
def test_lu_solves_the_transposed_equations_as_a_dense_solver_does(seed):
    matrix = banded_matrix(seed)
    band = band_of(matrix, above=WIDTH)
    sides = np.random.default_rng(seed).normal(size=(N, 3))
    solution = sides.copy()
    factorise_lu_inplace(band)
    solve_transposed_lu_inplace(band, solution)
    assert solution == pytest.approx(np.linalg.solve(matrix.T, sides), rel=1e-9, abs=1e-12)


def test_rows_are_added_with_their_factors():
    total = np.array([1.0, 2.0])
    add_rows_inplace(total, np.array([2.0, -1.0]), np.array([[1.0, 10.0], [3.0, 4.0]]))
    assert total.tolist() == [0.0, 18.0]
