"""Line of sight: exact cell traversal, in a box with three different side lengths."""

import numpy as np

from gslcosim.environment.grid_kernels import is_line_of_sight_free

SHAPE = (11, 7, 5)
CELL_M = 0.3
ORIGIN_M = (-0.4, 2.0, 0.7)
SIZE_M = np.array(SHAPE) * CELL_M


def sees(occupancy, a, b):
    return is_line_of_sight_free(occupancy, ORIGIN_M, CELL_M, *map(float, a), *map(float, b))


def at(*cells):
    """The world point at a position given in cells."""
    return tuple(o + c * CELL_M for o, c in zip(ORIGIN_M, cells, strict=True))


def solid_at(*cells):
    occupancy = np.zeros(SHAPE, dtype=np.uint8)
    for cell in cells:
        occupancy[cell] = 1
    return occupancy


def blocked_by_brute_force(occupancy, a, b):
    """Clip the segment against every solid cell; None where it only grazes one."""
    start, direction = np.asarray(a), np.asarray(b) - np.asarray(a)
    lows = np.argwhere(occupancy == 1) * CELL_M + ORIGIN_M
    with np.errstate(divide="ignore"):
        t0, t1 = (lows - start) / direction, (lows + CELL_M - start) / direction
    enter, leave = np.minimum(t0, t1).max(axis=1), np.maximum(t0, t1).min(axis=1)
    shared = np.minimum(leave, 1.0) - np.maximum(enter, 0.0)
    if (shared > 1e-9).any():
        return True
    return None if (shared > -1e-9).any() else False


def test_sight_agrees_with_clipping_against_every_solid_cell():
    rng = np.random.default_rng(11)
    n_blocked = n_free = 0
    for _ in range(60):
        occupancy = (rng.random(SHAPE) < 0.04).astype(np.uint8)
        for _ in range(10):
            a, b = (ORIGIN_M + rng.random(3) * SIZE_M for _ in range(2))
            is_blocked = blocked_by_brute_force(occupancy, a, b)
            if is_blocked is None:
                continue
            assert sees(occupancy, a, b) == (not is_blocked)
            n_blocked, n_free = n_blocked + is_blocked, n_free + (not is_blocked)
    assert min(n_blocked, n_free) > 100


def test_sight_is_the_same_in_both_directions():
    rng = np.random.default_rng(5)
    occupancy = (rng.random(SHAPE) < 0.1).astype(np.uint8)
    for _ in range(300):
        # On a lattice of half cells, where the line often hits edges exactly.
        a, b = (at(*(rng.integers(0, 2 * np.array(SHAPE)) / 2)) for _ in range(2))
        assert sees(occupancy, a, b) == sees(occupancy, b, a)


def test_no_line_slips_between_two_cells_that_share_an_edge():
    occupancy = solid_at((3, 4, 2), (4, 3, 2))
    assert not sees(occupancy, at(3.5, 3.5, 2.5), at(4.5, 4.5, 2.5))
    assert not sees(occupancy, at(4.5, 4.5, 2.5), at(3.5, 3.5, 2.5))
    assert not sees(solid_at((3, 3, 2), (4, 4, 2)), at(3.5, 4.5, 2.5), at(4.5, 3.5, 2.5))


def test_a_point_inside_a_solid_cell_sees_nothing_not_even_itself():
    occupancy = solid_at((5, 3, 2))
    inside, outside = at(5.5, 3.5, 2.5), at(1.5, 3.5, 2.5)
    assert not sees(occupancy, inside, outside)
    assert not sees(occupancy, outside, inside)
    assert not sees(occupancy, inside, inside)
    assert sees(occupancy, outside, outside)


def test_outlet_cells_do_not_hide():
    occupancy = solid_at((5, 3, 2))
    occupancy[5, 3, 2] = 2
    assert sees(occupancy, at(1.5, 3.5, 2.5), at(9.5, 3.5, 2.5))


def test_only_the_part_inside_the_grid_is_judged():
    occupancy = solid_at((5, 3, 2))
    assert not sees(occupancy, at(-4.0, 3.5, 2.5), at(20.0, 3.5, 2.5))
    assert sees(occupancy, at(-4.0, 2.5, 2.5), at(20.0, 2.5, 2.5))
    assert sees(occupancy, at(-4.0, 9.0, 2.5), at(20.0, 9.0, 2.5))
    # The upper faces of the room belong to no cell; a point on them still sees into the room.
    assert sees(occupancy, at(*SHAPE), at(10.5, 0.5, 0.5))


def test_a_line_along_one_axis_visits_every_cell_of_it():
    for i in range(SHAPE[0]):
        assert not sees(solid_at((i, 3, 2)), at(0.0, 3.5, 2.5), at(SHAPE[0] - 1e-9, 3.5, 2.5))
