"""Paths over free cells: lengths of a reference library, distance from solids, and no way through."""

import itertools
import math

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from gslcosim.base.cell_kernels import label_parts
from gslcosim.environment.model import Grid
from gslcosim.environment.paths.planner import FreeSpace, free_space, is_curve_free, lattice_path

STEPS = [step for step in itertools.product((-1, 0, 1), repeat=3) if any(step)]


def space_of(blocked, cell_m=1.0):
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=cell_m, shape=blocked.shape)
    return FreeSpace(grid=grid, blocked=blocked, solid=blocked, parts=label_parts(blocked, 1))


# All steps between free cells that span a block of free cells, without a look at the code under test.
def graph_of(blocked):
    index = np.arange(blocked.size).reshape(blocked.shape)
    is_free = np.pad(blocked == 0, 1)
    rows, columns, lengths = [], [], []
    for step in STEPS:
        block = itertools.product(*((0, s) if s else (0,) for s in step))
        windows = [
            is_free[tuple(slice(1 + o, 1 + o + n) for o, n in zip(offset, blocked.shape, strict=True))]
            for offset in block
        ]
        may_go = np.logical_and.reduce(windows)
        here = index[may_go]
        rows.append(here)
        columns.append(here + step[0] * blocked.shape[1] * blocked.shape[2] + step[1] * blocked.shape[2] + step[2])
        lengths.append(np.full(len(here), math.sqrt(sum(map(abs, step)))))
    entries = np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))
    return coo_array(entries, shape=(blocked.size, blocked.size)).tocsr()


def length_of(cells):
    return float(np.linalg.norm(np.diff(cells, axis=0), axis=1).sum())


@pytest.mark.slow
@pytest.mark.parametrize("is_flat", [True, False], ids=["2d", "3d"])
def test_lengths_are_those_of_a_reference_library_on_a_thousand_random_grids(is_flat):
    rng = np.random.default_rng(7)
    n_without = 0
    for _ in range(500):
        shape = (*rng.integers(4, 14, 2), 1) if is_flat else tuple(rng.integers(3, 9, 3))
        blocked = (rng.random(shape) < rng.uniform(0.05, 0.4 if is_flat else 0.7)).astype(np.uint8)
        start, goal = (tuple(rng.integers(0, shape)) for _ in range(2))
        blocked[start] = blocked[goal] = 0
        ends = [int(np.ravel_multi_index(cell, shape)) for cell in (start, goal)]
        expected = dijkstra(graph_of(blocked), indices=ends[0])[ends[1]]
        cells = lattice_path(blocked, np.array(start), np.array(goal))
        parts = label_parts(blocked, 1)
        assert (parts[start] == parts[goal]) == math.isfinite(expected)
        if math.isinf(expected):
            n_without += 1
            assert len(cells) == 0
            continue
        assert (tuple(cells[0]), tuple(cells[-1])) == (start, goal)
        assert not blocked[tuple(cells.T)].any()
        assert length_of(cells) == pytest.approx(expected, abs=1e-9)
    assert 20 < n_without < 400


def test_no_corner_is_cut():
    blocked = np.zeros((2, 2, 1), np.uint8)
    blocked[0, 1, 0] = 1
    assert length_of(lattice_path(blocked, np.array((0, 0, 0)), np.array((1, 1, 0)))) == 2.0


def test_bends_are_left_out_where_the_path_passes_them_by():
    blocked = np.zeros((20, 11, 1), np.uint8)
    blocked[9, :9] = 1
    path_m = space_of(blocked).path((1.5, 1.5, 0.5), (18.5, 2.5, 0.5))
    assert 3 <= len(path_m) <= 5
    lattice = lattice_path(blocked, np.array((1, 1, 0)), np.array((18, 2, 0)))
    assert length_of(path_m) < length_of(lattice)
    shortest = math.hypot(7.5, 7.5) + 1.0 + math.hypot(8.5, 6.5)
    assert shortest <= length_of(path_m) < 1.05 * shortest
    for a, b in itertools.pairwise(path_m):
        assert space_of(blocked).sees(tuple(a), tuple(b))


