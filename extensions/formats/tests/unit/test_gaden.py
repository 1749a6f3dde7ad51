"""GADEN's folders: where occupancy and wind are found, and what they become."""

import struct

import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.grid_kernels import find_air_cells
from gslcosim.environment.model import Cell, Grid
from gslcosim.environment.openings import voxelize
from gslcosim_formats.data_files import format_occupancy
from gslcosim_formats.environment_folders import import_gaden, is_gaden, load_gaden_geometry

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


def openings_of(folder, codes):
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, shape=codes.shape)
    (folder / "OccupancyGrid3D.csv").write_text(format_occupancy(grid, codes))
    return [(each.kind, each.min_m, each.max_m) for each in load_gaden_geometry(folder).openings]


def band(shape, layers):
    """Outlets around all four sides, in some layers."""
    codes = np.zeros(shape, np.uint8)
    codes[[0, -1], :, layers] = codes[:, [0, -1], layers] = Cell.OUTLET
    return codes


@pytest.mark.parametrize(("shape", "n_layers"), [((4, 3, 2), 2), ((12, 9, 8), 8), ((12, 9, 8), 2), ((12, 9, 8), 1)])
def test_open_sides_are_four_openings_and_none_on_floor_or_ceiling(tmp_path, shape, n_layers):
    x, y, z = 0.5 * shape[0], 0.5 * shape[1], 0.5 * n_layers
    assert openings_of(tmp_path, band(shape, slice(0, n_layers))) == [
        ("outlet", (0.0, 0.0, 0.0), (0.0, y, z)),
        ("outlet", (x, 0.0, 0.0), (x, y, z)),
        ("outlet", (0.0, 0.0, 0.0), (x, 0.0, z)),
        ("outlet", (0.0, y, 0.0), (x, y, z)),
    ]


def cells(*parts):
    codes = np.zeros((12, 9, 8), np.uint8)
    for part in parts:
        codes[part] = Cell.OUTLET
    return codes


@pytest.mark.parametrize(
    ("codes", "expected"),
    [
        # Around a corner: long legs, short ones, and those of a thick wall.
        (cells(np.s_[0, :5, :3], np.s_[:6, 0, :3]), [((0, 0, 0), (0, 2.5, 1.5)), ((0, 0, 0), (3, 0, 1.5))]),
        (cells(np.s_[0, :2, 2], np.s_[:2, 0, 2]), [((0, 0, 1), (0, 1, 1.5)), ((0, 0, 1), (1, 0, 1.5))]),
        (cells(np.s_[:2, :4, 1:4], np.s_[:5, :2, 1:4]), [((0, 0, 0.5), (0, 2, 2)), ((0, 0, 0.5), (2.5, 0, 2))]),
        # A wall and the floor before it; floor and roof; a grate in the floor beside a wall; a vent one cell high.
        (cells(np.s_[0, 2:5, :4], np.s_[:4, 2:5, 0]), [((0, 1, 0), (0, 2.5, 2)), ((0, 1, 0), (2, 2.5, 0))]),
        (cells(np.s_[..., 0], np.s_[..., -1]), [((0, 0, 0), (6, 4.5, 0)), ((0, 0, 4), (6, 4.5, 4))]),
        (cells(np.s_[:3, 2:5, 0]), [((0, 1, 0), (1.5, 2.5, 0))]),
        (cells(np.s_[0, 2:7, 0]), [((0, 1, 0), (0, 3.5, 0.5))]),
        # One opening, as deep as a wall, in the corner of the room.
        (cells(np.s_[9:, 5:, :6]), [((6, 2.5, 0), (6, 4.5, 3))]),
    ],
)
def test_connected_outlets_are_an_opening_on_each_face_where_they_lie_flat(tmp_path, codes, expected):
    assert [place for _, *place in openings_of(tmp_path, codes)] == [[*map(tuple, place)] for place in expected]


def test_the_air_between_open_sides_does_not_go_through_what_stands_there():
    codes = band((12, 9, 8), slice(0, 8))
    codes[5:7, 4, :3] = Cell.SOLID
    np.testing.assert_array_equal(find_air_cells(codes), codes != Cell.SOLID)
