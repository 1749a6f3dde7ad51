"""What the machine refuses ends a run with exit code 3, one sentence with a remedy, and a result that says so."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from deadlines import PROCESS_S
from mounts import mounted
from real_runs import AGENTS, COMMAND, TINY_ROOM, UNRECORDED, fly, fly_command, start, with_agent

from gslcosim.runtime.processes.sandbox.selection import unavailable_reason

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits and mounts of Linux")

# In a sandbox an agent does not find the folder of its run.
UNCONFINED = ("--set", "agents[0].sandbox=none")
SHORT = ("--set", "referee.stop.time_limit_s=20", "--set", "agents[0].vehicle.hold_s=0.5")
BOTH = pytest.mark.parametrize("processes", ["separate", "one"])


def sized(n_bytes):
    """Run a command under a limit on the size of files."""
    return ("prlimit", f"--fsize={n_bytes}")


def start_option(agent, *arguments):
    """Return the override that starts a test agent with arguments."""
    command = [sys.executable, str(AGENTS / f"{agent}.py"), *map(str, arguments)]
    return "--set", f"agents[0].start={{command: {json.dumps(command)}}}"


def saved_result(ended):
    return json.loads((ended.run_dir / "result.json").read_text())


@pytest.fixture(scope="module", autouse=True)
def compiled(tmp_path_factory):
    """The room and its kernels are in the cache: what a machine refuses here, it refuses to a run, and not to them."""
    for processes in ("separate", "one"):
        folder = tmp_path_factory.mktemp("compiled")
        assert fly(TINY_ROOM, folder, "--processes", processes, is_recorded=True).exit_code == 0


@BOTH
def test_a_recording_above_the_limit_of_files_is_a_fault_of_the_recorder(tmp_path, processes):
    """The result fits below the limit, and says what happened."""
    ended = fly_command(TINY_ROOM, tmp_path, "--processes", processes, prefix=sized(200_000), is_recorded=True)
    assert ended.exit_code == 3
    result = saved_result(ended)
    assert result["valid"] is False
    assert result["end_reason"] == "simulation_fault"
    assert [fault["participant"] for fault in result["faults"]] == ["recorder"], result["faults"]
    (fault,) = result["faults"]
    assert "recording.rrd: expected to write" in fault["text"]
    assert "was file too large. Raise the limit on the size of a file (ulimit -f)" in fault["text"]
    assert "Traceback" not in ended.errors


@BOTH
def test_a_recorder_that_cannot_write_from_the_start_is_reported_at_once(tmp_path, processes):
    ended = fly_command(TINY_ROOM, tmp_path, "--processes", processes, prefix=sized(12_000), is_recorded=True)
    assert ended.exit_code == 3
    assert saved_result(ended)["faults"][0]["participant"] == "recorder"
    assert "recording.rrd: expected to write" in ended.errors


@BOTH
def test_a_disk_that_fills_in_a_run_is_reported_in_the_result_on_that_disk(tmp_path, processes):
    """Room for the result was kept."""
    with mounted(tmp_path / "small", "size=300k") as runs_dir:
        ended = fly(TINY_ROOM, runs_dir, "--processes", processes, is_recorded=True)
        assert ended.exit_code == 3
        [fault] = saved_result(ended)["faults"]
    assert fault["participant"] == "recorder"
    assert "was no space left on device. Free room there" in fault["text"]
    assert "What was written is kept, and gslcosim view shows it." in fault["text"]


@BOTH
def test_a_full_disk_is_reported_before_anything_starts(tmp_path, processes):
    with mounted(tmp_path / "full", "size=4k") as runs_dir:
        ended = fly(TINY_ROOM, runs_dir, "--processes", processes)
    assert ended.exit_code == 3
    assert "was no space left on device. Free room there" in ended.errors
    assert "Traceback" not in ended.errors


@pytest.mark.parametrize("reason", ["read-only file system", "not a directory", "file exists", "no such file"])
def test_a_runs_directory_that_cannot_be_made_is_reported(tmp_path, reason):
    """A dangling link was tried again and again."""
    place = tmp_path / "runs"
    with contextlib.ExitStack() as stack:
        if reason == "read-only file system":
            stack.enter_context(mounted(place, "ro"))
        elif reason == "not a directory":
            place.touch()
        elif reason == "file exists":
            place.symlink_to(tmp_path / "nowhere" / "at all")
        else:
            place = tmp_path.__class__("/proc/runs")
        ended = fly(TINY_ROOM, place)
    assert ended.exit_code == 3
    assert ended.errors.startswith(f"runs directory: expected a folder that can be written, was {reason}")
    assert "--runs-dir chooses another." in ended.errors


@pytest.mark.parametrize("options", ["ro", "size=20k"])
def test_a_cache_that_cannot_be_written_is_reported(tmp_path, monkeypatch, options):
    with mounted(tmp_path / "cache", options) as cache:
        monkeypatch.setenv("GSLCOSIM_CACHE", str(cache))
        ended = fly_command(TINY_ROOM, tmp_path / "runs")
    assert ended.exit_code == 3
    assert "Free room there, or set GSLCOSIM_CACHE to a folder that can be written." in ended.errors
    assert "Traceback" not in ended.errors


@pytest.mark.parametrize("sandbox", ["landlock", "bubblewrap"])
def test_a_run_needs_no_room_in_the_temporary_directory(tmp_path, monkeypatch, sandbox):
    """Bubblewrap has a private folder in memory, and agents keep nothing of what they compile."""
    if reason := unavailable_reason(sandbox):
        pytest.skip(f"{sandbox} cannot be tested here: {reason}")
    # A path too long for sockets would not be taken.
    with tempfile.TemporaryDirectory(dir="/tmp") as short, mounted(Path(short) / "full", "size=4k") as folder:
        monkeypatch.setenv("TMPDIR", str(folder))
        ended = fly_command(TINY_ROOM, tmp_path / "runs", "--set", f"agents[0].sandbox={sandbox}")
        monkeypatch.delenv("TMPDIR")
    assert ended.exit_code == 0, ended.errors


def test_a_folder_whose_name_is_no_utf_8_is_a_folder(tmp_path):
    """As with accents in another locale; Rerun opens no recording there, which is reported as such."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/d\xe9"))
    folder.mkdir()
    scenario = folder / "scenario.yaml"
    shutil.copy(TINY_ROOM, scenario)
    ended = fly(scenario, folder / "runs", is_recorded=True)
    assert ended.exit_code == 0, ended.errors
    assert ended.run_dir is not None
    call = [*COMMAND, "extract", str(ended.run_dir), "--to", "csv", "--out", str(tmp_path / "out")]
    extracted = subprocess.run(call, capture_output=True, text=True, timeout=PROCESS_S, check=False)
    assert extracted.returncode == 2
    assert extracted.stderr.startswith("recording: expected a path in UTF-8")


