import math

import numpy as np
import pytest
from built_messages import build_observation

from gslcosim.contract.messages import Bounds
from gslcosim_search.beliefs import (
    BeliefPublisher,
    CellGrid,
    belief_message,
    best_ball,
    entropy_bits,
    expected_distance_m,
    mass_within,
    mean_m,
    mean_of_best_m,
    normalised,
    normalised_from_log,
    variance_m2,
)

GRID = CellGrid((1.0, 2.0), 0.5, (6, 4))
BOX = CellGrid((0.0, 0.0, 0.0), 1.0, (3, 4, 5))


def point_mass(grid, index):
    p = np.zeros(grid.shape)
    p[index] = 1.0
    return p


def test_each_centre_is_in_its_own_cell():
    for grid in (GRID, BOX):
        cells = [grid.cell_at(centre) for centre in grid.centres_m()]
        assert cells == [tuple(int(i) for i in index) for index in np.ndindex(grid.shape)]
        assert all(grid.centre_m(cell) == pytest.approx(centre) for cell, centre in zip(cells, grid.centres_m()))


def test_points_outside_are_in_no_cell_but_near_one():
    assert GRID.cell_at((0.9, 2.1)) is None
    assert GRID.cell_at((4.0, 2.1, 7.0)) is None
    assert GRID.nearest_cell((0.0, 9.0)) == (0, 3)


def test_a_grid_covers_its_box_and_grows_its_cells_to_stay_below_a_number():
    bounds = Bounds(min_m=(0.0, 0.0, 0.0), max_m=(3.1, 2.0, 1.0))
    assert CellGrid.covering(bounds, 0.5).shape == (7, 4)
    assert CellGrid.covering(bounds, 0.5, 3).shape == (7, 4, 2)
    assert CellGrid.covering(bounds, 0.1, max_cells=20).n_cells <= 20


def test_weights_of_any_size_are_normalised():
    p = normalised_from_log(np.array([[-1e5, -1e5 + math.log(3.0)]]))
    assert p == pytest.approx(np.array([[0.25, 0.75]]))
    assert normalised_from_log(np.full((2, 2), -np.inf)) == pytest.approx(np.full((2, 2), 0.25))
    assert normalised(np.zeros(4)) == pytest.approx(np.full(4, 0.25))


def test_entropy_of_even_beliefs_is_the_logarithm_and_of_a_found_source_0():
    assert entropy_bits(np.full((8, 8), 1 / 64)) == pytest.approx(6.0)
    assert entropy_bits(point_mass(GRID, (1, 1))) == 0.0


def test_moments_of_two_points():
    p = 0.5 * point_mass(GRID, (0, 0)) + 0.5 * point_mass(GRID, (4, 0))
    assert mean_m(p, GRID) == pytest.approx((2.25, 2.25))
    assert variance_m2(p, GRID) == pytest.approx(1.0)
    assert expected_distance_m(p, GRID, (1.25, 2.25, 9.0)) == pytest.approx(1.0)
    assert mass_within(p, GRID, (1.25, 2.25), 0.1) == 0.5


def test_the_best_ball_holds_what_no_other_holds():
    rng = np.random.default_rng(1)
    for grid, radius_m in ((GRID, 0.8), (BOX, 1.5)):
        p = normalised(rng.random(grid.shape))
        centre_m, mass = best_ball(p, grid, radius_m)
        masses = [mass_within(p, grid, centre, radius_m + 1e-9) for centre in grid.centres_m()]
        assert mass == pytest.approx(max(masses))
        assert mass_within(p, grid, centre_m, radius_m + 1e-9) == pytest.approx(mass)


def test_the_mean_of_the_best_cells_ignores_the_rest():
    p = normalised(point_mass(GRID, (5, 3)) + 0.5 * point_mass(GRID, (5, 2)) + 0.01)
    assert mean_of_best_m(p, GRID, share=1 / 24) == pytest.approx(GRID.centre_m((5, 3)))


def test_a_message_carries_the_belief_and_the_height():
    message = belief_message(point_mass(GRID, (2, 3)), GRID, height_m=1.5)
    assert (message.origin_m, message.cell_m, message.probability.shape) == ((1.0, 2.0, 1.5), 0.5, (6, 4))
    assert belief_message(point_mass(BOX, (0, 0, 0)), BOX).origin_m == (0.0, 0.0, 0.0)


def test_a_belief_is_published_at_most_once_a_second():
    publisher, p = BeliefPublisher(), point_mass(GRID, (0, 0))

    def at(tick):
        return build_observation(tick, agent="a", status="")

    sent = [publisher.message(at(tick), p, GRID) is not None for tick in (0, 1, 9, 10, 15, 21)]
    assert sent == [True, False, False, True, False, True]
