"""Earth mover's distances against closed forms, linear programs and the laws of a metric."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from gslcosim.base.errors import ShapeError
from gslcosim_bench.metrics.gas import (
    MAX_CELLS,
    _sum_blocks,
    earth_movers_distance_m,
    log_ratio_of_mass,
    solve_transport,
)
from gslcosim_services.referee.metrics import expected_distance_m


def by_linear_program(supply, demand, cost):
    n, m = cost.shape
    sums = np.concatenate([np.kron(np.eye(n), np.ones(m)), np.kron(np.ones(n), np.eye(m))])
    return linprog(cost.ravel(), A_eq=sums, b_eq=np.concatenate([supply, demand]), method="highs").fun


def gaussian(shape, centre, sigma):
    x, y = np.indices(shape)
    return np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (2 * sigma**2))


@pytest.mark.parametrize("seed", range(20))
def test_the_transport_costs_what_the_linear_program_says(seed):
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 15, 2)
    supply, demand, cost = rng.exponential(size=n), rng.exponential(size=m), rng.random((n, m))
    supply, demand = supply / supply.sum(), demand / demand.sum()
    assert solve_transport(supply, demand, cost) == pytest.approx(by_linear_program(supply, demand, cost), abs=1e-10)


def test_a_transport_with_ties_and_zeros_costs_what_the_linear_program_says():
    rng = np.random.default_rng(21)
    for _ in range(20):
        supply, demand = rng.integers(0, 4, 8) + 0.0, rng.integers(0, 4, 8) + 0.0
        supply[0] += max(0.0, demand.sum() - supply.sum())
        demand[0] += max(0.0, supply.sum() - demand.sum())
        cost = rng.integers(0, 3, (8, 8)) + 0.0
        assert solve_transport(supply, demand, cost) == pytest.approx(by_linear_program(supply, demand, cost))


def test_a_textbook_transport():
    """Three plants, four towns; the least cost is 1020 (Winston, Operations Research, the Powerco example)."""
    cost = np.array([[8.0, 6.0, 10.0, 9.0], [9.0, 12.0, 13.0, 7.0], [14.0, 9.0, 16.0, 5.0]])
    assert solve_transport(np.array([35.0, 50.0, 40.0]), np.array([45.0, 20.0, 30.0, 30.0]), cost) == 1020.0


def test_to_a_point_mass_it_is_the_expected_distance_of_the_referee():
    p = np.random.default_rng(1).random((12, 9))
    p /= p.sum()
    point = np.zeros_like(p)
    point[4, 7] = 1.0
    x, y = np.indices(p.shape)
    away_m = 0.5 * np.hypot(x - 4, y - 7)
    assert earth_movers_distance_m(p, point, 0.5) == pytest.approx(expected_distance_m(p, away_m))


def test_along_a_line_it_is_the_area_between_the_cumulative_sums():
    rng = np.random.default_rng(2)
    a, b = rng.random((2, 20, 1))
    known_m = 0.4 * np.abs(np.cumsum(a / a.sum() - b / b.sum())).sum()
    assert earth_movers_distance_m(a, b, 0.4) == pytest.approx(known_m)


def test_a_map_that_is_shifted_is_as_far_as_the_shift():
    a = np.zeros((20, 20))
    a[3:8, 2:9] = np.random.default_rng(3).random((5, 7))
    b = np.roll(a, (6, 8), axis=(0, 1))
    assert earth_movers_distance_m(a, b, 0.5) == pytest.approx(5.0)


def test_it_is_a_metric_of_shapes():
    rng = np.random.default_rng(4)
    for _ in range(5):
        a, b, c = rng.random((3, 6, 5)) ** 4
        ab, bc, ac = (earth_movers_distance_m(*pair, 1.0) for pair in ((a, b), (b, c), (a, c)))
        assert ab > 0.0
        assert earth_movers_distance_m(b, a, 1.0) == pytest.approx(ab)
        assert ac <= ab + bc + 1e-12
        assert earth_movers_distance_m(a, 7.0 * a, 1.0) == pytest.approx(0.0, abs=1e-12)


def test_it_does_not_depend_on_how_the_map_lies_and_grows_with_the_cell():
    a, b = np.random.default_rng(5).random((2, 7, 4))
    known_m = earth_movers_distance_m(a, b, 1.0)
    assert earth_movers_distance_m(a.T, b.T, 1.0) == pytest.approx(known_m)
    assert earth_movers_distance_m(a[::-1], b[::-1], 1.0) == pytest.approx(known_m)
    assert earth_movers_distance_m(a, b, 0.2) == pytest.approx(0.2 * known_m)


def test_a_large_map_is_off_by_less_than_the_stated_bound():
    a, b = gaussian((77, 77), (20, 30), 6.0), gaussian((77, 77), (47, 66), 6.0)
    n_block = math.ceil(77 / MAX_CELLS)
    bound_m = 0.2 * math.sqrt(2) * (n_block - 1)
    assert earth_movers_distance_m(a, b, 0.2) == pytest.approx(0.2 * 45.0, abs=bound_m)


def test_sums_over_blocks_keep_the_mass():
    values = np.random.default_rng(6).random((7, 5))
    blocks = _sum_blocks(values, 3)
    assert blocks.shape == (3, 2)
    assert blocks.sum() == pytest.approx(values.sum())
    assert blocks[0, 1] == pytest.approx(values[:3, 3:].sum())


def test_the_amount_is_judged_apart():
    a = np.random.default_rng(7).random((4, 4))
    assert log_ratio_of_mass(a, a) == 0.0
    assert log_ratio_of_mass(a / 10, a) == pytest.approx(-math.log(10))


def test_empty_maps_have_no_figures():
    a, empty = np.ones((3, 3)), np.zeros((3, 3))
    assert earth_movers_distance_m(a, empty, 1.0) is None
    assert earth_movers_distance_m(empty, a, 1.0) is None
    assert log_ratio_of_mass(empty, a) is None


@pytest.mark.parametrize("wrong", [np.ones((3, 4)), np.ones(3), np.full((3, 3), -1.0), np.full((3, 3), np.nan)])
def test_maps_that_cannot_be_compared_are_refused(wrong):
    with pytest.raises(ShapeError, match="gas maps"):
        earth_movers_distance_m(np.ones((3, 3)), wrong, 1.0)
