"""Free cells of a grid in a granted map: by their centres, and throughout."""

import numpy as np
import pytest

from gslcosim.contract.messages import KnownMap
from gslcosim.contract.record import NumericArray
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.occupancy import OccupancyMap, free_cells

GRID = CellGrid((1.0, 2.0), 0.5, (6, 4))


def test_free_cells_are_those_whose_centres_are_free_in_the_map():
    occupied = np.zeros((4, 4), np.uint8)
    occupied[:2] = 1
    known = KnownMap(origin_m=(1.0, 2.0, 1.0), cell_m=0.5, occupied=NumericArray.from_array(occupied), height_m=1.0)
    assert free_cells(None, GRID).all()
    free = free_cells(known, GRID)
    assert free[2:4].all()
    assert not free[:2].any()
    assert not free[4:].any()  # beyond the map


def map_of(occupied: np.ndarray, cell_m: float = 0.2) -> KnownMap:
    return KnownMap(
        origin_m=(1.0, 2.0, 0.0),
        cell_m=cell_m,
        occupied=NumericArray.from_array(occupied.astype(np.uint8)),
        height_m=2.0,
    )


@pytest.mark.parametrize("cell_m", [0.1, 0.25, 0.33, 0.5])
@pytest.mark.parametrize("wall_at", range(2, 38, 5))
def test_a_thin_wall_of_a_map_is_a_wall_on_any_grid(cell_m, wall_at):
    occupied = np.zeros((40, 30))
    occupied[wall_at] = 1
    n_x, n_y = round(8.0 / cell_m), round(6.0 / cell_m)
    grid = CellGrid((1.0, 2.0), cell_m, (n_x, n_y))
    free = OccupancyMap.of(map_of(occupied)).free_throughout(grid)
    is_wall = ~free.any(axis=1)
    assert is_wall.sum() in range(1, 4)
    assert free[~is_wall].all()
    wall_m = 1.0 + (wall_at + 0.5) * 0.2
    assert is_wall[int((wall_m - 1.0) / cell_m)]


def test_the_cells_of_the_map_itself_are_free_as_they_are_and_none_outside():
    occupied = np.random.default_rng(1).integers(0, 2, (12, 9))
    same = CellGrid((1.0, 2.0), 0.2, (12, 9))
    assert (OccupancyMap.of(map_of(occupied)).free_throughout(same) == (occupied == 0)).all()
    elsewhere = CellGrid((0.0, 0.0), 0.2, (30, 30))
    free = OccupancyMap.of(map_of(np.zeros((12, 9)))).free_throughout(elsewhere)
    assert free.sum() == 12 * 9
    assert free[5:17, 10:19].all()


def test_of_a_map_in_space_the_layer_at_the_height_counts():
    occupied = np.zeros((4, 4, 5))
    occupied[1, :, 3] = 1
    grid = CellGrid((1.0, 2.0), 0.2, (4, 4))
    volume = KnownMap(origin_m=(1.0, 2.0, 0.0), cell_m=0.2, occupied=NumericArray.from_array(occupied.astype(np.uint8)))
    assert not OccupancyMap.of(volume, height_m=0.7).free_throughout(grid)[1].any()
    assert OccupancyMap.of(volume, height_m=0.3).free_throughout(grid).all()
    assert OccupancyMap.of(volume, height_m=9.0).free_throughout(grid).all()
    assert OccupancyMap.of(volume).free_at_centres(grid).all()
