"""The hidden Markov model of a plume against all paths of a tiny grid, one by one, and against moments."""

import itertools
import math

import numpy as np
import pytest

from gslcosim_search.bayes.hidden_markov import (
    PlumePath,
    axis_chances,
    build_chain_in_uniform_wind,
    build_chain_in_wind_field,
    compute_arrival_probabilities,
    compute_finding_likelihoods,
    count_hops_per_step,
    hop_chances,
    likeliest_path,
    place_along_m,
)
from gslcosim_search.beliefs import CellGrid, normalised

TINY = CellGrid((0.0, 0.0), 1.0, (3, 2))
WALL = np.array([[False, False], [True, False], [False, False]])
OPEN = np.zeros((3, 2), bool)
WINDS_M_S = np.array([[0.3, 0.2], [-0.4, 0.1], [0.5, 0.0]])
SPREAD = 0.5


def matrix(plume, m):
    """The chain's transition matrix of one hop, from its rules: 9 moves, walls keep, borders lose."""
    n_x, n_y = plume.grid.shape
    chances = plume.chances[min(m, len(plume.chances) - 1)]
    table = np.zeros((n_x * n_y, n_x * n_y))
    for i, j in itertools.product(range(n_x), range(n_y)):
        if plume.is_solid[i, j]:
            continue
        here = chances[i if chances.shape[0] > 1 else 0, j if chances.shape[1] > 1 else 0]
        for di, dj in itertools.product((-1, 0, 1), repeat=2):
            x, y = i + di, j + dj
            if not (0 <= x < n_x and 0 <= y < n_y):
                continue
            is_kept = plume.is_solid[x, y] or (plume.is_solid[x, j] and plume.is_solid[i, y])
            to = (i, j) if is_kept else (x, y)
            table[i * n_y + j, to[0] * n_y + to[1]] += here[0, di + 1] * here[1, dj + 1]
    return table


def paths(plume):
    """Every path through the cells, with its chance given where it begins."""
    tables = [matrix(plume, m) for m in range(plume.n_hops)]
    for path in itertools.product(range(plume.grid.n_cells), repeat=plume.n_hops + 1):
        chance = math.prod(tables[m][path[m], path[m + 1]] for m in range(plume.n_hops))
        if chance > 0.0:
            yield path, chance


def tiny_plumes():
    in_wind = build_chain_in_uniform_wind(TINY, WALL, WINDS_M_S, step_s=1.0, spread_m_sqrt_s=SPREAD)
    field = np.random.default_rng(3).uniform(-0.5, 0.5, (3, 2, 2))
    return [in_wind, build_chain_in_wind_field(TINY, OPEN, field, window_s=3.0, spread_m_sqrt_s=SPREAD)]


@pytest.fixture(params=[0, 1], ids=["wind", "field"])
def plume(request):
    made = tiny_plumes()[request.param]
    assert made.n_hops == 3
    return made


@pytest.mark.parametrize(("shift", "variance"), [(0.0, 0.3), (0.4, 0.5), (-0.7, 0.3), (0.0, 0.0), (1.0, 0.0)])
def test_hops_have_the_mean_and_the_variance_of_the_parcel(shift, variance):
    back, stay, ahead = axis_chances(shift, variance)
    assert min(back, stay, ahead) >= -1e-15
    assert back + stay + ahead == pytest.approx(1.0)
    assert ahead - back == pytest.approx(shift)
    assert ahead + back - shift**2 == pytest.approx(variance)


@pytest.mark.parametrize(
    ("fastest", "cell", "spread"), [(0.0, 0.5, 0.2), (1.0, 0.5, 0.2), (3.0, 0.2, 0.5), (0.1, 1.0, 3.0)]
)
def test_a_step_is_divided_so_that_hops_fit_into_three_cells_and_not_finer(fastest, cell, spread):
    n = count_hops_per_step(1.0, fastest, cell, spread)

    def fits(k):
        shift, variance = fastest / (k * cell), spread**2 / (k * cell**2)
        return shift <= 0.7 + 1e-12 and shift**2 + variance <= 1.0

    assert fits(n)
    assert n == 1 or not fits(n - 1)


