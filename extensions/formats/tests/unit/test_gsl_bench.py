"""GSL-Bench folders: the counts of the published environments, and what is refused."""

import json

import numpy as np
import pytest
from reference_data import ENVIRONMENTS, needs_environments

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.grid_kernels import find_air_cells
from gslcosim.environment.model import Cell
from gslcosim.environment.openings import voxelize
from gslcosim.environment.store import load_environment, save_environment
from gslcosim_formats.environment_folders import import_gsl_bench, load_gsl_bench_geometry
from gslcosim_formats.wind_files import NoWindWarning

HEAD = {"env_min": [-0.2, 0.0, 0.0], "env_max": [1.8, 1.2, 0.8], "num_cells": [10, 6, 4], "cell_size": 0.2}


@pytest.fixture
def folder(tmp_path):
    """A room of 10 x 6 x 4 cells, [z, x, y], with a wall at x_min that has an inlet, and an outlet at y_max."""
    codes = np.zeros((4, 10, 6), dtype=np.int64)
    codes[:, 0, :] = 1
    codes[:2, 0, 1:3] = 2
    codes[1:3, 7:9, 5] = 2
    write(tmp_path, codes, HEAD)
    return tmp_path


def write(folder, codes, head):
    (folder / "occupancy").mkdir(exist_ok=True)
    np.save(folder / "occupancy" / "room_grid.npy", codes)
    (folder / "occupancy" / "room_head.txt").write_text(json.dumps(head))


def refusal(folder):
    with pytest.raises(EnvironmentDataError) as error:
        load_gsl_bench_geometry(folder)
    return str(error.value)


@needs_environments
@pytest.mark.parametrize(
    ("name", "n_free", "n_solid", "n_outlet"),
    [("001", 218936, 17859, 365), ("003", 203238, 33557, 365), ("005", 191563, 45232, 365)],
)
def test_the_published_environments_have_their_counts_of_cells(name, n_free, n_solid, n_outlet):
    room = load_gsl_bench_geometry(ENVIRONMENTS / name)
    assert np.bincount(room.occupancy.ravel()).tolist() == [n_free, n_solid, n_outlet]
    assert room.grid.shape == (77, 77, 40)
    assert [opening.kind for opening in room.openings] == ["inlet", "outlet"]
    # Every solid cell is in a box, and no other cell is.
    assert (voxelize(room.boxes, room.grid) == (room.occupancy == Cell.SOLID)).all()
    # The source of the odd environments.
    assert room.occupancy[tuple(room.grid.cell_of(np.array([5.0, 1.0, 2.0])))] == Cell.FREE


def test_grids_are_turned_from_z_x_y_to_x_y_z(folder):
    room = load_gsl_bench_geometry(folder)
    assert room.name == "room"
    assert room.occupancy.shape == (10, 6, 4)
    assert room.occupancy[0, 0, 3] == Cell.SOLID
    assert (room.occupancy[0, 1:3, :2] == Cell.OUTLET).all()
    assert (room.occupancy[7:9, 5, 1:3] == Cell.OUTLET).all()
    assert (room.occupancy == Cell.OUTLET).sum() == 8


def test_openings_lie_on_the_faces_that_their_cells_reach(folder):
    inlet, outlet = load_gsl_bench_geometry(folder).openings
    assert (inlet.kind, inlet.min_m, inlet.max_m) == ("inlet", (-0.2, 0.2, 0.0), (-0.2, 0.6, 0.4))
    assert outlet.kind == "outlet"
    assert outlet.min_m == pytest.approx((1.2, 1.2, 0.2))
    assert outlet.max_m == pytest.approx((1.6, 1.2, 0.6))


def test_an_import_warns_of_missing_wind_and_can_be_saved(folder, tmp_path):
    with pytest.warns(NoWindWarning, match="all 240 cells are still air"):
        environment = import_gsl_bench(folder)
    save_environment(environment, tmp_path / "saved")
    assert load_environment(tmp_path / "saved").content_hash == environment.content_hash


