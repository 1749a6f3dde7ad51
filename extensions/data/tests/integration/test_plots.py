"""`gslcosim plot`: figures of runs hold their data, and the same data give the same bytes."""

import re
import sys

import numpy as np
import pytest

import gslcosim_data
from gslcosim.cli.main import main
from gslcosim_data.figures import read_svg_points

pytestmark = pytest.mark.slow

FLIGHTS = (("3", "infotaxis"), ("3", "surge_cast"), ("4", "surge_cast"), ("5", "surge_cast"))


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Three seeds of a method and one of another in the tiny room; by seed and method."""
    folder = tmp_path_factory.mktemp("runs")
    flown = {}
    for seed, method in FLIGHTS:
        words = ["up", "tiny_room", "--in-process", "--quiet", "--seed", seed, "--runs-dir", str(folder)]
        assert main([*words, "--set", f"agents[0].start.python={method}"]) in (0, 1)
        (flown[seed, method],) = set(folder.iterdir()) - set(flown.values())
    return flown


def plotted(out, *words):
    assert main(["plot", *map(str, words), "--out", str(out)]) == 0
    return out


@pytest.mark.tour
def test_points_read_back_from_svg_are_those_of_the_run(runs, tmp_path, capsys):
    folder = runs["3", "infotaxis"]
    out = plotted(tmp_path, folder, "--figure", "track,distance,gas", "--format", "svg")
    assert capsys.readouterr().out.split() == [str(out / f"{name}.svg") for name in ("track", "distance", "gas")]
    run = gslcosim_data.open_run(folder)
    drawn = read_svg_points(out / "track.svg")
    np.testing.assert_allclose(drawn["track/beetle"], run.tracks["beetle"].position_world_m[:, :2], atol=0.003)
    np.testing.assert_allclose(drawn["waypoints/beetle"], run.waypoints["beetle"].position_world_m[:, :2], atol=0.003)
    np.testing.assert_allclose(drawn["source/0"], [run.scenario.gas.sources[0].position_m[:2]], atol=0.003)
    distance = run.figure("beetle", "distance")
    found = read_svg_points(out / "distance.svg")["distance/beetle"]
    np.testing.assert_allclose(found, np.column_stack([distance.time_s, distance.value]), atol=0.005)
    found = read_svg_points(out / "gas.svg")
    response = next(one for one in run.readings if one.quantity == "response")
    np.testing.assert_allclose(found["response/beetle/nose"][:, 1], response.value, rtol=1e-4)
    assert len(found["true_ppm/beetle/nose/ethanol"]) == len(run.tracks["beetle"].tick)


def test_every_figure_of_a_run_comes_in_every_format_and_width(runs, tmp_path):
    for columns, formats in (("1", "pdf,svg,png"), ("2", "svg")):
        out = plotted(tmp_path / columns, runs["3", "infotaxis"], "--format", formats, "--columns", columns)
        names = {"track", "distance", "gas", "track_3d", "wind", "gas_section", "belief"}
        assert {path.name for path in out.iterdir()} == {f"{n}.{end}" for n in names for end in formats.split(",")}
        width_pt = float(re.search(r'width="([\d.]+)pt"', (out / "track.svg").read_text())[1])
        assert width_pt == pytest.approx(72 * {"1": 3.5, "2": 7.16}[columns], abs=0.1)


def test_the_same_run_gives_the_same_bytes(runs, tmp_path):
    one, other = (
        plotted(tmp_path / name, runs["4", "surge_cast"], "--figure", "track,distance", "--format", "pdf,svg,png")
        for name in ("one", "other")
    )
    for path in one.iterdir():
        assert path.read_bytes() == (other / path.name).read_bytes(), path.name


def test_several_runs_are_a_bundle_with_median_and_band(runs, tmp_path):
    out = plotted(tmp_path, *runs.values(), "--format", "svg")
    drawn = read_svg_points(out / "distance.svg")
    flights = [name for name in drawn if name.startswith("flight/surge_cast/")]
    assert len(flights) == 3
    at_s, median_m = drawn["median/surge_cast"].T
    held = [np.interp(at_s, *drawn[name].T) for name in flights]
    np.testing.assert_allclose(median_m, np.median(held, axis=0), atol=0.02)
    tracks = read_svg_points(out / "track.svg")
    assert len([name for name in tracks if name.startswith("track/")]) == 4


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--figure", "swarm"], "--figure swarm: expected a run with several agents"),
        (["--figure", "starts"], "--figure starts: expected a folder of results"),
        (["--figure", "pie"], "--figure: expected some of track, distance"),
        (["--format", "gif"], "--format: expected some of pdf, svg, png, was 'gif'"),
    ],
)
def test_what_cannot_be_drawn_is_reported(runs, tmp_path, capsys, words, expected):
    assert main(["plot", str(runs["3", "surge_cast"]), "--out", str(tmp_path), *words]) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="no limits on the size of files")
def test_a_disk_that_takes_no_more_and_a_file_in_the_way_are_reported(runs, tmp_path, capsys):
    import resource

    run = str(runs["3", "surge_cast"])
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        assert main(["plot", run, "--figure", "track", "--out", str(tmp_path)]) == 3
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "track.pdf: expected a file that can be written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    assert main(["plot", run, "--out", str(tmp_path / "file")]) == 3
    assert "--out: expected a folder that can be written" in capsys.readouterr().err


def test_results_are_drawn_by_room(tmp_path, capsys):
    assert main(["bench", "run", "smoke", "--jobs", "1", "--results", str(tmp_path / "results"), "--json"]) == 0
    out = plotted(tmp_path / "figures", tmp_path / "results", "--format", "svg")
    assert {path.stem for path in out.iterdir()} == {"starts_tiny_room", "distance_tiny_room"}
    starts = read_svg_points(out / "starts_tiny_room.svg")
    assert len(starts["starts/oracle"]) == 2
    capsys.readouterr()
    assert main(["runs", str(tmp_path / "results"), "--where", "method=oracle", "--json"]) == 0
    assert capsys.readouterr().out.count('"outcome": "success"') >= 2
