"""The command line over a real flight in this process."""

import hashlib
import json

import pytest

from gslcosim.cli.main import main
from gslcosim.runtime.run_dir import LOCK_FILE, compare_with_lock, installed_versions, versions_hash

pytestmark = pytest.mark.slow

FLY = ["up", "tiny_room", "--in-process", "--json"]


@pytest.fixture
def fly(tmp_path, capsys):
    """Fly the tiny room with further options and return the exit code and the result."""

    def run(*options):
        exit_code = main([*FLY, "--runs-dir", str(tmp_path), *options])
        return exit_code, json.loads(capsys.readouterr().out)

    return run


@pytest.mark.tour
def test_a_run_leaves_a_folder_that_the_other_commands_find(fly, tmp_path, capsys):
    results = [fly("--seed", seed)[1] for seed in ("3", "3", "4")]
    ids = [result["run_id"] for result in results]
    assert all(result["valid"] for result in results)
    assert main(["compare", ids[0], ids[1], "--runs-dir", str(tmp_path)]) == 0
    assert main(["compare", ids[0], ids[2], "--runs-dir", str(tmp_path)]) == 5
    capsys.readouterr()


def test_the_manifest_names_what_is_installed_and_the_lock_file(fly, tmp_path):
    _, result = fly("--set", "referee.stop.time_limit_s=1")
    manifest = json.loads((tmp_path / result["run_id"] / "manifest.json").read_text())
    versions = installed_versions()
    assert manifest["installed_sha256"] == versions_hash(versions)
    assert manifest["lock"] == compare_with_lock(versions)
    assert manifest["lock"]["sha256"] == hashlib.sha256(LOCK_FILE.read_bytes()).hexdigest()


def test_the_resolved_scenario_of_a_run_repeats_the_run(fly, tmp_path, capsys):
    _, first = fly("--set", "agents[0].vehicle.hold_s=0.3")
    saved = tmp_path / first["run_id"] / "scenario.yaml"
    assert main(["up", str(saved), *FLY[2:], "--runs-dir", str(tmp_path)]) in (0, 1)
    assert json.loads(capsys.readouterr().out)["digest"] == first["digest"]


def test_an_agent_that_does_not_find_the_source_returns_1(fly):
    exit_code, result = fly("--set", "referee.stop.time_limit_s=2")
    assert (exit_code, result["end_reason"], result["valid"]) == (1, "time_limit", True)


def test_a_run_from_tape_has_the_digest_of_a_live_one(fly, tmp_path, monkeypatch):
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))
    digests = {fly("--set", f"gas.tape={tape}")[1]["digest"] for tape in ("false", "true", "true")}
    assert len(digests) == 1
    assert len(list((tmp_path / "cache" / "tapes").iterdir())) == 1
