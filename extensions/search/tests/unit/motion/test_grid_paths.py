import math

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.motion.grid_paths import (
    inflate_obstacles,
    is_visible,
    nearest_free,
    path_field,
    path_field_from,
    path_length_m,
    point_along,
    reachable_cells,
    shortest_path,
    visible_cells,
)


def grid_of(free: np.ndarray, cell_m: float = 0.5) -> CellGrid:
    return CellGrid(origin_m=(0.0,) * free.ndim, cell_m=cell_m, shape=free.shape)


def random_cells(shape: tuple[int, ...], seed: int) -> np.ndarray:
    free = np.random.default_rng(seed).random(shape) > 0.3
    free[(0,) * len(shape)] = True
    return free


def room_with_wall() -> np.ndarray:
    """A room of 20 x 20 cells with a wall across it at x = 10, open above y = 15."""
    free = np.ones((20, 20), bool)
    free[10, :15] = False
    return free


def lengths_by_scipy(free: np.ndarray) -> np.ndarray:
    """Shortest paths from the first cell, by the definition of a step and a library's algorithm."""
    rows, columns, lengths = [], [], []
    for cell in np.argwhere(free):
        for step in np.ndindex(*(3,) * free.ndim):
            move = np.array(step) - 1
            other = cell + move
            if not move.any() or (other < 0).any() or (other >= free.shape).any():
                continue
            block = tuple(slice(min(a, b), max(a, b) + 1) for a, b in zip(cell, other))
            if free[block].all():
                rows.append(np.ravel_multi_index(tuple(cell), free.shape))
                columns.append(np.ravel_multi_index(tuple(other), free.shape))
                lengths.append(math.sqrt((move**2).sum()))
    graph = coo_matrix((lengths, (rows, columns)), shape=(free.size, free.size))
    return dijkstra(graph.tocsr(), indices=0).reshape(free.shape)


@pytest.mark.parametrize(("shape", "accuracy"), [((17, 12), 1e-5), ((6, 7, 5), 1e-3)])
@pytest.mark.parametrize("seed", range(4))
def test_paths_are_as_short_as_those_of_a_library(shape, accuracy, seed):
    free = random_cells(shape, seed)
    field = path_field_from(free, 1.0, (0,) * len(shape))
    assert field.length_m == pytest.approx(lengths_by_scipy(free), rel=accuracy)


def test_a_closed_room_is_not_reached():
    free = np.ones((9, 9), bool)
    free[4, :] = False
    is_reached = reachable_cells(free, grid_of(free), (0.2, 0.2))
    assert is_reached[:4].all()
    assert not is_reached[4:].any()


def test_a_way_leads_round_the_end_of_a_wall_and_stays_in_free_cells():
    free = room_with_wall()
    path_m = shortest_path(free, grid_of(free), (2.0, 2.0), (8.0, 2.0))
    assert path_m[0] == pytest.approx((2.0, 2.0))
    assert path_m[-1] == pytest.approx((8.0, 2.0))
    assert path_m[:, 1].max() > 7.5
    around_m = math.hypot(3.0, 5.5) + 0.5 + math.hypot(2.5, 5.5)
    assert around_m <= path_length_m(path_m) <= 1.08 * around_m
    for distance_m in np.arange(0.0, path_length_m(path_m), 0.01):
        assert free[tuple((point_along(path_m, distance_m) / 0.5).astype(int))]


def test_a_point_along_a_way_is_as_far_from_its_start_as_asked():
    path_m = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 4.0)])
    assert point_along(path_m, 0.0) == pytest.approx((0.0, 0.0))
    assert point_along(path_m, 2.0) == pytest.approx((2.0, 0.0))
    assert point_along(path_m, 5.0) == pytest.approx((3.0, 2.0))
    assert point_along(path_m, 99.0) == pytest.approx((3.0, 4.0))


def test_ends_in_obstacles_are_joined_to_the_nearest_free_cells():
    free = room_with_wall()
    path_m = shortest_path(free, grid_of(free), (5.05, 2.25), (5.45, 4.25))
    assert path_m[0] == pytest.approx((5.05, 2.25))
    assert path_m[1] == pytest.approx((4.75, 2.25))
    assert path_m[-1] == pytest.approx((5.75, 4.25))


def test_without_a_free_cell_or_a_way_there_is_no_path():
    blocked = np.zeros((4, 4), bool)
    assert nearest_free(blocked, grid_of(blocked), (1.0, 1.0)) is None
    assert path_field(blocked, grid_of(blocked), (1.0, 1.0)) is None
    assert shortest_path(blocked, grid_of(blocked), (1.0, 1.0), (1.5, 1.5)) is None
    split = np.ones((9, 9), bool)
    split[4, :] = False
    assert shortest_path(split, grid_of(split), (0.2, 0.2), (4.2, 4.2)) is None


def test_nothing_behind_a_wall_is_seen_but_what_lies_past_its_end():
    seen = visible_cells(room_with_wall(), (5, 2))
    assert seen[:10].all()
    assert not seen[10, :15].any()
    assert not seen[11:, :15].any()
    assert visible_cells(room_with_wall(), (5, 17))[:, 17].all()


def test_sight_ends_at_its_reach():
    seen = visible_cells(np.ones((9, 9), bool), (4, 4), 2.0)
    assert seen.sum() == 13  # the cells of a disc of radius 2


@pytest.mark.parametrize("seed", range(5))
def test_sight_agrees_with_points_along_the_line(seed):
    free = random_cells((12, 12), seed)
    draws = np.random.default_rng(seed)
    for a, b in draws.uniform(0.0, 12.0, (50, 2, 2)):
        inside = np.floor(a + (b - a) * np.linspace(0.0, 1.0, 4001)[:, None]).astype(int)
        assert is_visible(free, grid_of(free, 1.0), a, b) == free[inside[:, 0], inside[:, 1]].all()


def test_room_round_obstacles_is_measured_between_the_nearest_points_of_two_cells():
    free = np.ones((11, 11), bool)
    free[5, 5] = False
    kept = inflate_obstacles(free, grid_of(free, 0.5), 1.0)
    gap_m = np.maximum(np.abs(np.arange(11) - 5) - 1, 0) * 0.5
    assert (kept == (np.hypot(gap_m[:, None], gap_m[None, :]) >= 1.0)).all()
    assert (inflate_obstacles(free, grid_of(free, 0.5), 0.0) == free).all()