def test_free_cells_keep_their_distance_from_every_box(make_room):
    crate = ((5.1, 5.0, 0.0), (6.05, 6.6, 1.13))
    environment = make_room(obstacles=[("crate", *crate)])
    space = free_space(environment, radius_m=0.38, margin_m=0.05)
    low_m, high_m = np.array(crate)
    corners = np.array(list(itertools.product((0, 1), repeat=3)))
    for cell in np.ndindex(*environment.grid.shape):
        cell_low_m = np.array(cell) * 0.25
        gap_m = np.maximum.reduce([low_m - cell_low_m - 0.25, cell_low_m - high_m, np.zeros(3)])
        points_m = cell_low_m + 0.25 * corners
        to_sides_m = min(points_m[:, :2].min(), (np.array([15.0, 10.0]) - points_m[:, :2]).min())
        to_ends_m = min(cell_low_m[2] + 0.125, 6.0 - cell_low_m[2] - 0.125)
        is_far = np.linalg.norm(gap_m) >= 0.43 - 1e-6 and to_sides_m >= 0.43 - 1e-6 and to_ends_m >= 0.38 - 1e-6
        assert (space.blocked[cell] == 0) == is_far, cell


def test_what_a_vehicle_drives_on_is_not_in_its_way(make_room):
    environment = make_room(obstacles=[("plate", (4.0, 0.0, 0.0), (11.0, 10.0, 0.5))])
    space = free_space(environment, radius_m=0.27, margin_m=0.05, ground_m=0.5)
    assert space.is_free((7.0, 5.0, 0.62))
    assert not free_space(environment, radius_m=0.27, margin_m=0.05, ground_m=0.0).is_free((7.0, 5.0, 0.62))


def test_the_nearest_free_place_is_just_outside():
    blocked = np.zeros((9, 9, 9), np.uint8)
    blocked[3:6, 3:6, 2:6] = 1
    assert space_of(blocked).nearest_m((5.9, 4.5, 4.0)) == (6.5, 4.5, 3.5)
    blocked[:] = 1
    assert space_of(blocked).nearest_m((5.9, 4.5, 4.0)) is None


def test_the_nearest_free_place_in_sight_is_on_this_side_of_a_plate():
    blocked = np.zeros((9, 5, 5), np.uint8)
    blocked[2:6] = 1
    solid = np.zeros_like(blocked)
    solid[4] = 1
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=1.0, shape=blocked.shape)
    space = FreeSpace(grid=grid, blocked=blocked, solid=solid, parts=label_parts(blocked, 1))
    assert space.nearest_m((3.9, 2.5, 2.5)) == (1.5, 2.5, 2.5)
    assert space.nearest_m((5.2, 2.5, 2.5)) == (6.5, 2.5, 2.5)
    assert space.nearest_m((3.9, 2.5, 2.5), part=int(space.parts[7, 0, 0])) == (6.5, 2.5, 2.5)
    solid[2] = 1
    assert space.nearest_m((3.9, 2.5, 2.5), in_sight=True) is None
    assert space.nearest_m((5.2, 2.5, 2.5), in_sight=True) == (6.5, 2.5, 2.5)


def test_a_wall_from_side_to_side_leaves_no_path():
    blocked = np.zeros((9, 5, 1), np.uint8)
    blocked[4] = 1
    space = space_of(blocked)
    assert space.path((1.5, 1.5, 0.5), (7.5, 1.5, 0.5)) is None
    assert space.part_of((1.5, 1.5, 0.5)) != space.part_of((7.5, 1.5, 0.5)) > 0
    assert space.part_of((-1.5, 1.5, 0.5)) == 0


def test_a_slab_is_free_where_all_its_layers_are():
    blocked = np.zeros((4, 4, 4), np.uint8)
    blocked[1, 2, 1] = blocked[3, 0, 3] = 1
    space = space_of(blocked)
    assert np.argwhere(space.slab(0.5, 1.5).blocked).tolist() == [[1, 2, 0]]
    assert np.argwhere(space.slab(0.5, 3.5).blocked).tolist() == [[1, 2, 0], [3, 0, 0]]
    assert space.slab(2.5, 2.5).is_free((1.5, 2.5, 0.0))


def test_a_curve_is_free_only_in_free_cells():
    blocked = np.zeros((9, 9, 1), np.uint8)
    blocked[4, 2] = 1
    # x runs from 0.5 to 8.5 m; y = 2.5 m + b x (8 m - x) / 8 m.
    for bulge, is_free in ((0.0, False), (1.0, True), (4.0, False)):
        curve = np.zeros((3, 6))
        curve[0, :2], curve[1, :3], curve[2, 0] = (0.5, 8.0), (2.5, 8.0 * bulge, -8.0 * bulge), 0.5
        assert is_curve_free(curve, 1.0, blocked, np.zeros(3), 1.0, 64) is is_free