def test_arrivals_are_the_sum_over_all_paths(plume):
    n_y = plume.grid.shape[1]
    for sensor in ((0, 0), (2, 1)):
        expected = np.zeros((plume.n_hops + 1, plume.grid.n_cells))
        tables = [matrix(plume, m) for m in range(plume.n_hops)]
        expected[-1, sensor[0] * n_y + sensor[1]] = 1.0
        for m in range(plume.n_hops):
            for path in itertools.product(range(plume.grid.n_cells), repeat=plume.n_hops - m + 1):
                if path[-1] == sensor[0] * n_y + sensor[1]:
                    chances = (tables[m + k][path[k], path[k + 1]] for k in range(plume.n_hops - m))
                    expected[m, path[0]] += math.prod(chances)
        assert compute_arrival_probabilities(plume, sensor).reshape(expected.shape) == pytest.approx(
            expected, abs=1e-12
        )


def test_the_likeliest_path_is_the_best_of_all(plume):
    n_y = plume.grid.shape[1]
    source = normalised(np.random.default_rng(9).uniform(size=plume.grid.shape) * ~plume.is_solid)
    for sensor in ((0, 0), (2, 1), (0, 1)):
        tables = [matrix(plume, m) for m in range(plume.n_hops)]
        best, best_cells = -1.0, ()
        for m in range(plume.n_hops):
            for path in itertools.product(range(plume.grid.n_cells), repeat=plume.n_hops - m + 1):
                if path[-1] != sensor[0] * n_y + sensor[1]:
                    continue
                chance = math.prod(tables[m + k][path[k], path[k + 1]] for k in range(plume.n_hops - m))
                if source.reshape(-1)[path[0]] * chance > best:
                    best, best_cells = source.reshape(-1)[path[0]] * chance, path
        found = likeliest_path(plume, sensor, source)
        assert found.log_likelihood == pytest.approx(math.log(best))
        assert found.cells == tuple((cell // n_y, cell % n_y) for cell in best_cells)


def test_shares_are_the_mean_and_the_product_over_release_times(plume):
    chance = compute_arrival_probabilities(plume, (2, 1))
    mean_share, log_share = compute_finding_likelihoods(chance, detection_probability=0.8, puffs_per_hop=0.5)
    assert mean_share == pytest.approx(chance.sum(axis=0) / len(chance))
    assert np.exp(log_share) == pytest.approx(np.sqrt(np.prod(1.0 - 0.8 * chance, axis=0)))


def test_where_no_path_leads_there_is_none():
    grid, wall = CellGrid((0.0, 0.0), 1.0, (5, 3)), np.zeros((5, 3), bool)
    wall[2] = True
    plume = build_chain_in_uniform_wind(grid, wall, np.zeros((4, 2)), step_s=1.0, spread_m_sqrt_s=0.5)
    source = np.zeros(grid.shape)
    source[0, 1] = 1.0
    assert likeliest_path(plume, (4, 1), source) is None
    nowhere = build_chain_in_uniform_wind(grid, wall, np.zeros((0, 2)), step_s=1.0, spread_m_sqrt_s=0.5)
    assert likeliest_path(nowhere, (4, 1), source) is None
    assert compute_arrival_probabilities(nowhere, (4, 1)).sum() == 1.0


def test_hop_chances_are_those_of_the_axes():
    chances = hop_chances(np.array([[[0.3, -0.2]]]), 0.5, 0.4, 0.3)
    assert chances[0, 0, 0] == pytest.approx(axis_chances(0.375, 0.28125))
    assert chances[0, 0, 1] == pytest.approx(axis_chances(-0.25, 0.28125))


def test_a_place_along_a_path_is_as_far_back_as_asked_or_its_start():
    path = PlumePath(cells=((0, 0), (1, 0), (1, 0), (2, 1)), log_likelihood=0.0)
    grid = CellGrid((0.0, 0.0), 2.0, (3, 2))
    assert place_along_m(path, grid, 1.0) == (3.0, 1.0)
    assert place_along_m(path, grid, 3.0) == (1.0, 1.0)
    assert place_along_m(path, grid, 30.0) == (1.0, 1.0)
    assert place_along_m(path, grid, 0.0) == (5.0, 3.0)
