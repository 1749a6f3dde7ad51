"""Models of one's own as programs: one digest wherever they are hosted, and each of their faults by name."""

import hashlib
import json
import shutil
import subprocess
import sys

import pytest
from real_runs import SHARED, TINY_ROOM, fly, fly_here

from gslcosim.cli.main import main
from gslcosim_conformance.scaffold import PARTICIPANT_TEMPLATES

PROGRAM = SHARED / "foreign_program.py"
SHORT = ("--set", "referee.stop.time_limit_s=2", "--set", "referee.success.within_m=0.01")
FAULT = 3


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """The scenario of the page with its program, compiled."""
    if shutil.which("cc") is None:
        pytest.skip("needs a C compiler: apt-get install gcc")
    folder = tmp_path_factory.mktemp("room")
    for file in PARTICIPANT_TEMPLATES.iterdir():
        if file.is_file():
            shutil.copy(file, folder)
    build = ["cc", "-O2", "-Wall", "-Wextra", "-Werror", "-std=c11", "-ffp-contract=off"]
    subprocess.run([*build, "-o", "air_conditioner", "air_conditioner.c", "-lm"], cwd=folder, check=True)
    return folder / "ventilated_room.yaml"


def with_program(fault, tick=3, door="stdio", **more):
    start = {"command": [sys.executable, str(PROGRAM), fault, str(tick)], "format": "json", "door": door}
    reads, writes = [{"port": "truth/samples"}], ["state"]
    block = {"name": "model", "start": start, "reads": reads, "writes": writes, **more}
    return ("--set", f"participants=[{json.dumps(block)}]", *SHORT)


def told_fault(ended):
    """What a run says of the one fault that has ended it."""
    assert ended.exit_code == FAULT, ended.errors
    (fault,) = ended.result["faults"]
    assert fault["participant"] == "model"
    return fault["text"]


@pytest.mark.tour
@pytest.mark.debian
def test_an_air_conditioner_in_c_runs_in_both_kinds_of_hosting_with_one_digest(room, tmp_path):
    here = fly_here(room, tmp_path / "here")
    many = fly(room, tmp_path / "many")
    assert [flight.result["faults"] for flight in (here, many)] == [[], []]
    ports = json.loads((here.run_dir / "digest.json").read_text())["ports"]
    assert {name: ports[name]["participant"] for name in ("truth/wind", "participant/air_conditioner/state")} == {
        "truth/wind": "air_conditioner",
        "participant/air_conditioner/state": "air_conditioner",
    }
    assert here.result["digest"] == many.result["digest"] is not None
    assert (many.run_dir / "logs" / "participant_air_conditioner.log").exists()


@pytest.mark.debian
def test_the_same_in_rust_is_right_and_has_that_digest_in_both_kinds_of_hosting(room, tmp_path):
    if shutil.which("rustc") is None:
        pytest.skip("needs a Rust compiler: https://rustup.rs")
    folder = tmp_path / "rust"
    shutil.copytree(room.parent, folder)
    build = ["rustc", "--edition", "2021", "-O", "-D", "warnings", "-o", "air_conditioner", "air_conditioner.rs"]
    subprocess.run(build, cwd=folder, check=True)
    assert main(["participant", "check", "--", str(folder / "air_conditioner")]) == 0
    in_c = fly_here(room, tmp_path / "c")
    here = fly_here(folder / room.name, tmp_path / "here")
    many = fly(folder / room.name, tmp_path / "many")
    assert in_c.result["digest"] == here.result["digest"] == many.result["digest"] is not None
    hashes = [json.loads((run.run_dir / "manifest.json").read_text())["participants"] for run in (in_c, here, many)]
    program = hashlib.sha256((folder / "air_conditioner").read_bytes()).hexdigest()
    assert hashes[1] == hashes[2] == {"air_conditioner": {"./air_conditioner": program}} != hashes[0]


@pytest.mark.debian
def test_the_same_in_python_and_among_grouped_services_has_that_digest_too(room, tmp_path):
    start = f"participants[0].start={{command: [{sys.executable}, ./air_conditioner.py], format: json}}"
    in_python = fly(room, tmp_path / "python", "--processes", "grouped", "--set", start)
    assert in_python.result["digest"] == fly_here(room, tmp_path / "c").result["digest"] is not None


@pytest.mark.parametrize("begin", [(), ("--from", "2")])
@pytest.mark.debian
def test_a_run_with_a_participant_is_replayed_to_the_bit_from_its_start_and_from_a_snapshot(room, tmp_path, begin):
    flown = fly_here(room, tmp_path / "flown", "--set", "snapshots.every_s=1")
    assert flown.result["ticks"] > 20, "the run ends before the snapshot"
    assert (flown.run_dir / "snapshots" / "000000020" / "air_conditioner.snap").exists()
    words = ["replay", str(flown.run_dir), "--runs-dir", str(tmp_path / "again"), *begin]
    assert main(words) == 0
    (again,) = (tmp_path / "again").glob("*/result.json")
    assert json.loads(again.read_text())["digest"] == flown.result["digest"]


def test_a_transport_and_a_longer_period_give_one_digest_here_and_in_processes(tmp_path):
    when = "{participant: model, value: state.tick, above: 7}"
    event = ("--set", f"events=[{{what: source_rate, filaments_per_s: 3, when: {when}}}]")
    words = (*with_program("right", door="unix", period_s=0.4), *event)
    here = fly_here(TINY_ROOM, tmp_path / "here", *words)
    ports = json.loads((here.run_dir / "digest.json").read_text())["ports"]
    assert ports["participant/model/state"]["ticks"] == [0, 4, 8, 12, 16, 20]
    # The value of tick 8 counts in the tick after it.
    assert [event["tick"] for event in here.result["events"]] == [9]
    assert fly(TINY_ROOM, tmp_path / "many", *words).result["digest"] == here.result["digest"]


@pytest.mark.parametrize("hosting", [fly_here, fly])
def test_a_fault_ends_the_run_with_its_name_wherever_it_is_hosted(tmp_path, hosting):
    text = told_fault(hosting(TINY_ROOM, tmp_path, *with_program("exits")))
    assert text.startswith(
        "expected an answer to the inputs of tick 3, but its process ended with exit code 7. The end of its log:\n"
        "the model has blown up"
    )


def test_its_limits_hold(tmp_path):
    ended = fly_here(TINY_ROOM, tmp_path, *with_program("memory", limits={"memory_mb": 200}))
    assert "used more than its limits.memory_mb of 200 MB" in told_fault(ended)
