"""Snapshots of runs with cameras: the pictures that an agent has seen, and will see, are those of the run."""

import pytest
from real_runs import ROOT, fly_here
from repeated_runs import assert_same, forked
from test_snapshots import replayed, snapshots_of

VISION, DOOR = (ROOT / "scenarios" / f"{name}.yaml" for name in ("vision_room", "event_door"))
KEEPING = ("--set", "snapshots.every_s=2", "--set", "referee.stop.time_limit_s=9")
EYES = (
    "agents[0].sensors=[{model: tgs2600, name: nose}, {model: anemometer, name: wind}, "
    "{model: camera, name: eye, period_s: 0.3}, {model: depth_camera, name: depth, period_s: 0.5, max_range_m: 9}]"
)

pytestmark = [pytest.mark.slow, pytest.mark.debian]


def flown(scenario, runs_dir, *options):
    run = fly_here(scenario, runs_dir, *KEEPING, *options)
    if "expected EGL or OSMesa" in run.errors:
        pytest.skip("neither EGL nor OSMesa")
    return run


def test_an_agent_that_sees_goes_on_at_a_snapshot_between_two_pictures(tmp_path):
    run = flown(VISION, tmp_path / "run", "--set", "agents[0].sensors[2].period_s=0.7")
    assert 40 in snapshots_of(run.run_dir)
    fork = forked(run.run_dir, tmp_path / "fork", 5)
    assert_same(run, fork)
    assert fork.result["fork_of"]["snapshot_tick"] == 40
    exit_code, again, errors = replayed(run.run_dir, tmp_path / "again", 7, "--no-recording")
    assert (exit_code, again["digest"]) == (0, run.result["digest"]), errors
    assert again["comparison"]["snapshot_tick"] == 60


def test_pictures_show_a_door_as_it_is_then(tmp_path):
    """From snapshots before and after it opens they are the run's."""
    opens = ("--set", "events=[{what: door_opens, at_s: 5, door: gate}]", "--set", EYES)
    run = flown(DOOR, tmp_path / "run", *opens)
    for from_s, tick in ((4.5, 40), (7, 60)):
        exit_code, again, errors = replayed(run.run_dir, tmp_path / str(tick), from_s, "--no-recording")
        assert (exit_code, again["digest"]) == (0, run.result["digest"]), errors
        assert again["comparison"]["snapshot_tick"] == tick