def test_missing_and_ambiguous_files_are_named(folder):
    (folder / "occupancy" / "other_head.txt").write_text("{}")
    assert "expected one file *_head.txt, was other_head.txt, room_head.txt" in refusal(folder)
    assert "expected one file *_head.txt, was none" in refusal(folder / "nowhere")
    assert "expected a file that can be read" in refusal(folder / "occupancy" / "third_head.txt")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"num_cells": [10, 6]}, "expected JSON with env_min"),
        ({"cell_size": -0.2}, "expected JSON with env_min"),
        ({"cell_size": 0.25}, "expected cells that fill the space between the corners, was (10, 6, 4) cells of 0.25 m"),
        ({"num_cells": [6, 10, 4], "env_max": [1.0, 2.0, 0.8]}, "expected whole numbers [z, x, y] of (4, 6, 10)"),
    ],
)
def test_heads_that_are_wrong_are_refused(folder, change, text):
    (folder / "occupancy" / "room_head.txt").write_text(json.dumps(HEAD | change))
    assert text in refusal(folder)


def test_grids_that_are_truncated_or_hold_other_codes_are_refused(folder):
    path = folder / "occupancy" / "room_grid.npy"
    codes, content = np.load(path), path.read_bytes()
    path.write_bytes(content[:300])
    assert "expected a whole numpy array, was 300 bytes" in refusal(folder)
    path.write_bytes(content + b"more")
    assert "expected a numpy array and nothing else, was 4 bytes more" in refusal(folder)
    codes[0, 0, 0] = 3
    np.save(path, codes)
    assert "expected 0 free, 1 obstacle, 2 inlet or outlet, was 3" in refusal(folder)


@pytest.mark.parametrize("place", ["wind_data/room.npy", "wind/room.npy", "wind/other.npy"])
def test_wind_in_the_folder_is_read_with_x_fastest(folder, place):
    wind = np.arange(720, dtype=float).reshape(1, 240, 3) / 100
    (folder / place).parent.mkdir()
    np.save(folder / place, wind)
    velocity_m_s = import_gsl_bench(folder, period_s=0.25).wind.velocity_m_s
    # Cell (3, 4, 2) is number 3 + 10 * (4 + 6 * 2).
    np.testing.assert_array_equal(velocity_m_s[0, 3, 4, 2], wind[0, 163].astype(np.float32))


def test_a_room_among_others_is_named_by_its_head(folder):
    """AutoGDM+ keeps all its environments in one folder."""
    for suffix in ("_head.txt", "_grid.npy"):
        content = (folder / "occupancy" / f"room{suffix}").read_bytes()
        (folder / "occupancy" / f"other{suffix}").write_bytes(content)
    (folder / "wind_data").mkdir()
    for name, speed in (("room", 1.0), ("other", 2.0)):
        np.save(folder / "wind_data" / f"{name}.npy", np.full((1, 240, 3), speed))
    environment = import_gsl_bench(folder / "occupancy" / "other_head.txt")
    assert environment.name == "other"
    assert (environment.wind.velocity_m_s == 2.0).all()


def test_air_leaves_through_what_the_hull_of_an_outlet_encloses():
    """GADEN's preprocessing leaves the inside of a hull solid; the published rooms have such an outlet."""
    codes = np.zeros((8, 7, 5), np.uint8)
    codes[0] = codes[-1] = Cell.SOLID
    codes[0, 2:4, :2] = codes[1, 2:4, :2] = Cell.OUTLET
    codes[-2:, 2:6, :4] = Cell.OUTLET
    codes[-1, 3:5, 1:3] = Cell.SOLID
    is_air = find_air_cells(codes)
    assert is_air[-1, 2:6, :4].all()
    assert (is_air.sum(axis=(1, 2))[[0, -1]] == (4, 16)).all()
    assert (is_air[1:-1] == (codes[1:-1] != Cell.SOLID)).all()
