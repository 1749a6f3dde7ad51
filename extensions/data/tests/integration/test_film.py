"""A film shows what happened: its frames are decoded, and the vehicle moves in them as it flew."""

import json

import numpy as np
import pytest
from PIL import Image

import gslcosim_data
from gslcosim.base.errors import ModelError, UsageError
from gslcosim.cli.main import main
from gslcosim_data.film import FRAMES_PER_S, FilmSegment, PlanPanel, interpolate_pose, render_frames
from gslcosim_services.recorder.colors import MAP_OBSTACLES, agent_color

WHITE = (255, 255, 255)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs in the small room; their folders."""
    folder = tmp_path_factory.mktemp("runs")
    words = ["up", "tiny_room", "--in-process", "--quiet", "--runs-dir", str(folder)]
    for seed in ("1", "2"):
        main([*words, "--seed", seed, "--set", "referee.stop.time_limit_s=12"])
    return sorted(folder.iterdir())


def decoded(path):
    import av

    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def filmed(capsys, *words):
    exit_code = main(["film", *map(str, words), "--json"])
    printed = capsys.readouterr()
    if exit_code and "EGL or OSMesa" in printed.err:
        pytest.skip(printed.err)
    assert exit_code == 0, printed.err
    return json.loads(printed.out)


def place_of(frame, color, tolerance):
    """Return the mean pixel (x, y) of a colour."""
    is_it = np.abs(frame.astype(int) - color).max(axis=2) <= tolerance
    y, x = np.nonzero(is_it)
    return np.array([x.mean(), y.mean()])


@pytest.mark.slow
@pytest.mark.tour
@pytest.mark.debian
@pytest.mark.extras
def test_two_seconds_of_film_show_the_vehicle_where_it_was(runs, tmp_path, capsys):
    call_film = filmed(
        capsys, runs[0], "--out", tmp_path / "a.mp4", "--speed", 2, "--from", 4, "--to", 8, "--size", "641x361"
    )
    frames = decoded(tmp_path / "a.mp4")
    assert len(frames) == call_film["n_frames"] == 2 * FRAMES_PER_S + 1
    assert frames[0].shape == (360, 640, 3), "even numbers"
    right = frames[10][:288, 320:]
    assert right.std() > 5, "the room is not one colour"
    assert np.abs(frames[0][:288, 320:].astype(int) - frames[-1][:288, 320:]).mean() > 2, "and it moves"


@pytest.mark.slow
def test_the_plan_has_the_vehicle_at_its_place(runs):
    """The room of 6 x 5 m fills a panel of 320 x 288 pixels but for its margins: about 49 pixels a metre."""
    run = gslcosim_data.open_run(runs[0])
    cut = FilmSegment.of(run, from_s=2, to_s=8, speed=6)
    frames = [*render_frames([run], cut, (320, 360), has_chase_view=False)]
    seen = [place_of(frame[:288], WHITE, 0) for frame in frames]
    flown = [interpolate_pose(run.tracks["beetle"], time_s)[0] for time_s in cut.times_s.tolist()]
    scale = 296 / 6
    for pixel, place_m in zip(seen, flown, strict=True):
        expected = np.array([12 + place_m[0] * scale, 144 + 2.5 * scale - place_m[1] * scale])
        assert np.linalg.norm(pixel - expected) < 8
    assert np.linalg.norm(seen[-1] - seen[0]) > 30


@pytest.mark.slow
@pytest.mark.debian
def test_tiles_show_each_run_with_its_method_and_end(runs, tmp_path, capsys):
    call_film = filmed(capsys, *runs, "--out", tmp_path / "two.gif", "--speed", 6, "--size", "480x240")
    with Image.open(tmp_path / "two.gif") as film:
        assert film.size == (480, 240)
        assert film.n_frames <= call_film["n_frames"], "equal frames are one"
        film.seek(film.n_frames - 1)
        last = np.asarray(film.convert("RGB"))
    color = agent_color(0)
    for half in (last[:, :240], last[:, 240:]):
        assert (np.abs(half.astype(int) - color).max(axis=2) < 60).sum() > 20, "a track in each tile"


@pytest.mark.slow
def test_a_webp_without_the_room_needs_nothing_to_draw_with(runs, tmp_path, capsys, monkeypatch):
    def refused(*_):
        raise ModelError("cameras: expected EGL or OSMesa to draw with, was none.")

    monkeypatch.setattr("gslcosim_data.film.ChasePanel", refused)
    out = tmp_path / "plan.webp"
    words = ["film", str(runs[0]), "--out", str(out), "--speed", "20", "--size", "200x200"]
    assert main(words) == 2
    assert "Or film the plan alone with --plan-only." in capsys.readouterr().err
    assert not list(tmp_path.iterdir()), "nothing is left"
    assert main([*words, "--plan-only"]) == 0
    with Image.open(out) as film:
        assert film.n_frames > 5


@pytest.mark.slow
def test_what_is_wrong_is_reported(runs, tmp_path, capsys, monkeypatch):
    run = str(runs[0])

    def call_film(*words):
        assert main(["film", run, *words]) == 2
        return capsys.readouterr().err

    assert "--out: expected a file that ends with .mp4, .gif, .webp, was a.avi." in call_film("--out", "a.avi")
    assert "which ends at 12 s, was 40 to 12 s" in call_film("--out", "a.mp4", "--from", "40")
    assert "--follow: expected one of beetle, was 'moth'." in call_film("--out", "a.mp4", "--follow", "moth")
    assert "expected pixels such as 1280x720" in call_film("--out", "a.mp4", "--size", "big")
    assert "expected a number from 0.01 to 1000" in call_film("--out", "a.mp4", "--speed", "0")
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    text = call_film("--out", str(tmp_path / "a.mp4"), "--plan-only")
    assert "Install it with: pip install 'gslcosim-data[film]'" in text
    assert not list(tmp_path.iterdir())
    opened = gslcosim_data.open_run(run)
    cut = FilmSegment.of(opened, from_s=0, to_s=1, speed=1)
    with pytest.raises(UsageError, match="expected one run, was several"):
        render_frames([opened, opened], cut, (320, 200), follow="beetle")


@pytest.mark.slow
def test_a_film_shows_doors_as_they_are_at_its_time(tmp_path):
    short = ["--set", "referee.stop.time_limit_s=12", "--set", "gas.warm_up_s=1"]
    main(["up", "event_door", "--in-process", "--quiet", "--runs-dir", str(tmp_path), *short])
    run = gslcosim_data.open_run(next(tmp_path.iterdir()))
    assert run.closed_at(9.9) == ("gate",)
    assert run.closed_at(10.3) == ()
    plan = PlanPanel(run, (320, 240))
    poses = {name: interpolate_pose(track, 0.0) for name, track in run.tracks.items()}
    in_the_gate = plan.place_of((3.12, 2.0, 1.0))
    before, after = (plan.picture(time_s, poses).getpixel(in_the_gate) for time_s in (9.0, 11.0))
    assert before == MAP_OBSTACLES
    assert after != MAP_OBSTACLES
