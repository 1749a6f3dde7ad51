"""What lies around GADEN's frames."""

import numpy as np

from gslcosim.environment.model import Cell, Grid
from gslcosim_formats.data_files import format_occupancy
from gslcosim_formats.stored_gas.frame_formats import find_occupancy, read_walls

GRID = Grid(origin_m=(0.0, -1.0, 0.5), cell_m=0.5, shape=(2, 3, 4))


def test_the_occupancy_above_the_results_gives_the_walls(tmp_path):
    codes = np.zeros(GRID.shape, np.uint8)
    codes[1, 0, 2] = Cell.SOLID
    results = tmp_path / "scenario" / "simulations" / "result"
    results.mkdir(parents=True)
    assert find_occupancy(results) is None
    path = tmp_path / "scenario" / "OccupancyGrid3D.csv"
    path.write_text(format_occupancy(GRID, codes))
    assert find_occupancy(results) == path.resolve()
    walls = read_walls(path)
    np.testing.assert_array_equal(walls.occupancy, codes)
    assert (walls.origin_m, walls.cell_m) == (GRID.origin_m, GRID.cell_m)
