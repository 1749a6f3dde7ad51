import numpy as np
import pytest

from gslcosim_services.fields.filament.filament_step import FACE_MARGIN, OUTLET, SOLID, cell_index, trace_reflections

ORIGIN = (-1.0, 2.0, 0.5)
CELL = 0.5


@pytest.fixture
def cells():
    """7 x 5 x 4 cells of free air: a box of three different side lengths."""
    return np.zeros((7, 5, 4), np.uint8)


def trace(cells, start, displacement, *, reflects=False):
    p = np.add(ORIGIN, np.multiply(start, CELL))
    d = np.multiply(displacement, CELL)
    x, y, z, ended, *_ = trace_reflections(cells, ORIGIN, CELL, *p.tolist(), *d.tolist(), reflects)
    return np.subtract((x, y, z), ORIGIN) / CELL, ended


def test_in_free_air_the_displacement_is_kept(cells):
    end, ended = trace(cells, (0.5, 4.5, 3.5), (6.2, -3.7, -2.9))
    assert end == pytest.approx((6.7, 0.8, 0.6))
    assert not ended


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_point_slides_along_the_border(cells, axis, sign):
    start = np.array((3.5, 2.5, 1.5))
    displacement = np.full(3, 0.3)
    displacement[axis] = 20.0 * sign
    end, ended = trace(cells, start, displacement)
    expected = start + displacement
    expected[axis] = cells.shape[axis] if sign > 0 else 0.0
    assert end == pytest.approx(expected, abs=2 * FACE_MARGIN)
    assert not ended


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_point_is_reflected_by_the_border(cells, axis, sign):
    start = np.array((3.5, 2.5, 1.5))
    displacement = np.full(3, 0.3)
    side = cells.shape[axis] if sign > 0 else 0.0
    displacement[axis] = (side - start[axis]) + 0.4 * sign
    end, _ = trace(cells, start, displacement, reflects=True)
    expected = start + displacement
    expected[axis] = side - 0.4 * sign
    assert end == pytest.approx(expected)


def test_a_point_slides_around_no_corner_into_a_wall(cells):
    cells[3, :, :] = SOLID
    end, ended = trace(cells, (1.5, 1.5, 1.5), (4.0, 1.0, -1.0))
    assert end == pytest.approx((3.0, 2.5, 0.5), abs=2 * FACE_MARGIN)
    assert not ended


def test_reflection_between_two_walls_ends_where_the_folded_path_does(cells):
    cells[2, :, :] = SOLID
    cells[5, :, :] = SOLID
    end, _ = trace(cells, (3.25, 2.5, 1.5), (7.0, 0.0, 0.0), reflects=True)
    folded = (0.25 + 7.0) % 4.0
    assert end[0] == pytest.approx(3.0 + min(folded, 4.0 - folded), abs=1e-6)


@pytest.mark.parametrize(("x", "displacements"), [(5.5, (0.6, 0.4)), (6.5, (0.6, -0.6))], ids=["entering", "leaving"])
def test_an_outlet_ends_what_enters_it_and_what_leaves_the_grid_from_within(cells, x, displacements):
    cells[6, 2, 1] = OUTLET
    assert [trace(cells, (x, 2.5, 1.5), (dx, 0.0, 0.0))[1] for dx in displacements] == [True, False]


def test_a_point_on_a_face_counts_to_the_cell_above_it(cells):
    cells[3, :, :] = SOLID
    end, _ = trace(cells, (4.0, 2.5, 1.5), (-1.0, 0.0, 0.0))
    assert end[0] == pytest.approx(4.0, abs=2 * FACE_MARGIN)
    assert end[0] >= 4.0


def test_cell_index_rounds_down_on_both_sides_of_the_origin():
    assert [cell_index(x, -1.0, 0.5) for x in (-1.51, -1.0, -0.75, 0.0, 0.49)] == [-2, 0, 0, 2, 2]
