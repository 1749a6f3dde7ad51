"""GADEN's folders: where occupancy and wind are found, and what they become."""

import struct

import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.formats.data_files import format_occupancy
from gslcosim.environment.formats.environment_folders import import_gaden, is_gaden, load_gaden_geometry
from gslcosim.environment.formats.wind_files import NoWindWarning
from gslcosim.environment.model import Cell, Grid
from gslcosim.environment.openings import voxelize

GRID = Grid(origin_m=(0.0, -1.0, 0.5), cell_m=0.5, shape=(4, 3, 2))


@pytest.fixture
def codes():
    """A room with a pillar and an outlet in the corner of x_max and y_min, two cells high."""
    cells = np.zeros(GRID.shape, np.uint8)
    cells[1, 1, :] = Cell.SOLID
    cells[3, :2, :] = Cell.OUTLET
    return cells


@pytest.fixture
def scenario(tmp_path, codes):
    folder = tmp_path / "10x6_room"
    folder.mkdir()
    (folder / "OccupancyGrid3D.csv").write_text(format_occupancy(GRID, codes))
    return folder


def write_result(folder, speed_m_s):
    folder.mkdir(parents=True)
    wind = np.full((24, 3), speed_m_s, "<f4")
    (folder / "wind_iteration_0").write_bytes(struct.pack("<2i", 3, 0) + wind.tobytes())


def test_a_scenario_becomes_a_room(scenario, codes):
    room = load_gaden_geometry(scenario)
    assert room.name == "10x6_room"
    assert room.grid == GRID
    np.testing.assert_array_equal(room.occupancy, codes)
    np.testing.assert_array_equal(voxelize(room.boxes, room.grid), codes == Cell.SOLID)
    (outlet,) = room.openings
    assert (outlet.kind, outlet.min_m, outlet.max_m) == ("outlet", (2.0, -1.0, 0.5), (2.0, 0.0, 1.5))


def test_the_file_itself_may_be_named(scenario):
    assert load_gaden_geometry(scenario / "OccupancyGrid3D.csv").name == "10x6_room"


def test_a_room_without_wind_says_so(scenario):
    with pytest.warns(NoWindWarning, match="10x6_room has no wind: all 24 cells are still air"):
        assert not import_gaden(scenario).wind.velocity_m_s.any()


@pytest.mark.parametrize(
    "place",
    ["wind", "wind_simulations", "wind_simulations/fast", "gas_simulations/fast/run_1/wind", "simulations/a/b/wind"],
)
def test_wind_is_found_where_gaden_puts_it(scenario, place):
    write_result(scenario / place, 2.0)
    assert (import_gaden(scenario, period_s=2.0).wind.velocity_m_s == 2.0).all()


def test_configurations_of_gaden_3_are_found(scenario, tmp_path):
    configuration = scenario / "environment_configurations" / "config1"
    write_result(configuration / "wind", 1.5)
    (scenario / "OccupancyGrid3D.csv").rename(configuration / "OccupancyGrid3D.csv")
    for path in (scenario, configuration):
        environment = import_gaden(path)
        assert environment.name == "10x6_room"
        assert environment.wind.velocity_m_s[0, 0, 0, 0, 0] == 1.5
    other = scenario / "environment_configurations" / "config2"
    other.mkdir()
    (other / "OccupancyGrid3D.csv").touch()
    with pytest.raises(EnvironmentDataError, match=r"was .*config1/OccupancyGrid3D.csv, .*config2"):
        import_gaden(scenario)


def test_a_wind_that_is_named_is_taken(scenario, tmp_path):
    write_result(scenario / "wind", 2.0)
    write_result(tmp_path / "other", 3.0)
    assert (import_gaden(scenario, wind=tmp_path / "other").wind.velocity_m_s == 3.0).all()


def test_several_winds_are_named(scenario):
    for name in ("calm", "fast"):
        write_result(scenario / "wind_simulations" / name, 1.0)
    with pytest.raises(EnvironmentDataError, match=r"one wind, was wind_simulations/calm, wind_simulations/fast"):
        import_gaden(scenario)


def test_folders_without_an_occupancy_are_refused(tmp_path):
    assert not is_gaden(tmp_path)
    with pytest.raises(EnvironmentDataError, match=r"expected one OccupancyGrid3D.csv"):
        load_gaden_geometry(tmp_path)
