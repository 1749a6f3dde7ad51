import math

import numpy as np
import pytest

from gslcosim_search.beliefs import CellGrid, mass_within
from gslcosim_search.maps.pmfs import BackwardPlume, PlumeModel, Pmfs, PmfsSettings, add_log_score_inplace, disagreement
from gslcosim_search.random_stream import RandomStream

CALM = (0.0, 0.0)
CELL_M = 0.25


def method(free: np.ndarray, **settings) -> Pmfs:
    return Pmfs(free, CellGrid((0.0, 0.0), 0.25, free.shape), PmfsSettings(**settings))


def open_room() -> np.ndarray:
    return np.ones((31, 31), bool)


def room_with_wall() -> np.ndarray:
    """A wall at x = 13 up to y = 17: it ends near where hits are made in front of it."""
    free = open_room()
    free[13, :18] = False
    return free


def centre(cell) -> tuple[float, ...]:
    return tuple(0.25 * (i + 0.5) for i in cell)


def even_wind(free: np.ndarray, x_m_s: float, y_m_s: float = 0.0) -> np.ndarray:
    return np.where(free[..., None], np.array([x_m_s, y_m_s]), 0.0)


def log_odds(p):
    return np.log(p / (1.0 - p))


def test_a_hit_raises_the_cell_to_its_target_and_a_miss_lowers_it():
    pmfs = method(open_room(), prior=0.3, hit_target=0.6, miss_target=0.1)
    pmfs.update(centre((15, 15)), [True], CALM)
    assert pmfs.hit_probability[15, 15] == pytest.approx(0.6)
    assert pmfs.hit_probability[0, 0] == pytest.approx(0.3)
    pmfs.update(centre((15, 15)), [False], CALM)
    expected = log_odds(0.6) + log_odds(0.1) - log_odds(0.3)
    assert log_odds(pmfs.hit_probability[15, 15]) == pytest.approx(expected)


def test_a_hit_reaches_farther_along_the_wind_than_across():
    pmfs = method(open_room(), kernel_cells=1.5, stretch_s_m=3.0, prior=0.3, hit_target=0.6)
    pmfs.update(centre((15, 15)), [True], (0.5, 0.0))
    along, across = 1.5 + 3.0 * 0.5, 1.5 / (1.0 + 3.0 * 0.5 / 1.5)
    for cell, squared in (((19, 15), (4 / along) ** 2), ((15, 16), (1 / across) ** 2), ((11, 15), (4 / along) ** 2)):
        weight = math.exp(-0.5 * squared)
        assert pmfs.hit_probability[cell] == pytest.approx(0.3 + 0.3 * weight, rel=1e-6)


def test_behind_a_wall_the_hit_map_is_as_it_was_except_around_its_end():
    """A hit just in front of the wall, three cells from its end."""
    pmfs = method(room_with_wall(), kernel_cells=2.5)
    before = pmfs.hit_probability
    pmfs.update(centre((14, 15)), [True] * 4, CALM)
    change = np.abs(pmfs.hit_probability - before)
    assert change[:13, :9].max() < 1e-3
    assert change[12, 18] > 0.1  # around the end
    without_wall = method(open_room(), kernel_cells=2.5)
    without_wall.update(centre((14, 15)), [True] * 4, CALM)
    assert np.abs(without_wall.hit_probability - before)[12, 9:15].min() > 0.02


def test_trust_grows_with_measurements_and_ends_at_walls():
    pmfs = method(room_with_wall(), trust_reach_cells=1.0, trust_scale=1.0)
    pmfs.update(centre((14, 5)), [True, False], CALM)
    omega = 2.0 / math.sqrt(2.0 * math.pi)
    assert pmfs.confidence[14, 5] == pytest.approx(1.0 - math.exp(-omega))
    assert pmfs.confidence[16, 5] == pytest.approx(1.0 - math.exp(-omega * math.exp(-2.0)))
    assert pmfs.confidence[12, 5] == 0.0
    assert (pmfs.confidence[~room_with_wall()] == 0.0).all()


