import itertools

import numba
import numpy as np
import pytest
from scipy import ndimage

from gslcosim.base.cell_kernels import is_step_free, keep_bends, label_parts

SHAPE = (6, 5, 4)


@pytest.mark.parametrize(("cells", "blocked"), [(np.uint8, 1), (np.bool_, False)])
def test_a_step_is_free_where_the_whole_block_it_spans_is(cells, blocked):
    values = np.random.default_rng(1).integers(0, 2, SHAPE).astype(cells)
    for cell, step in itertools.product(np.ndindex(SHAPE), itertools.product((-1, 0, 1), repeat=3)):
        other = np.add(cell, step)
        block = tuple(slice(min(a, b), max(a, b) + 1) for a, b in zip(cell, other, strict=True))
        is_inside = (other >= 0).all() and (other < SHAPE).all()
        assert is_step_free(values, blocked, *cell, *step) == (is_inside and (values[block] != blocked).all())


@pytest.mark.parametrize("seed", range(5))
def test_parts_are_those_of_a_library_in_the_order_of_their_first_cells(seed):
    free = np.random.default_rng(seed).random((9, 8, 7)) > 0.6
    expected, _ = ndimage.label(free)
    assert (label_parts(free, False) == expected).all()
    assert (label_parts((~free).astype(np.uint8), 1) == expected).all()


@numba.njit
def _is_near(reach, a, b):
    return abs(b[0] - a[0]) <= reach


@numba.njit
def _hop(points, reach):
    return keep_bends(points, _is_near, reach)


def test_each_bend_is_the_last_point_seen_from_the_one_before():
    points = np.arange(8.0)[:, None]
    assert _hop(points, 3.0).ravel().tolist() == [0.0, 3.0, 6.0, 7.0]
    assert _hop(points, 0.5).ravel().tolist() == list(range(8))
    assert _hop(points[:1], 3.0).ravel().tolist() == [0.0]
