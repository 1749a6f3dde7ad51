"""Runs that are asked to end: at once after their start, by a closed terminal, and before anything was recorded."""

import os
import pty
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import PROCESS_S
from real_runs import COMMAND, STARTED, TINY_ROOM, UNRECORDED, Flight, children_of, start, wait_a_moment, with_agent

from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.runtime.run import OpenRun, RunPlan
from gslcosim.scenario import load_scenario

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="/proc says which signals are handled")

LONG = ("--set", "referee.stop.time_limit_s=3000", "--set", "agents[0].vehicle.hold_s=0.5")


def handles(pid: int, number: int) -> bool:
    """Return whether a process handles a signal by itself."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    caught = next(int(line.split()[1], 16) for line in lines if line.startswith("SigCgt:"))
    return bool(caught >> (number - 1) & 1)


@pytest.mark.parametrize("command", [("up",), ("bench", "run", "methods")], ids=lambda words: words[0])
def test_sigterm_right_after_the_start_leaves_a_word(tmp_path, command):
    """While the command is still being imported."""
    words = {"up": [str(TINY_ROOM), "--runs-dir", str(tmp_path), *LONG], "bench": ["--out", str(tmp_path)]}
    process = subprocess.Popen(
        [*COMMAND, *command, *words[command[0]]], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    while not handles(process.pid, signal.SIGTERM):
        wait_a_moment()
    started = children_of(process.pid)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=PROCESS_S)
    assert errors.strip().splitlines()[-1] == "Interrupted."
    assert process.returncode == 130
    assert not started


def test_sigterm_while_processes_start_leaves_a_result(tmp_path):
    """Whenever it comes once there is a folder of the run."""
    flight = start(TINY_ROOM, tmp_path, *LONG, *with_agent("silent_after_one"), is_recorded=True)
    flight.wait_for(lambda: any(tmp_path.glob("*/scenario.yaml")))
    flight.process.send_signal(signal.SIGTERM)
    ended = flight.end()
    assert ended.exit_code == 130
    assert ended.result["end_reason"] == "interrupted"
    assert ended.run_dir is not None
    assert all(path.stat().st_size for path in ended.run_dir.glob("recording.rrd"))


def test_a_closed_terminal_is_as_ctrl_c(tmp_path):
    """The system tells the run so, and a shell that had started it would tell it again."""
    ours, theirs = pty.openpty()
    words = ["up", str(TINY_ROOM), "--runs-dir", str(tmp_path), *LONG, *UNRECORDED, *with_agent("silent_after_one")]

    def own_terminal() -> None:
        os.setsid()
        # The first terminal that the leader of a session opens is the session's.
        os.close(os.open(os.ttyname(0), os.O_RDWR))

    process = subprocess.Popen([*COMMAND, *words], stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=own_terminal)
    os.close(theirs)
    flight = Flight(process, tmp_path)
    STARTED.append(flight)
    # Nobody reads the terminal: what is written to it has room, for the run is quiet for most of the time.
    flight.wait_until_flying()
    os.close(ours)
    process.send_signal(signal.SIGHUP)
    process.wait(PROCESS_S)
    [result] = tmp_path.glob("*/result.json")
    assert '"end_reason": "interrupted"' in result.read_text()
    assert not children_of(process.pid)


def test_a_recording_without_a_byte_is_removed(tmp_path):
    """Who interrupts before the recorder has begun keeps a result, and no file that cannot be opened."""
    loaded = load_scenario(TINY_ROOM)
    folder = prepare_environment(loaded.scenario, scenario_dir=loaded.directory)

    plan = RunPlan(
        scenario=loaded.scenario, environment_dir=folder, runs_dir=tmp_path, directory=loaded.directory,
        processes="one", began=0.0,
    )  # fmt: skip
    with OpenRun(plan, lambda _: None) as run:
        run.prepare().run_dir.recording.touch()
        raise KeyboardInterrupt
    flight = run.result
    assert run.outcome.is_interrupted
    assert flight.result["end_reason"] == "interrupted"
    assert flight.exit_code == 130
    assert not (flight.run_dir / "recording.rrd").exists()


def test_a_recording_that_cannot_be_made_whole_is_reported_though_the_run_was_interrupted(tmp_path):
    """It names the file."""
    loaded = load_scenario(TINY_ROOM)
    folder = prepare_environment(loaded.scenario, scenario_dir=loaded.directory)

    plan = RunPlan(
        scenario=loaded.scenario, environment_dir=folder, runs_dir=tmp_path, directory=loaded.directory,
        processes="one", began=0.0,
    )  # fmt: skip
    with OpenRun(plan, lambda _: None) as run:
        run.prepare().run_dir.recording.write_bytes(b"RRF2 and no more")
        raise KeyboardInterrupt
    flight = run.result
    assert flight.exit_code == 130
    [fault] = flight.result["faults"]
    assert "The recording was not made whole" in fault["text"]
    assert "recording.rrd" in fault["text"]
