"""`gslcosim environment import` and `export`: what they write and tell, and what is a wrong call."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from gslcosim.cli.main import main
from gslcosim.environment.model import Grid
from gslcosim.environment.store import load_environment
from gslcosim_formats.data_files import format_occupancy
from gslcosim_formats.environment_views import PICTURE_FILE
from gslcosim_formats.scene_file import SCENE_FILE


@pytest.fixture
def scenario(tmp_path):
    """A room of GADEN, 4 x 3 x 2 cells, with two frames of wind beside it."""
    folder = tmp_path / "shed"
    folder.mkdir()
    codes = np.zeros((4, 3, 2), np.uint8)
    codes[1, 1], codes[3, 0] = 1, 2
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, shape=(4, 3, 2))
    (folder / "OccupancyGrid3D.csv").write_text(format_occupancy(grid, codes))
    np.save(tmp_path / "wind.npy", np.ones((2, 24, 3)) * [[[1.0]], [[2.0]]])
    return folder


def test_a_room_with_its_wind_becomes_an_environment(scenario, tmp_path, capsys):
    out = tmp_path / "env"
    wind = str(tmp_path / "wind.npy")
    assert (
        main(
            ["environment", "import", str(scenario), "--wind", wind, "--period", "0.5", "--no-loop", "--out", str(out)]
        )
        == 0
    )
    output = capsys.readouterr()
    assert output.out == (
        f"{out}: shed, 4 x 3 x 2 cells of 0.5 m (20 free, 2 solid, 2 at outlets), 1 openings, frames of wind: 2.\n"
    )
    assert output.err == ""
    environment = load_environment(out)
    assert (environment.wind.period_s, environment.wind.is_looping) == (0.5, False)
    assert (environment.wind.velocity_m_s[1] == 2.0).all()
    assert (out / PICTURE_FILE).is_file()
    assert (out / SCENE_FILE).is_file()


def test_json_has_all_that_is_reported(scenario, tmp_path, capsys):
    assert main(["environment", "import", str(scenario), "--out", str(tmp_path / "env"), "--json"]) == 0
    output = capsys.readouterr()
    printed = json.loads(output.out)
    assert output.err == ""
    assert (printed["n_free_cells"], printed["n_solid_cells"], printed["n_outlet_cells"]) == (20, 2, 2)
    assert (printed["shape"], printed["openings"]) == ([4, 3, 2], ["outlet_0"])
    (notice,) = printed["notices"]
    assert notice.startswith("shed has no wind")
    assert notice in yaml.safe_load((tmp_path / "env" / "environment.yaml").read_text())["notices"]


def test_an_environment_goes_out_and_comes_back(scenario, tmp_path, capsys):
    first, again = tmp_path / "env", tmp_path / "again"
    main(["environment", "import", str(scenario), "--wind", str(tmp_path / "wind.npy"), "--out", str(first)])
    for to in ("gaden", "gsl_bench"):
        out = tmp_path / to / "shed"
        capsys.readouterr()
        assert main(["environment", "export", str(first), "--to", to, "--out", str(out), "--json"]) == 0
        printed = json.loads(capsys.readouterr().out)
        assert all(Path(path).is_file() for path in printed["files"])
        assert main(["environment", "import", str(out), "--out", str(again)]) == 0
        one, other = load_environment(first), load_environment(again)
        np.testing.assert_array_equal(one.occupancy, other.occupancy)
        np.testing.assert_array_equal(one.wind.velocity_m_s, other.wind.velocity_m_s)


def test_the_environment_of_a_scenario_is_exported(tmp_path, capsys):
    assert main(["environment", "export", "tiny_room", "--to", "vtk", "--out", str(tmp_path / "out")]) == 0
    assert [Path(line).suffix for line in capsys.readouterr().out.splitlines()] == [".vti", ".pvd"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["environment", "import", "{here}", "--out", "env"], "was a folder or file without any of them"),
        (
            ["environment", "import", "{here}/shed", "--period", "0", "--out", "env"],
            "expected a number of seconds greater than 0",
        ),
        (
            ["environment", "export", "{here}/shed", "--to", "vtk", "--out", "{here}/out"],
            "expected an environment folder",
        ),
        (
            ["environment", "export", "tiny_room", "--to", "vtk", "--out", "{here}/shed"],
            "Choose a new or empty folder",
        ),
        (
            ["environment", "export", "tiny_room", "--to", "vtk", "--out", "{here}/wind.npy"],
            "expected a folder that can be written",
        ),
    ],
)
def test_wrong_calls_are_reported(scenario, capsys, words, expected):
    assert main([word.format(here=scenario.parent) for word in words]) == 2
    assert expected in capsys.readouterr().err
