import math

import numpy as np
import pytest

from gslcosim_search.maps.pmfs import BackwardPlume, PlumeModel

CELL_M = 0.25


def even_wind(free: np.ndarray, x_m_s: float, y_m_s: float = 0.0) -> np.ndarray:
    return np.where(free[..., None], np.array([x_m_s, y_m_s]), 0.0)


def puffs(free: np.ndarray, wind_m_s: np.ndarray, cells, **model) -> np.ndarray:
    """Mean number of puffs in each of the cells, by source, in the shape of the room."""
    plume = BackwardPlume(free, CELL_M, wind_m_s, PlumeModel(**model))
    numbers = np.zeros((len(cells), *free.shape))
    numbers[:, free] = -np.log1p(-plume.shares(cells))
    return numbers


@pytest.mark.parametrize("shape", [(12, 9), (9, 12)])
def test_all_puffs_of_a_source_together_are_its_rate_times_their_lifetime(shape):
    """Summed over the cells a puff may be in, whatever the wind and the walls: nothing is lost but by age."""
    free = np.ones(shape, bool)
    free[4, :6] = False
    wind_m_s = np.random.default_rng(1).normal(size=(*shape, 2))
    cells = [tuple(cell) for cell in np.argwhere(free)]
    total = puffs(free, wind_m_s, cells, puffs_per_s=0.01, lifetime_s=40.0).sum(axis=0)
    assert total[free] == pytest.approx(0.4, rel=1e-9)


def test_in_a_channel_downwind_of_a_source_there_are_as_many_puffs_as_the_wind_leaves_there():
    """N = q h / U in a channel one cell wide, far from its ends and with little loss."""
    free = np.zeros((60, 3), bool)
    free[:, 1] = True
    number = puffs(free, even_wind(free, 0.5), [(40, 1)], puffs_per_s=0.2, diffusivity_m2_s=0.01, lifetime_s=1e4)[0]
    assert number[20, 1] == pytest.approx(0.2 * CELL_M / 0.5, rel=0.01)
    assert number[50, 1] < 1e-3 * number[20, 1]


def test_the_solution_is_that_of_the_dense_forward_equations():
    free = np.ones((7, 6), bool)
    free[3, 2:] = False
    wind_m_s = np.random.default_rng(2).normal(scale=0.3, size=(7, 6, 2))
    model = {"puffs_per_s": 0.1, "diffusivity_m2_s": 0.02, "lifetime_s": 30.0}
    cells = [tuple(int(i) for i in cell) for cell in np.argwhere(free)]
    matrix = np.zeros((len(cells), len(cells)))
    for i, cell in enumerate(cells):
        matrix[i, i] += CELL_M**2 / 30.0
        for j, other in enumerate(cells):
            step = np.subtract(other, cell)
            if abs(step).sum() != 1:
                continue
            through_m_s = float(step @ (wind_m_s[cell] + wind_m_s[other]) / 2.0)
            peclet = through_m_s * CELL_M / 0.02
            matrix[i, i] += 0.02 * -peclet / math.expm1(-peclet)
            matrix[i, j] -= 0.02 * peclet / math.expm1(peclet)
    forward = 0.1 * CELL_M**2 * np.linalg.inv(matrix)
    assert puffs(free, wind_m_s, cells, **model)[:, free] == pytest.approx(forward, rel=1e-9)
