"""The grid: cells and centres in a box with three different side lengths."""

import numpy as np

from gslcosim.environment.model import Grid

GRID = Grid(origin_m=(-1.0, 2.0, 0.5), cell_m=0.25, shape=(7, 5, 3))


def test_the_centre_of_every_cell_lies_in_that_cell():
    centres = GRID.centres_m()
    assert centres.shape == (7, 5, 3, 3)
    indices = np.stack(np.meshgrid(*map(np.arange, GRID.shape), indexing="ij"), axis=-1)
    assert (GRID.cell_of(centres) == indices).all()


def test_a_cell_holds_its_lower_faces_and_not_its_upper_ones():
    assert GRID.cell_of(np.array(GRID.origin_m)).tolist() == [0, 0, 0]
    assert GRID.cell_of(np.array(GRID.max_m)).tolist() == [7, 5, 3]
    assert GRID.cell_of(np.array([-0.75, 2.25, 0.75])).tolist() == [1, 1, 1]


def test_cells_beyond_any_face_are_outside():
    for axis, n in enumerate(GRID.shape):
        for index, is_inside in ((-1, False), (0, True), (n - 1, True), (n, False)):
            cell = np.zeros(3, dtype=np.int64)
            cell[axis] = index
            assert GRID.contains_cell(cell) == is_inside
