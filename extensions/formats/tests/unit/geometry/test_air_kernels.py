"""Floods: what surely is air, and to whom the cells belong that a surface passes."""

import numpy as np

from gslcosim_formats.geometry.cell_kernels import BORDER, CROSSED, TOUCHED, assign_touched_cells, flood_untouched

SHAPE = (7, 5, 4)


def test_a_flood_stops_at_touched_cells_and_at_borders():
    marks = np.zeros(SHAPE, np.uint8)
    marks[5] = TOUCHED
    marks[2] |= BORDER
    reached = flood_untouched(marks, np.array([0]))
    assert reached[:3].all()
    assert not reached[3:].any()
    marks[2, 4, 3] = 0
    reached = flood_untouched(marks, np.array([0]))
    assert reached[:5].all()
    assert not reached[5:].any()


def test_a_border_belongs_to_its_axis():
    for axis in range(3):
        marks = np.zeros(SHAPE, np.uint8)
        np.moveaxis(marks, axis, 0)[1] = BORDER << axis
        reached = np.moveaxis(flood_untouched(marks, np.array([0])), axis, 0)
        assert reached[:2].all()
        assert not reached[2:].any()


def test_a_seed_in_a_touched_cell_reaches_nothing():
    assert not flood_untouched(np.full(SHAPE, TOUCHED, np.uint8), np.array([7])).any()


def touched_wall(*, crossed_before):
    """Return marks of a wall that passes the cells i = 3, before or behind their centres."""
    marks = np.zeros(SHAPE, np.uint8)
    marks[3] = TOUCHED
    marks[2 if crossed_before else 3] |= CROSSED
    is_air = np.zeros(SHAPE, bool)
    is_air[:3] = True
    return marks, is_air


def test_a_touched_cell_is_air_when_its_centre_is():
    assert assign_touched_cells(*touched_wall(crossed_before=False))[:4].all()
    assert not assign_touched_cells(*touched_wall(crossed_before=False))[4:].any()
    assert not assign_touched_cells(*touched_wall(crossed_before=True))[3:].any()


def test_a_hole_smaller_than_a_cell_lets_nothing_through():
    marks, is_air = touched_wall(crossed_before=True)
    marks[2, 2, 2] = 0
    assert (assign_touched_cells(marks, is_air) == is_air).all()
