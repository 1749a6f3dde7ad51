"""Units of FMI in runs: those of several makers together, with one digest however they are hosted or killed."""

import json
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from fan_units import build_fan
from real_runs import ROOT, fly_here, start
from repeated_runs import assert_same, forked

from gslcosim.cli.main import main

pytestmark = pytest.mark.extras

EXAMPLE = ROOT / "docs" / "examples" / "fmi"
LONG = ("--set", "referee.success.within_m=0.02", "--set", "snapshots.every_s=2", "--set", "restart={tries: 2}")


@pytest.fixture
def room(tmp_path):
    """The scenario of the page with its units on pythonfmu3, a fan in C of FMI 2, and a crane on pythonfmu."""
    crane_fmu = pytest.importorskip("crane_fmu.mobile_crane", reason="needs pip install crane-fmu")
    from component_model.model import Model
    from pythonfmu3.builder import FmuBuilder

    folder = tmp_path / "room"
    shutil.copytree(EXAMPLE, folder)
    for script in folder.glob("*.py"):
        FmuBuilder.build_FMU(script, dest=folder, canGetAndSetFMUState=True, canSerializeFMUState=True)
    build_fan(folder, 2)
    crane = Path(crane_fmu.__file__)
    Model.build(str(crane), project_files=[crane.parent], dest=folder)
    text = yaml.safe_load((folder / "ventilated_room.yaml").read_text())
    reading = {"port": "agents/beetle/observation", "inputs": {"gas_ppm": "readings[sensor=nose].values[0]"}}
    other = {"name": "other_fan", "start": {"fmu": "fan.fmu"}, "reads": [reading], "writes": ["state", "source_1"]}
    # Its share is the rate of a second source.
    text["gas"]["sources"].append({"position_m": [1.5, 4, 1], "filaments_per_s": 5})
    rate = {"source_1": {"filaments_per_s": "share"}}
    lift = {"port": "truth/bodies", "inputs": {"der(boom.boom[0])": "bodies[0].velocity_world_m_s[0]"}}
    text["participants"] += [
        {**other, "outputs": {"state": {"share": "share", "n_steps": "n_steps"}, **rate}},
        {
            "name": "crane",
            "start": {"fmu": "MobileCrane.fmu"},
            "reads": [lift],
            "writes": ["state"],
            "outputs": {"state": {"force": "force[2]", "x": "boom.end[0]"}},
            "period_s": 0.5,
        },
    ]
    (folder / "ventilated_room.yaml").write_text(yaml.safe_dump(text))
    return folder / "ventilated_room.yaml"


def test_units_of_four_makers_have_one_digest_however_they_are_hosted_killed_and_replayed(room, tmp_path, capsys):
    here = fly_here(room, tmp_path / "here", *LONG)
    assert here.result["faults"] == [], here.errors
    # The fan's controller throttles the leak.
    assert here.result["events"][0]["text"] == "source 0 releases 10 filaments/s"
    assert "source 0 releases 4 filaments/s" in {event["text"] for event in here.result["events"]}
    ports = json.loads((here.run_dir / "digest.json").read_text())["ports"]
    units = ("fan", "battery", "other_fan", "crane")
    assert {ports[f"participant/{name}/state"]["participant"] for name in units} == {*units}
    assert ports["truth/sources/1"]["participant"] == "other_fan"
    flight = start(room, tmp_path / "many", *LONG)
    pid = flight.child("gslcosim_services fan")
    flight.wait_for(lambda: any((tmp_path / "many").glob("*/snapshots/000000020/fan.snap")))
    os.kill(pid, signal.SIGKILL)
    many = flight.end()
    assert here.result["digest"] == many.result["digest"] is not None, many.errors
    assert [restart["process"] for restart in many.result["restarts"]] == ["fan"]
    assert main(["replay", str(many.run_dir), "--from", "4", "--runs-dir", str(tmp_path / "again")]) == 0
    assert "the snapshot of tick 40" in capsys.readouterr().out
    # Its past is compared with that of the run.
    fork = forked(many.run_dir, tmp_path / "fork", 5)
    assert_same(many, fork)
    assert fork.result["fork_of"]["snapshot_tick"] == 40
    other = forked(many.run_dir, tmp_path / "other", 5, "--agent", "casting")
    assert other.result["fork_of"]["divergence"] is None
    assert other.result["digest"] != many.result["digest"]


@pytest.mark.skipif(platform.system() != "Linux" or platform.machine() != "x86_64", reason="its FMUs are for these")
def test_fmus_of_openmodelica_on_the_page_open_a_leak_and_drive_a_fan(tmp_path):
    shutil.copy(EXAMPLE / "leaking_room.yaml", tmp_path)
    (install,) = re.findall(r"^pip install --no-deps.*$", (ROOT / "docs" / "fmi.md").read_text(), re.MULTILINE)
    call = [sys.executable, "-m", "pip", "--quiet", *install.split()[1:]]
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        pytest.skip(f"pip could not install the package with FMUs: {done.stderr.strip()[-200:]}")
    scenario = tmp_path / "leaking_room.yaml"
    assert main(["validate", str(scenario)]) == 0
    blows = "{participant: fan, value: state.share, above: 1.2}"
    sticks = f"events=[{{what: sensor_sticks, agent: beetle, sensor: nose, when: {blows}}}]"
    ended = fly_here(scenario, tmp_path / "runs", "--set", "referee.stop.time_limit_s=5", "--set", sticks)
    assert ended.result["faults"] == [], ended.errors
    assert [event["what"] for event in ended.result["events"]] == ["sensor_sticks"], "the fan follows the gas"
    ports = json.loads((ended.run_dir / "digest.json").read_text())["ports"]
    assert ports["truth/sources/0"]["participant"] == "leak"


def test_a_unit_that_crashes_ends_the_run_by_its_name(tmp_path):
    folder = tmp_path / "room"
    shutil.copytree(EXAMPLE, folder)
    build_fan(folder, 3, name="FanController.fmu")
    scenario = folder / "ventilated_room.yaml"
    text = yaml.safe_load(scenario.read_text())
    fan = text["participants"][0]
    fan |= {"environment": {"UNIT_FAULT": "fmi3DoStep:crash"}}
    fan["outputs"]["state"] = {"is_on": "is_in_gas"}
    scenario.write_text(yaml.safe_dump({**text, "participants": [fan]}))
    ended = fly_here(scenario, tmp_path / "runs")
    assert ended.exit_code == 3
    (fault,) = ended.result["faults"]
    assert fault["participant"] == "fan"
    assert fault["text"].startswith(
        "expected the outputs of tick 1 from fmi3DoStep, but its process was killed by SIGABRT."
    )
