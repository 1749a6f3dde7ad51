import numpy as np
import pytest

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.maps.wind_map import (
    WindMap,
    WindWeights,
    add_rows_inplace,
    factorise_cholesky_inplace,
    factorise_lu_inplace,
    solve_cholesky_inplace,
    solve_transposed_lu_inplace,
)

READINGS = {(1, 2): (0.4, 0.1), (6, 3): (-0.2, 0.3), (4, 7): (0.0, -0.5)}
N, WIDTH = 40, 6


def room_with_wall() -> np.ndarray:
    free = np.ones((9, 10), bool)
    free[4, :6] = False
    return free


def wind_map(free: np.ndarray, readings: dict = READINGS, **settings) -> WindMap:
    grid = CellGrid((0.0, 0.0), 0.5, free.shape)
    winds = WindMap(free, grid, **settings)
    for cell, wind_m_s in readings.items():
        winds.add(grid.centre_m(cell), wind_m_s)
    return winds


def neighbour(cell, step, free):
    """The neighbouring cell, None in solid ones and outside."""
    other = (cell[0] + step[0], cell[1] + step[1])
    is_inside = 0 <= other[0] < free.shape[0] and 0 <= other[1] < free.shape[1]
    return other if is_inside and free[other] else None


def dense_solution(free: np.ndarray, readings: dict, weights: WindWeights) -> np.ndarray:
    """All equations one by one as rows of a dense least-squares problem, edges as walls."""
    cells = [tuple(int(i) for i in cell) for cell in np.argwhere(free)]
    place = {cell: 2 * n for n, cell in enumerate(cells)}
    rows, values = [], []

    def equation(weight, terms, value=0.0):
        row = np.zeros(2 * len(cells))
        for cell, axis, factor in terms:
            if cell is not None:
                row[place[cell] + axis] += factor
        rows.append(np.sqrt(weight) * row)
        values.append(np.sqrt(weight) * value)

    for cell in cells:
        divergence = []
        for step in np.ndindex(3, 3):
            di, dj = step[0] - 1, step[1] - 1
            other = neighbour(cell, (di, dj), free)
            share = 0.125 if di and dj else 0.5
            divergence += [(other, 0, share * di), (other, 1, share * dj)]
            if abs(di) + abs(dj) == 1:
                axis = 0 if di else 1
                if other is None:
                    equation(weights.wall, [(cell, axis, 1.0)])
                elif di + dj > 0:
                    for both in (0, 1):
                        equation(weights.smoothness, [(cell, both, 1.0), (other, both, -1.0)])
        equation(weights.divergence, divergence)
        for axis in (0, 1):
            equation(weights.calm, [(cell, axis, 1.0)])
    for cell, wind_m_s in readings.items():
        for axis in (0, 1):
            equation(weights.reading, [(cell, axis, 1.0)], wind_m_s[axis])
    solution = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0]
    field = np.zeros((*free.shape, 2))
    field[free] = solution.reshape(-1, 2)
    return field


@pytest.mark.parametrize("shape_axis", [0, 1])
@pytest.mark.parametrize("divergence", [1.0, 1e4])
def test_the_wind_is_that_of_dense_least_squares(shape_axis, divergence):
    free, readings = room_with_wall(), READINGS
    if shape_axis == 1:
        free, readings = free.T.copy(), {(j, i): wind for (i, j), wind in READINGS.items()}
    weights = WindWeights(divergence=divergence)
    expected = dense_solution(free, readings, weights)
    assert wind_map(free, readings, weights=weights).wind_m_s() == pytest.approx(expected, abs=1e-6)


def test_a_second_reading_in_a_cell_counts_as_much_as_the_first():
    free = room_with_wall()
    twice = wind_map(free)
    twice.add((0.75, 1.25), (0.0, 0.3))
    weighted = wind_map(free, {**READINGS, (1, 2): (0.2, 0.2)})
    weighted.add((0.75, 1.25), (0.2, 0.2))
    assert twice.wind_m_s() == pytest.approx(weighted.wind_m_s(), abs=1e-9)


def test_earlier_readings_are_forgotten_by_their_share():
    free = np.ones((6, 6), bool)
    winds = wind_map(free, {}, weights=WindWeights(forgetting=0.5), edges="open")
    winds.add((1.0, 1.0), (1.0, 0.0))
    winds.add((1.0, 1.0), (0.0, 0.0))
    assert winds.wind_m_s()[2, 2, 0] == pytest.approx(1.0 / 3.0, rel=1e-3)


def test_without_a_free_cell_readings_are_ignored():
    winds = wind_map(np.zeros((4, 4), bool), {(1, 1): (1.0, 0.0)})
    assert (winds.wind_m_s() == 0.0).all()


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