def test_the_score_is_the_product_of_its_definition():
    draws = np.random.default_rng(1)
    shares, measured, confidence = draws.random((37, 5)), draws.random(37), draws.random(37)
    log_score = np.zeros(5)
    add_log_score_inplace(log_score, shares, measured, confidence, 0.01)
    factors = 1.0 - confidence[:, None] * np.abs(measured[:, None] - shares)
    assert np.exp(log_score) == pytest.approx(np.maximum(factors, 0.01).prod(axis=0), rel=1e-9)


def test_disagreement_is_the_variance_under_the_belief():
    draws = np.random.default_rng(2)
    shares, p = draws.random((4, 9)), draws.random(9)
    p /= p.sum()
    sample = [np.cov(row, aweights=p, bias=True) for row in shares]
    assert disagreement(shares, p) == pytest.approx(np.array(sample), rel=1e-9)


def test_gas_downwind_and_clean_air_beside_put_the_source_between():
    """Wind to the east; gas on a line at y = 15, none upwind of x = 10 and none to the sides."""
    free = open_room()
    pmfs = method(free, puffs_per_s=5.0, diffusivity_m2_s=0.01, lifetime_s=60.0)
    wind_m_s = even_wind(free, 0.4)
    for i in (14, 18, 22, 26):
        pmfs.update(centre((i, 15)), [True] * 4, (0.4, 0.0))
    for cell in ((4, 15), (7, 15), (14, 22), (14, 8), (22, 24), (22, 6), (8, 20), (8, 10)):
        pmfs.update(centre(cell), [False] * 4, (0.4, 0.0))
    pmfs.score(wind_m_s)
    assert pmfs.p.sum() == pytest.approx(1.0)
    assert mass_within(pmfs.p, pmfs.grid, centre((11, 15)), 1.0) > 0.9


def test_the_goal_is_where_believed_sources_disagree():
    """Two lanes of wind; the source is in one of them, and only a place downwind of both starts tells which."""
    free = open_room()
    pmfs = method(free, reach_cells=60.0, explore_first=0, explore_frac=0.0, candidates=2000)
    pmfs.visit(centre((15, 15)))
    pmfs.p = np.zeros(free.shape)
    pmfs.p[4, 6] = pmfs.p[4, 24] = 0.5
    belief = pmfs.p
    pmfs.score(even_wind(free, 0.5))
    pmfs.p = belief
    goal = pmfs.next_goal(centre((15, 15)), RandomStream(1))
    assert goal is not None
    assert goal[1] in (*range(4, 9), *range(22, 27))


def test_goals_that_were_given_up_or_cannot_be_flown_to_are_left_out():
    flyable = np.zeros((31, 31), bool)
    flyable[14:17, 15] = True
    pmfs = Pmfs(open_room(), CellGrid((0.0, 0.0), 0.25, (31, 31)), flyable=flyable)
    pmfs.visit(centre((15, 15)))
    assert pmfs.next_goal(centre((15, 15)), RandomStream(1)) in ((14, 15), (16, 15))
    pmfs.give_up(centre((14, 15)))
    assert pmfs.next_goal(centre((15, 15)), RandomStream(1)) == (16, 15)
    pmfs.give_up(centre((16, 15)))
    assert pmfs.next_goal(centre((15, 15)), RandomStream(1)) is None


def test_a_tempered_score_is_the_power_of_the_score():
    free = open_room()
    beliefs = []
    for temper in (1.0, 0.5):
        pmfs = method(free, temper=temper)
        pmfs.update(centre((16, 15)), [True] * 4, (0.3, 0.0))
        pmfs.score(even_wind(free, 0.3))
        beliefs.append(pmfs.p)
    root = np.sqrt(beliefs[0])
    assert beliefs[1] == pytest.approx(root / root.sum(), rel=1e-6)


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
