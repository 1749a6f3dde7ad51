"""`gslcosim environment sample`"""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from reference_data import ENVIRONMENTS, GSL_BENCH, needs_environments

from gslcosim.cli.main import main
from gslcosim.environment.store import save_environment

AS_PUBLISHED = ("--frame", "400", "--cutoff-sigma", "5", "--no-line-of-sight")


@pytest.fixture
def points_file(tmp_path):
    def write(text, name="points.csv"):
        path = tmp_path / name
        path.write_text(text)
        return str(path)

    return write


@pytest.fixture
def room_folder(tmp_path, make_room):
    """An environment folder of ours with even wind."""
    save_environment(make_room(wind_m_s=((0.3, -0.4, 0.0),)), tmp_path / "room")
    return str(tmp_path / "room")


def last_column(path):
    with Path(path).open() as file:
        rows = list(csv.reader(file))
    return rows[0], np.array([float(row[-1]) for row in rows[1:]])


@needs_environments
@pytest.mark.parametrize("number", ["001", "003", "005"])
def test_published_grids_come_back_whole(number, tmp_path, capsys):
    folder, out = str(ENVIRONMENTS / number), tmp_path / "out.npz"
    published = np.load(GSL_BENCH / "ppm_data" / f"ppm_env_{number}.npz")["arr_0"]
    assert main(["environment", "sample", folder, *AS_PUBLISHED, "--grid", "0.25", "--out", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["points"] == published.size
    assert printed["max"] == pytest.approx(published.max(), rel=1e-9)
    with np.load(out) as arrays:
        np.testing.assert_allclose(arrays["mixing_ratio_ppm"], published, rtol=1e-9)
        assert [arrays[name][0] for name in ("x_m", "y_m", "z_m")] == [0.125, 0.125, 0.125]


def test_wind_has_its_speed_as_last_column(room_folder, points_file, tmp_path):
    points, out = points_file("x_m,y_m,z_m\n1,2,3\n"), tmp_path / "out.csv"
    words = ["--time", "0", "--quantity", "wind", "--points", points, "--out", str(out)]
    assert main(["environment", "sample", room_folder, *words]) == 0
    header, values = last_column(out)
    assert header[3:] == ["wind_x_m_s", "wind_y_m_s", "wind_z_m_s", "wind_speed_m_s"]
    assert values == pytest.approx([0.5], rel=1e-6)


def test_gas_of_a_scenario_is_released_in_an_environment(room_folder, points_file, tmp_path):
    """And numbers are written so that they read back as the same doubles: twice sampled, equal files."""
    points = points_file("z_m,name,x_m,y_m\n1.0,near,1.6,1.95\n1.0,far,13,9\n")
    texts = []
    for name in ("a.csv", "b.csv"):
        call = ["environment", "sample", room_folder, "--scenario", "tiny_room", "--time", "5", "--points", points]
        assert main([*call, "--out", str(tmp_path / name)]) == 0
        texts.append((tmp_path / name).read_text())
    assert texts[0] == texts[1]
    lines = texts[0].splitlines()
    assert lines[1].startswith("1.6,1.95,1.0,")
    assert float(lines[1].split(",")[-1]) > 0.1
    assert lines[2].split(",")[-1] == "0.0"
    assert all(repr(float(word)) == word for word in lines[1].split(","))


def test_a_grid_as_csv_names_its_points(room_folder, tmp_path):
    out = tmp_path / "out.csv"
    words = ["--scenario", "tiny_room", "--time", "0", "--grid", "1", "--out", str(out)]
    assert main(["environment", "sample", room_folder, *words]) == 0
    _, values = last_column(out)
    assert len(values) == 15 * 10 * 6
    assert values.max() > 0.0


FAULTY_POINTS = [
    ("", "expected a header line with x_m, y_m, z_m, was an empty file"),
    ("x,y,z\n1,2,3\n", "was x, y, z"),
    ("x_m,y_m,z_m\n", "expected at least one point below the header, was none"),
    ("x_m,y_m,z_m\n1,2\n", "expected 3 values in line 2, as in the header, was 2"),
    ("x_m,y_m,z_m\n1,2,3\n1,two,3\n", "expected numbers in line 3, was 1,two,3"),
    ("x_m,y_m,z_m\n1,nan,3\n", "expected finite numbers in line 2, was 1,nan,3"),
]


@pytest.mark.parametrize(("text", "expected"), FAULTY_POINTS)
def test_faulty_points_are_refused_with_their_line(room_folder, points_file, tmp_path, capsys, text, expected):
    words = ["--time", "0", "--quantity", "wind", "--out", str(tmp_path / "out.csv"), "--points", points_file(text)]
    assert main(["environment", "sample", room_folder, *words]) == 2
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["{room}", "--time", "-1"], "expected a number of seconds, at least 0, was '-1'"),
        (["{room}", "--time", "0", "--cutoff-sigma", "0"], "expected a number greater than 0, was '0'"),
        (["{room}", "--time", "0"], "Add --scenario SCENARIO"),
        (["{room}", "--time", "0", "--out", "{tmp}/out.npz"], "expected a csv file with --points"),
        (["{room}", "--time", "0", "--out", "{tmp}/none/out.csv"], "expected a folder that is there"),
        (["{tmp}", "--time", "0"], "was a folder without any of them"),
        (["no_such_thing", "--time", "0"], "expected a folder, a scenario, or the id of one run"),
        (["tiny_room", "--scenario", "tiny_room", "--time", "0"], "expected an environment folder of ours with it"),
        (["{room}", "--time", "0", "--quantity", "wind", "--points", "{tmp}/none.csv"], "No such file"),
    ],
)
def test_wrong_calls_are_answered(room_folder, points_file, tmp_path, capsys, words, expected):
    filled = [word.format(room=room_folder, tmp=tmp_path) for word in words]
    for option, value in (("--points", points_file("x_m,y_m,z_m\n1,2,3\n")), ("--out", str(tmp_path / "out.csv"))):
        if option not in filled:
            filled += [option, value]
    assert main(["environment", "sample", *filled, "--runs-dir", str(tmp_path / "runs")]) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize("quantity", [["--quantity", "wind"], ["--scenario", "tiny_room"]])
def test_points_outside_the_room_are_refused(room_folder, points_file, tmp_path, capsys, quantity):
    points = points_file("x_m,y_m,z_m\n1,2,3\n20,2,3\n")
    call = ["environment", "sample", room_folder, "--time", "0", *quantity, "--out", str(tmp_path / "out.csv")]
    assert main([*call, "--points", points]) == 2
    assert "was (20.0, 2.0, 3.0) m as point 2" in capsys.readouterr().err
