"""`gslcosim_data.open_run`: what a run has left, as arrays."""

import json
import math
import shutil

import numpy as np
import pytest

import gslcosim_data
from gslcosim.base.errors import RecordingError, UsageError
from gslcosim.cli.main import main

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A run of a method that publishes beliefs; its folder."""
    runs = tmp_path_factory.mktemp("runs")
    method = "agents[0].start.python=infotaxis"
    assert main(["up", "tiny_room", "--in-process", "--quiet", "--set", method, "--runs-dir", str(runs)]) == 0
    return next(runs.iterdir())


@pytest.fixture
def copied(flown, tmp_path):
    """A copy of the run that a test may spoil."""
    return shutil.copytree(flown, tmp_path / flown.name)


@pytest.mark.tour
def test_a_run_is_read_back_as_arrays_that_fit_its_result(flown):
    run = gslcosim_data.open_run(flown)
    assert (run.agents, run.methods) == (("beetle",), {"beetle": "infotaxis"})
    assert [agent["method"] for agent in run.result["agents"]] == ["infotaxis"]
    track, agent = run.tracks["beetle"], run.result["agents"][0]
    assert track.tick[-1] == run.result["ticks"]
    length_m = float(np.linalg.norm(np.diff(track.position_world_m, axis=0), axis=1).sum())
    assert length_m == pytest.approx(agent["path_length_m"], rel=0.01)
    distance = run.figure("beetle", "distance")
    assert distance.value[-1] == pytest.approx(agent["final_distance_m"])
    source_m = run.scenario.gas.sources[0].position_m
    assert distance.value[30] == pytest.approx(math.dist(track.position_world_m[30], source_m), abs=1e-5)
    assert len(run.commands["beetle"]) == agent["steps"] == len(run.waypoints["beetle"].tick)
    beliefs = run.beliefs["beetle"]
    assert beliefs.in_plane(0).sum() == pytest.approx(1, abs=1e-3)
    assert run.figure("beetle", "belief_mass_near").value[-1] == pytest.approx(agent["belief"]["mass_near_frac"])
    assert run.gas_slices["ethanol"].at(5.0).max() > 0
    assert len(run.figure("beetle", "decision_time").tick) == agent["steps"]
    assert run.figure("beetle", "decision_time").value.min() > 0
    assert run.events.text[-1].startswith("the run ends after")
    assert run.wind_m_s(3.0).shape == (*run.environment.occupancy.shape, 3)
    assert gslcosim_data.open_run(flown / "recording.rrd").run_id == run.run_id


def test_a_run_that_was_killed_is_read_without_a_result_once_its_recording_is_whole(copied):
    (copied / "result.json").unlink()
    assert gslcosim_data.open_run(copied).result is None
    recording = copied / "recording.rrd"
    recording.write_bytes(recording.read_bytes()[: recording.stat().st_size // 2])
    with pytest.raises(RecordingError, match="expected a whole one, was one that was cut off"):
        gslcosim_data.open_run(copied)


def test_a_run_of_another_contract_is_refused(copied):
    manifest = json.loads((copied / "manifest.json").read_text())
    (copied / "manifest.json").write_text(json.dumps(manifest | {"contract_hash": "0", "gslcosim": "0.0.9"}))
    with pytest.raises(UsageError, match=r"expected a run of contract .*, was 0, flown by gslcosim 0\.0\.9"):
        gslcosim_data.open_run(copied)


def test_a_run_without_recording_says_how_to_record_it(copied):
    (copied / "recording.rrd").unlink()
    with pytest.raises(UsageError, match=r"found none\. Record it now: gslcosim replay"):
        gslcosim_data.open_run(copied)


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"expected a folder with manifest\.json"):
        gslcosim_data.open_run(tmp_path)
