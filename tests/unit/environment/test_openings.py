"""Openings: faces, whole cells, and what lies beside what."""

import pytest

from gslcosim.environment.model import Grid, Opening
from gslcosim.environment.openings import FACES, are_overlapping, border_m, cells_at, find_face, snap_range

GRID = Grid(origin_m=(-1.0, 2.0, 0.5), cell_m=0.25, shape=(8, 6, 4))


def opening(min_m, max_m):
    return Opening(name="vent", kind="outlet", min_m=min_m, max_m=max_m)


@pytest.mark.parametrize("face", FACES, ids=lambda face: face.name)
def test_a_whole_face_touches_the_layer_of_cells_at_it(face):
    low, high = list(GRID.origin_m), list(GRID.max_m)
    low[face.axis] = high[face.axis] = face.coordinate_m(GRID)
    whole = opening(tuple(low), tuple(high))
    assert find_face(whole, GRID) == face
    layer = [range(n) for n in GRID.shape]
    layer[face.axis] = range(GRID.shape[face.axis])[-1:] if face.is_upper else range(1)
    assert [range(n)[cells] for n, cells in zip(GRID.shape, cells_at(whole, GRID), strict=True)] == layer


def test_an_opening_inside_the_room_touches_no_cells_of_a_face():
    inside = opening((0.0, 2.0, 0.5), (0.0, 3.0, 1.0))
    assert find_face(inside, GRID) is None
    with pytest.raises(ValueError, match="no face"):
        cells_at(inside, GRID)


def test_ends_half_way_between_borders_go_outward_or_up():
    # -0.625 and 0.125 m are one and a half and four and a half cells from the grid's corner.
    assert snap_range(-0.625, 0.125, GRID, 0, is_outward=True) == (1, 5)
    assert snap_range(-0.625, 0.125, GRID, 0, is_outward=False) == (1, 4)


def test_a_span_outside_the_grid_has_no_cells():
    for low_m, high_m in ((-3.0, -1.0), (1.0, 3.0)):
        assert snap_range(low_m, high_m, GRID, 0, is_outward=True) == (0, 0)


def test_borders_of_cells_carry_no_rounding_noise():
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.1, shape=(10, 10, 10))
    assert border_m(grid, 0, 3) == 0.3


def test_openings_overlap_only_where_they_share_a_part_of_one_face():
    vent = opening((-1.0, 2.0, 0.5), (-1.0, 3.0, 1.0))
    assert are_overlapping(vent, opening((-1.0, 2.5, 0.75), (-1.0, 3.5, 1.5)), GRID)
    assert are_overlapping(vent, opening((-1.0, 2.25, 0.75), (-1.0, 2.5, 0.8)), GRID)
    assert not are_overlapping(vent, opening((-1.0, 3.0, 0.5), (-1.0, 3.5, 1.0)), GRID)
    assert not are_overlapping(vent, opening((1.0, 2.0, 0.5), (1.0, 3.0, 1.0)), GRID)
    assert not are_overlapping(vent, opening((-1.0, 2.0, 0.5), (0.0, 2.0, 1.0)), GRID)
