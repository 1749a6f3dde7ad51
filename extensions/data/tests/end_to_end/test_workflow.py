"""The tale of a researcher: fly, find, compare, look, draw, film, take away, and lay a real flight beside it."""

import json

import numpy as np
import pyarrow.parquet
import pytest
from PIL import Image

import gslcosim_data
from gslcosim.cli.main import main
from gslcosim_data.figures import read_svg_points

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]

METHODS = ("dung_beetle", "surge_cast")
SEEDS = ("1", "2", "3")


@pytest.fixture
def call(capsys):
    """Call a command; return what it prints as JSON."""

    def call(*words, expected=0):
        exit_code = main([*map(str, words), "--json"])
        printed = capsys.readouterr()
        assert exit_code == expected, printed.err
        return json.loads(printed.out)

    return call


@pytest.mark.debian
@pytest.mark.extras
def test_from_six_runs_to_a_film_a_figure_and_a_real_flight(tmp_path, call, capsys):
    import av
    from rosbags import highlevel

    runs_dir = tmp_path / "runs"
    limit = ("--set", "referee.stop.time_limit_s=15")
    for method in METHODS:
        for seed in SEEDS:
            start = ("--set", f"agents[0].start.python={method}")
            words = ["up", "tiny_room", "--in-process", "--quiet", "--seed", seed, "--runs-dir", str(runs_dir)]
            main([*words, *limit, *start])
    capsys.readouterr()

    # Find them.
    rows = call("runs", runs_dir, "--sort", "seed")
    assert [row["seed"] for row in rows] == [1, 1, 2, 2, 3, 3]
    pair = call("runs", runs_dir, "--where", "seed=2")
    assert {row["method"] for row in pair} == set(METHODS)
    folders = [runs_dir / row["run"] for row in pair]

    # Lay two beside each other.
    picture = tmp_path / "both.png"
    if main(["view", *map(str, folders), "--screenshot", str(picture), "--window-size", "900x600"]) == 0:
        with Image.open(picture) as shown:
            assert shown.width * 600 == shown.height * 900
            assert np.asarray(shown.convert("L")).std() > 10, "not one colour"
    else:
        assert "Vulkan" in capsys.readouterr().err, "the one thing that may lack"
    capsys.readouterr()

    # A figure, whose points are the run's.
    run = gslcosim_data.open_run(folders[0])
    call("plot", folders[0], "--figure", "track", "--format", "svg", "--out", tmp_path / "figures")
    drawn = read_svg_points(tmp_path / "figures" / "track.svg")["track/beetle"]
    assert np.linalg.norm(drawn[-1] - run.tracks["beetle"].position_world_m[-1, :2]) < 0.02

    # Two seconds of film.
    film = call("film", folders[0], "--out", tmp_path / "a.mp4", "--from", 4, "--to", 8, "--speed", 2, "--plan-only")
    with av.open(film["out"]) as container:
        frames = [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(video=0)]
    assert len(frames) == film["n_frames"]
    assert np.abs(frames[-1] - frames[0]).max() > 60

    # Away with it, in four formats.
    for to in ("parquet", "csv", "mcap", "rosbag2"):
        assert call("extract", folders[0], "--to", to, "--out", tmp_path / to)["files"]
    table = pyarrow.parquet.read_table(tmp_path / "parquet" / "track_beetle.parquet")
    np.testing.assert_array_equal(table["x_m"].to_numpy(), run.tracks["beetle"].position_world_m[:, 0])
    with highlevel.AnyReader([tmp_path / "rosbag2"]) as bag:
        poses = [c for c in bag.connections if c.topic == "/beetle/odom"]
        assert sum(1 for _ in bag.messages(connections=poses)) == len(run.tracks["beetle"].tick)

    # And a bag comes back as a real flight, and is listed with the others.
    flown = call("runs", "import", tmp_path / "rosbag2", "--scenario", "tiny_room", "--runs-dir", runs_dir)
    assert flown["valid"]
    rows = call("runs", runs_dir)
    assert len(rows) == 7
    assert flown["run_id"] in {row["run"] for row in rows}
