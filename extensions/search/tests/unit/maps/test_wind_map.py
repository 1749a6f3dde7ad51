import numpy as np
import pytest

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.maps.wind_map import WindMap, WindWeights

READINGS = {(1, 2): (0.4, 0.1), (6, 3): (-0.2, 0.3), (4, 7): (0.0, -0.5)}


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


def test_without_a_reading_there_is_no_wind():
    assert (wind_map(room_with_wall(), {}).wind_m_s() == 0.0).all()


def test_without_a_free_cell_readings_are_ignored():
    winds = wind_map(np.zeros((4, 4), bool), {(1, 1): (1.0, 0.0)})
    assert (winds.wind_m_s() == 0.0).all()