def test_a_working_directory_that_is_gone_is_reported(tmp_path):
    """Relative paths, such as that of the runs, came in its place."""
    call = ["sh", "-c", 'mkdir gone; cd gone; rmdir ../gone; "$@"', "sh", *COMMAND, "up", str(TINY_ROOM)]
    ended = subprocess.run(call, capture_output=True, text=True, timeout=PROCESS_S, check=False, cwd=tmp_path)
    assert ended.returncode == 2
    assert ended.stderr.startswith("working directory: expected a folder, was removed since it was entered.")


def test_without_a_temporary_directory_nothing_begins(tmp_path):
    ended = fly_command(TINY_ROOM, tmp_path, prefix=sized(0))
    assert ended.exit_code == 3
    assert "temporary directory: expected a folder that can be written" in ended.errors
    assert "or set TMPDIR to a folder that can be written." in ended.errors


@BOTH
@pytest.mark.parametrize("limit_mb", [400, 1300])
def test_too_little_memory_is_reported_as_such(tmp_path, processes, limit_mb):
    """Far below what programs need, packages hang or abort while they are loaded: nothing begins."""
    ended = fly_command(
        TINY_ROOM, tmp_path, "--processes", processes, prefix=("prlimit", f"--as={limit_mb * 1_000_000}")
    )
    if (processes, limit_mb) == ("one", 1300) and ended.exit_code != 3:
        # So much is enough for some machines; then it is enough for all of the run.
        assert ended.result["valid"] is True
        return
    assert ended.exit_code == 3
    assert "the machine: expected" in ended.errors
    assert "ulimit -v" in ended.errors
    assert "Traceback" not in ended.errors
    assert limit_mb > 1200 or not list(tmp_path.iterdir())


