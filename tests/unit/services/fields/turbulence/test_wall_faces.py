"""Wind beside walls: none through them, the interpolation's elsewhere, and open at openings."""

import dataclasses

import numpy as np
import pytest
from built_rooms import build_air

from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim.environment.model import Cell, Opening
from gslcosim_services.fields.turbulence.wall_faces import find_wall_faces, wind_beside_walls

CELL_M = 0.5
ORIGIN_M = np.array((1.0, -2.0, 0.5))
INLET = Opening(name="inlet", kind="inlet", min_m=(1.0, -1.0, 1.0), max_m=(1.0, 0.5, 2.0), velocity_m_s=(1.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def room():
    """Twelve by ten by eight cells with a block on the floor, an inlet at x = 0 and an outlet on the other side."""
    occupancy = np.zeros((12, 10, 8), np.uint8)
    occupancy[5:7, 4:6, :3] = Cell.SOLID
    occupancy[-1, 2:8, 2:6] = Cell.OUTLET
    wind_m_s = np.random.default_rng(1).normal(size=(1, 12, 10, 8, 3)).astype(np.float32)
    wind_m_s[0, occupancy == Cell.SOLID] = 0.0
    air = build_air(occupancy, wind_m_s, cell_m=CELL_M, origin_m=tuple(ORIGIN_M))
    return dataclasses.replace(air, openings=(INLET,))


def wind_at(room, cells):
    """Wind at a place in cells from the room's corner."""
    point_m = ORIGIN_M + CELL_M * np.array(cells)
    return wind_beside_walls(room.wind.velocity_m_s[0], find_wall_faces(room), ORIGIN_M, CELL_M, *point_m)


@pytest.mark.parametrize(
    ("place", "axis"),
    [
        ((0.0, 8.3, 6.2), 0),
        ((3.3, 0.0, 6.2), 1),
        ((3.3, 4.4, 0.0), 2),
        ((3.3, 4.4, 8.0), 2),
        ((12.0, 0.5, 7.3), 0),
        ((5.0 - 1e-9, 4.6, 1.5), 0),
        ((7.0, 5.2, 1.5), 0),
        ((5.6, 6.0, 0.7), 1),
        ((5.5, 5.1, 3.0), 2),
    ],
)
def test_no_wind_blows_through_a_wall(room, place, axis):
    """Walls of the room, and sides and top of the block."""
    wind_m_s = wind_at(room, place)
    assert wind_m_s[axis] == pytest.approx(0.0, abs=1e-6)
    assert max(abs(each) for each in wind_m_s) > 0.01


@pytest.mark.parametrize("place", [(2.5, 3.5, 4.5), (8.2, 6.9, 5.3), (0.1, 3.5, 2.5), (11.9, 4.5, 4.5)])
def test_wind_away_from_walls_and_at_openings_is_the_interpolation(room, place):
    point_m = ORIGIN_M + CELL_M * np.array(place)
    expected = trilinear_wind(room.wind.velocity_m_s[0], ORIGIN_M, CELL_M, *point_m)
    assert wind_at(room, place) == pytest.approx(expected, abs=1e-6)


def test_wind_towards_a_wall_falls_evenly_from_the_centre_of_its_cell(room):
    at_centre, half_way = (wind_at(room, (0.5 * share, 8.5, 6.5))[0] for share in (1.0, 0.5))
    assert half_way == pytest.approx(0.5 * at_centre)
    beside, nearer = (wind_at(room, (5.0 - 0.5 * share, 4.5, 1.5))[0] for share in (1.0, 0.5))
    assert nearer == pytest.approx(0.5 * beside)
