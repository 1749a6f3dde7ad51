"""How far a vehicle rises or sinks straight up and down between what is solid in a room."""

import numpy as np
import pytest

from gslcosim.environment.model import Cell, EnvironmentGeometry, Grid
from gslcosim.environment.vertical_clearance import clear_height_m, is_climb_sufficient, is_descent_clear

RADIUS_M = 0.3


@pytest.fixture
def room():
    """10 m by 10 m by 6 m, with a beam from (2, 2) to (4, 4) m, 1.5 to 1.75 m above the floor."""
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.25, shape=(40, 40, 24))
    occupancy = np.zeros(grid.shape, np.uint8)
    occupancy[8:16, 8:16, 6] = Cell.SOLID
    return EnvironmentGeometry(name="hall", grid=grid, occupancy=occupancy, boxes=(), openings=())


def test_heights_are_those_of_the_first_cells_in_the_way(room):
    def clear(place_m, to_m):
        return clear_height_m(room, RADIUS_M, place_m, to_m)

    assert clear((3.0, 3.0, 0.1), 1.0) == 1.0
    assert clear((3.0, 3.0, 0.1), 1.2) == pytest.approx(1.15)
    assert clear((3.0, 3.0, 0.1), 5.0) == pytest.approx(1.15)
    assert clear((3.0, 3.0, 5.0), 2.0) == pytest.approx(2.1)
    assert clear((3.0, 3.0, 5.0), 3.0) == 3.0
    # Beside it by more than the radius, and by less.
    assert clear((4.31, 3.0, 0.1), 5.0) == 5.0
    assert clear((4.29, 3.0, 0.1), 5.0) == pytest.approx(1.15)
    assert is_descent_clear(room, RADIUS_M, (3.0, 3.0, 4.0), 1.75)
    assert not is_descent_clear(room, RADIUS_M, (3.0, 3.0, 4.0), 0.0)


def test_the_cell_it_is_in_is_not_in_the_way(room):
    room.occupancy[20, 20, 0] = Cell.SOLID
    place_m = (20.5 * 0.25, 20.5 * 0.25, 0.1)
    assert clear_height_m(room, RADIUS_M, place_m, 2.0) == 2.0
    assert np.isfinite(clear_height_m(room, RADIUS_M, place_m, 5.9))


def test_a_rise_of_less_than_half_a_metre_is_none_unless_no_more_is_wanted():
    assert is_climb_sufficient(0.05, 1.5, 1.5)
    assert is_climb_sufficient(0.05, 0.56, 1.5)
    assert not is_climb_sufficient(0.05, 0.54, 1.5)
    assert is_climb_sufficient(0.05, 0.3, 0.3)