@pytest.mark.parametrize("n_files", [15, 18, 20, 28])
def test_too_few_open_files_are_reported_as_such(tmp_path, n_files):
    """Zenoh's runtime panics below some number, which was a traceback with the code of a failed agent."""
    ended = fly_command(TINY_ROOM, tmp_path, prefix=("prlimit", f"--nofile={n_files}"))
    assert ended.exit_code == 3
    assert "(ulimit -n)" in ended.errors
    assert "Traceback" not in ended.errors


def test_an_agent_that_takes_the_runs_folder_away_ends_the_run(tmp_path):
    runs_dir = tmp_path / "runs"
    ended = fly(TINY_ROOM, runs_dir, *SHORT, *start_option("taking_away", runs_dir), *UNCONFINED)
    assert ended.exit_code == 3
    assert "inputs.log: expected the run's folder, was gone. Something has taken it away" in ended.errors
    assert ended.result["faults"][0]["participant"] == "supervisor"
    assert ended.result["valid"] is False


def test_results_are_not_written_through_links(tmp_path):
    foreign = tmp_path / "foreign"
    foreign.write_text("kept")
    ended = fly(TINY_ROOM, tmp_path / "runs", *SHORT, *start_option("linking", tmp_path / "runs", foreign), *UNCONFINED)
    assert ended.exit_code == 1, ended.errors
    assert foreign.read_text() == "kept"
    assert saved_result(ended)["valid"] is True
    assert not (ended.run_dir / "digest.json").is_symlink()


@pytest.mark.parametrize("end", ["> /dev/full", ">&-"])
def test_a_run_whose_result_cannot_be_shown_has_it_in_its_folder(tmp_path, end):
    call = [*COMMAND, "up", str(TINY_ROOM), "--runs-dir", str(tmp_path), *UNRECORDED, "--in-process"]
    ended = subprocess.run(["sh", "-c", f'"$@" {end}', "sh", *call], capture_output=True, text=True, check=False)
    assert ended.returncode == 3
    assert "standard output: expected to take the result" in ended.stderr
    [run_dir] = tmp_path.iterdir()
    assert json.loads((run_dir / "result.json").read_text())["valid"] is True


def test_what_a_killed_supervisor_has_left_is_removed_by_the_next_run(tmp_path, monkeypatch):
    # Sockets would go elsewhere where the name is long.
    scratch = Path(tempfile.mkdtemp(prefix="gsl-test-", dir="/tmp"))
    monkeypatch.setenv("TMPDIR", str(scratch))
    long = ("--set", "referee.stop.time_limit_s=3000", "--set", "agents[0].vehicle.hold_s=0.5")
    flight = start(TINY_ROOM, tmp_path / "killed", *long, *with_agent("silent_after_one"))
    flight.wait_until_flying()
    flight.process.kill()
    flight.process.communicate()
    left = list(scratch.glob("gslcosim-*"))
    assert left
    windows = list(scratch.glob(".gslcosim-flights-*/*"))
    fly_command(TINY_ROOM, tmp_path / "next", *SHORT)
    assert not any(path.exists() for path in [*left, *windows])
    shutil.rmtree(scratch)


def test_a_suite_whose_recordings_do_not_fit_reports_it(tmp_path):
    """It came with another digest."""
    with mounted(tmp_path / "small", "size=700k") as place:
        call = [*COMMAND, "bench", "run", "smoke", "--jobs", "1", "--results", str(place / "results")]
        ended = subprocess.run(call, capture_output=True, text=True, timeout=PROCESS_S, check=False)
    assert ended.returncode == 3
    assert "expected to be made, was ended by recorder: recording.rrd: expected to write" in ended.stderr
    assert "was no space left on device. Free room there" in ended.stderr


@pytest.mark.parametrize(
    "words",
    [
        ["environment", "generate", "tiny_room", "--out", "{place}/room"],
        ["environment", "export", "tiny_room", "--to", "vtk", "--out", "{place}/vtk"],
        ["schema", "export", "{place}/contract"],
        ["bench", "run", "smoke", "--results", "{place}/results"],
    ],
    ids=lambda words: words[0],
)
def test_every_command_reports_a_full_disk(tmp_path, words):
    with mounted(tmp_path / "full", "size=4k") as place:
        (place / "filling").write_bytes(bytes(4096))
        call = [*COMMAND, *(word.format(place=place) for word in words)]
        ended = subprocess.run(call, capture_output=True, text=True, timeout=PROCESS_S, check=False)
    assert ended.returncode == 3, ended.stderr
    assert "was no space left on device. Free room there" in ended.stderr
    assert "Traceback" not in ended.stderr
