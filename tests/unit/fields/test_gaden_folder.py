"""What lies around GADEN's frames."""

import struct

import numpy as np
import pytest

from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Cell
from gslcosim.errors import EnvironmentDataError
from gslcosim.fields.gaden_folder import find_occupancy, read_walls, read_wind

GRID = Grid(origin_m=(0.0, -1.0, 0.5), cell_m=0.5, shape=(2, 3, 4))
HEAD = "#env_min(m) 0 -1 0.5\n#env_max(m) 1 0.5 2.5\n#num_cells 2 3 4\n#cell_size(m) 0.5\n"


def occupancy_text(codes, head=HEAD):
    layers = ["\n".join(" ".join(map(str, codes[x, :, z])) for x in range(2)) + "\n;" for z in range(4)]
    return head + "\n".join(layers) + "\n"


@pytest.fixture
def codes():
    """Codes that differ along every axis."""
    cells = np.zeros(GRID.shape, np.int64)
    cells[1, 0, 2] = Cell.SOLID
    cells[0, 2, 3] = Cell.OUTLET
    return cells


@pytest.fixture
def wind():
    """(nx, ny, nz, 3) numbers that are all different."""
    return np.arange(72, dtype=np.float32).reshape(2, 3, 4, 3) / 8


def test_cells_are_read_in_their_order(tmp_path, codes):
    path = tmp_path / "OccupancyGrid3D.csv"
    path.write_text(occupancy_text(codes))
    walls = read_walls(path)
    np.testing.assert_array_equal(walls.occupancy, codes)
    assert (walls.origin_m, walls.cell_m) == ((0.0, -1.0, 0.5), 0.5)


def test_the_occupancy_is_found_above_the_results(tmp_path, codes):
    results = tmp_path / "scenario" / "simulations" / "result"
    results.mkdir(parents=True)
    assert find_occupancy(results) is None
    (tmp_path / "scenario" / "OccupancyGrid3D.csv").write_text(occupancy_text(codes))
    assert find_occupancy(results) == (tmp_path / "scenario" / "OccupancyGrid3D.csv").resolve()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("#num_cells 2 3 4", "#num_cells 2 3", "4 lines of head"),
        ("#num_cells 2 3 4", "#num_cells 2 3 5", "10 rows of 3 cells"),
        ("#num_cells 2 3 4", "#num_cells 0 3 4", "finite, positive size"),
        ("#num_cells 2 3 4", "#num_cells 200000 300000 400000", "finite, positive size"),
        ("#cell_size(m) 0.5", "#cell_size(m) nan", "finite, positive size"),
        ("0 0 0\n", "0 x 0\n", "whole numbers as cells"),
        ("0 0 0\n", "0 7 0\n", "0 free, 1 obstacle or 2 outlet"),
        ("0 0 0\n", "0 0\n", "8 rows of 3 cells"),
    ],
)
def test_a_faulty_occupancy_is_refused(tmp_path, codes, old, new, expected):
    path = tmp_path / "OccupancyGrid3D.csv"
    text = occupancy_text(codes)
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(EnvironmentDataError, match=expected):
        read_walls(path)


def test_winds_of_both_layouts_are_read_in_their_order(tmp_path, wind):
    x_first = wind.transpose(2, 1, 0, 3).reshape(-1, 3)
    (tmp_path / "old").write_bytes(x_first.T.astype("<f8").tobytes())
    (tmp_path / "new").write_bytes(struct.pack("<2i", 3, 0) + x_first.astype("<f4").tobytes())
    for name in ("old", "new"):
        np.testing.assert_array_equal(read_wind(tmp_path / name, GRID), wind)


def test_a_wind_of_another_size_or_not_finite_is_refused(tmp_path, wind):
    path = tmp_path / "wind_iteration_0"
    with pytest.raises(EnvironmentDataError, match="cannot be read"):
        read_wind(path, GRID)
    path.write_bytes(bytes(100))
    with pytest.raises(EnvironmentDataError, match=r"expected 576 bytes .* or 296 .* was 100"):
        read_wind(path, GRID)
    wind[0, 0, 0, 0] = np.nan
    path.write_bytes(wind.astype("<f8").tobytes())
    with pytest.raises(EnvironmentDataError, match="finite velocities"):
        read_wind(path, GRID)
