"""The framework without any of gslcosim's own services: a run whose every service another package brings."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent / "outside_package"
NAMES = ("world", "fields", "sensing", "referee")
BLOCKS = f"services=[{', '.join(f'{{name: {name}}}' for name in NAMES)}]"
AGENT = f"agents[0].start={{python: {PACKAGE / 'rail_agent.py'}}}"
OFF = "recording.enabled=false"


def run_scenario(folder, *words):
    folder.mkdir()
    paths = os.pathsep.join([str(PACKAGE), *filter(None, [os.environ.get("PYTHONPATH")])])
    call = [
        sys.executable,
        "-m",
        "gslcosim",
        "up",
        "tiny_room",
        "--json",
        "--set",
        BLOCKS,
        "--set",
        OFF,
        "--set",
        AGENT,
        *words,
    ]
    done = subprocess.run(call, capture_output=True, text=True, cwd=folder, env=os.environ | {"PYTHONPATH": paths})
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = folder.glob("runs/*")
    return json.loads(done.stdout), run


@pytest.mark.end_to_end
def test_a_run_whose_every_service_is_of_another_package_has_one_digest_in_all_deployments(tmp_path):
    one, _ = run_scenario(tmp_path / "one", "--in-process")
    many, run = run_scenario(tmp_path / "many")
    assert one["digest"] == many["digest"] is not None
    assert one["end_reason"] == "success"
    assert one["ticks"] == 60
    assert {port["participant"] for port in json.loads((run / "digest.json").read_text())["ports"].values()} == {
        *NAMES,
        "agent_beetle",
    }


@pytest.mark.end_to_end
def test_no_core_of_gslcosims_own_is_loaded_for_it(tmp_path):
    _, run = run_scenario(tmp_path / "one", "--in-process")
    assert (run / "services.txt").read_text() == " ".join(NAMES)
    for name in NAMES:
        assert (run / f"loaded_by_{name}.txt").read_text() == ""
