import math

import numpy as np
import pytest

from gslcosim.environment.model import Cell, Grid
from gslcosim.environment.paths.scoring_paths import Layer, shortest_path_m
from gslcosim_training.free_distances import compute_free_distances_m

CELL_M = 0.25
# Bends lie at the centres of cells, where those of the referee lie at their corners.
BENDS_M = 4 * CELL_M


def layer(*walls, shape=(40, 32, 1)):
    """Return a layer of free cells, but for walls: (low cell, high cell) in the plane, high exclusive."""
    occupancy = np.zeros(shape, np.uint8)
    for (i, j), (i_end, j_end) in walls:
        occupancy[i:i_end, j:j_end] = Cell.SOLID
    return Layer(grid=Grid(origin_m=(1.0, 2.0, -CELL_M / 2), cell_m=CELL_M, shape=shape), occupancy=occupancy)


def centre_m(room, i, j):
    x_m, y_m, _ = room.grid.origin_m
    return (x_m + (i + 0.5) * CELL_M, y_m + (j + 0.5) * CELL_M, 0.0)


def test_behind_a_wall_the_way_around_it_counts():
    """A wall of 7 m with a gap at one end: straight through it the place is 1 m away."""
    room = layer(((20, 0), (21, 28)))
    near, far = (18, 2), (22, 2)
    found_m = compute_free_distances_m(room, centre_m(room, *far))
    around_m = shortest_path_m(room, centre_m(room, *near), centre_m(room, *far), clearance_m=0.0)
    assert math.dist(centre_m(room, *near), centre_m(room, *far)) == pytest.approx(1.0)
    assert around_m <= found_m[(*near, 0)] + 1e-5
    assert found_m[(*near, 0)] < around_m + BENDS_M
    assert 12.0 < around_m < 14.0


def test_lengths_agree_with_the_paths_of_the_referee():
    room = layer(((10, 4), (12, 30)), ((20, 0), (22, 20)), ((26, 10), (34, 12)))
    place_m = centre_m(room, 36, 3)
    found_m = compute_free_distances_m(room, place_m)
    rng = np.random.default_rng(1)
    for i, j in rng.integers((0, 0), (40, 32), (40, 2)).tolist():
        expected_m = shortest_path_m(room, centre_m(room, i, j), place_m, clearance_m=0.0)
        if expected_m is not None:
            assert expected_m - 1e-4 <= found_m[i, j, 0] < expected_m + BENDS_M


def test_what_no_path_reaches_lies_behind_what_one_does():
    room = layer(((30, 0), (31, 32)))
    found_m = compute_free_distances_m(room, centre_m(room, 5, 5))
    assert np.isfinite(found_m).all()
    np.testing.assert_allclose(found_m[30, 5, 0], found_m[29, 5, 0] + CELL_M, rtol=1e-6)
    assert found_m[35, 5, 0] > found_m[31, 5, 0]


def test_a_place_in_a_solid_cell_is_reached_from_beside_it():
    room = layer(((20, 10), (23, 13)))
    found_m = compute_free_distances_m(room, centre_m(room, 21, 11))
    assert found_m[24, 11, 0] < found_m[30, 11, 0]
    assert np.isfinite(found_m).all()


def test_where_nothing_is_free_there_are_no_lengths():
    assert compute_free_distances_m(layer(((0, 0), (40, 32))), (2.0, 3.0, 0.0)) is None
