"""Whatever fails is named, the exit code says whose fault it was, and nothing is left running."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from deadlines import EVENT_S
from real_runs import AGENTS, COMMAND, STARTED, TINY_ROOM, Flight, fly, is_running, start, wait_a_moment, with_agent

from gslcosim.runtime.processes.stop_detection import can_detect_stops
from gslcosim.runtime.status import list_active_runs
from gslcosim_services.recorder.rerun_cli import run_rerun

linux = pytest.mark.skipif(not can_detect_stops(), reason="only Linux tells which processes are stopped")

# Its sensing stops itself before it joins: a signal from here may come too late.
HALTING = Path(__file__).parent / "halting_package"
# A run long enough to be interrupted: the vehicle only ever holds.
LONG = ("--set", "referee.stop.time_limit_s=3000", "--set", "agents[0].vehicle.hold_s=0.5")
HOLDING = (*with_agent("holding"), "--set", "referee.stop.time_limit_s=100")


def long_flight(tmp_path, agent="silent_after_one"):
    flight = start(TINY_ROOM, tmp_path, *LONG, *with_agent(agent), is_recorded=True)
    flight.wait_until_flying()
    flight.wait_for(lambda: any(path.stat().st_size for path in tmp_path.glob("*/recording.rrd")))
    return flight


@pytest.mark.parametrize(
    "name", ["fields", "recorder", *(pytest.param(n, marks=pytest.mark.soak) for n in ("world", "sensing", "referee"))]
)
def test_a_killed_service_ends_the_run_by_name(tmp_path, name):
    """With exit code 3, and the recording can still be read."""
    flight = long_flight(tmp_path)
    os.kill(flight.child(f"gslcosim_services {name}"), signal.SIGKILL)
    ended = flight.end()
    assert ended.exit_code == 3
    assert ended.result["valid"] is False
    assert ended.result["faults"][0]["participant"] == name
    assert "SIGKILL" in ended.result["faults"][0]["text"]
    assert_recording_is_whole(ended.run_dir)


@pytest.mark.skipif(sys.platform != "linux", reason="services are forked on Linux only")
def test_a_killed_fork_server_is_named_and_leaves_nothing(tmp_path):
    """The services end with it, so the run cannot go on."""
    flight = long_flight(tmp_path)
    services = [flight.child(f"gslcosim_services {name}") for name in ("world", "recorder")]
    os.kill(flight.child("gslcosim_services --fork-server"), signal.SIGKILL)
    ended = flight.end()
    assert ended.exit_code == 3
    assert ended.result["faults"][0]["participant"] == "fork_server"
    assert not any(is_running(pid) for pid in services)


@linux
def test_a_fork_server_that_is_killed_before_it_has_forked_is_named(tmp_path):
    """It starts before the scenario is read, so it can be gone before anybody asks it for a service."""
    flight = start(TINY_ROOM, tmp_path)
    os.kill(flight.child("gslcosim_services --fork-server"), signal.SIGKILL)
    ended = flight.end()
    assert ended.exit_code == 3
    assert ended.result["faults"][0]["participant"] == "fork_server"
    assert "SIGKILL" in ended.result["faults"][0]["text"]


@linux
@pytest.mark.parametrize("name", ["fields", "recorder", "fork_server"])
def test_a_stopped_service_is_named_and_no_other(tmp_path, name):
    """It keeps its link, and others soon wait for it: who stands still is seen by the system, not by what follows."""
    flight = long_flight(tmp_path, agent="holding")
    os.kill(flight.child("gslcosim_services " + name.replace("fork_server", "--fork-server")), signal.SIGSTOP)
    ended = flight.end()
    assert ended.exit_code == 3
    assert [fault["participant"] for fault in ended.result["faults"]] == [name]
    assert "stopped by a signal" in ended.result["faults"][0]["text"]
    assert_recording_is_whole(ended.run_dir)


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """The run that nothing stops."""
    return fly(TINY_ROOM, tmp_path_factory.mktemp("usual"), *HOLDING, is_recorded=True)


@linux
@pytest.mark.parametrize(("name", "stop_s"), [("recorder", 1.0), ("supervisor", 6.0)])
def test_who_is_continued_has_changed_nothing(tmp_path, usual, name, stop_s):
    """A service for a moment, the supervisor for as long as anybody likes: digest and exit code are as always."""
    flight = start(TINY_ROOM, tmp_path / "stopped", *HOLDING, is_recorded=True)
    flight.wait_until_flying()
    pid = flight.process.pid if name == "supervisor" else flight.child(f"gslcosim_services {name}")
    os.kill(pid, signal.SIGSTOP)
    until = time.monotonic() + stop_s
    flight.wait_for(lambda: time.monotonic() > until)
    os.kill(pid, signal.SIGCONT)
    ended = flight.end()
    assert usual.result["valid"] is True, usual.errors
    assert ended.result["digest"] == usual.result["digest"], ended.errors
    assert (ended.exit_code, ended.result["faults"]) == (usual.exit_code, [])


@linux
def test_a_service_that_is_stopped_before_it_joins_is_awaited_in_words_and_ends_the_run(tmp_path, monkeypatch):
    """The log says who is missing, and the run ends when it is sure that nothing will come."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HALTING), *filter(None, [os.environ.get("PYTHONPATH")])]))
    call = [*COMMAND, "up", str(TINY_ROOM), "--runs-dir", str(tmp_path), "--set", "services=[{name: sensing}]"]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    flight = Flight(process, tmp_path)
    STARTED.append(flight)
    ended = flight.end()
    assert ended.exit_code == 3
    assert ended.result["faults"][0]["participant"] == "sensing"
    assert "stopped by a signal" in ended.result["faults"][0]["text"]
    assert re.search(r"waiting for .*sensing.*not here after 4 s", ended.errors)


def stalled_facts(flight):
    """Wait until a run whose fields hang in tick 20 says that it stalls; return what it says."""
    found = []

    def is_told():
        found[:] = [run.facts for run in list_active_runs() if run.pid == flight.process.pid and run.facts.get("stall")]
        return bool(found)

    flight.wait_for(is_told)
    return found[0]


@pytest.mark.parametrize("processes", ["separate", "one"])
def test_a_service_that_hangs_in_its_step_is_named_with_who_waits_for_it(tmp_path, monkeypatch, processes):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HALTING), *filter(None, [os.environ.get("PYTHONPATH")])]))
    hanging = ("--set", "services=[{name: fields, hangs_at_tick: 20}]", "--processes", processes)
    flight = start(TINY_ROOM, tmp_path, *hanging)
    facts = stalled_facts(flight)
    first, culprit, *others = facts["stall"].splitlines()
    assert first.startswith("nothing has moved for ")
    assert re.fullmatch(r"fields is in its step of tick 20 for [0-9.]+ s\.", culprit)
    if processes == "one":
        flight.process.kill()
        flight.process.wait()
        return
    assert "waits at tick 20 for truth/samples of tick 20 from fields (got tick 19 last)." in "".join(others)
    ended = flight.end()
    (fault,) = ended.result["faults"]
    assert (ended.exit_code, fault["participant"], fault["tick"]) == (4, "fields", 19)
    assert "fields is in its step of tick 20 for" in fault["text"]


@linux
@pytest.mark.parametrize("door", ["zenoh", "stdio"])
def test_a_stopped_agent_is_a_result_of_a_valid_run(tmp_path, door):
    """As one that was killed."""
    command = f"{{command: [{sys.executable}, {AGENTS / 'holding.py'}], door: {door}}}"
    flight = start(TINY_ROOM, tmp_path, *LONG, "--set", f"agents[0].start={command}")
    flight.wait_until_flying()
    os.kill(flight.child("holding.py"), signal.SIGSTOP)
    ended = flight.end()
    assert ended.exit_code == 1
    assert ended.result["valid"] is True
    assert ended.result["end_reason"] == "agent_failed"
    assert "stopped by a signal" in ended.result["faults"][0]["text"]


@pytest.mark.tour
def test_a_killed_agent_is_a_result_of_a_valid_run(tmp_path):
    """The verdict says agent_failed, and the fault tells how the process ended."""
    flight = long_flight(tmp_path)
    os.kill(flight.child("silent_after_one.py"), signal.SIGKILL)
    ended = flight.end()
    assert ended.exit_code == 1
    assert ended.result["valid"] is True
    assert ended.result["end_reason"] == "agent_failed"
    assert "SIGKILL" in ended.result["faults"][0]["text"]


@pytest.mark.tour
def test_ctrl_c_stops_cleanly(tmp_path):
    """Exit code 130, a result that says so, a recording that can be read."""
    flight = long_flight(tmp_path)
    flight.process.send_signal(signal.SIGINT)
    ended = flight.end()
    assert ended.exit_code == 130
    assert ended.result["end_reason"] == "interrupted"
    assert ended.result["valid"] is False
    assert_recording_is_whole(ended.run_dir)


def test_a_killed_supervisor_takes_everything_with_it(tmp_path):
    """Even when it cannot clean up, no participant goes on."""
    flight = long_flight(tmp_path)
    pids = [flight.child(name) for name in ("gslcosim_services world", "silent_after_one.py")]
    flight.process.kill()
    flight.process.communicate()
    deadline = time.monotonic() + EVENT_S
    while any(is_running(pid) for pid in pids) and time.monotonic() < deadline:
        wait_a_moment()
    assert not any(is_running(pid) for pid in pids)


@pytest.mark.parametrize(
    ("agent", "expected"),
    [
        ("garbage", "expected a msgpack map"),
        ("not_a_number", "position_world_m.0"),
    ],
)
def test_a_wrong_agent_is_answered_and_the_run_goes_on(tmp_path, agent, expected):
    """The vehicle holds, the fault says what was expected, and the referee ends the run as always."""
    ended = fly(TINY_ROOM, tmp_path, *with_agent(agent), "--set", "referee.stop.time_limit_s=12")
    assert ended.result["valid"] is True, ended.errors
    assert ended.result["end_reason"] == "time_limit"
    assert expected in ended.result["faults"][0]["text"]
    assert ended.exit_code == 1


@pytest.mark.parametrize(("agent", "expected"), [("silent", "did not answer within 1 s"), ("crashing", "lost my way")])
def test_an_agent_that_is_no_use_fails_the_task(tmp_path, agent, expected):
    """Silence and a crash are results: agent_failed, with the reason."""
    # Python waits at its end for the threads of a session that was not closed: the crashed one is silent, too.
    limit_s = 1 if agent == "silent" else 10
    ended = fly(TINY_ROOM, tmp_path, *with_agent(agent), "--set", f"agents[0].answer_within_s={limit_s}")
    assert ended.result["valid"] is True, ended.errors
    assert ended.result["end_reason"] == "agent_failed"
    assert expected in ended.result["faults"][0]["text"]


def test_an_agent_that_cannot_start_fails_the_task(tmp_path):
    """A program that ends at once is not waited for."""
    change = ("--set", f"agents[0].start={{command: [{sys.executable}, -c, 'raise SystemExit(7)']}}")
    ended = fly(TINY_ROOM, tmp_path, *change)
    assert ended.result["end_reason"] == "agent_failed", ended.errors
    assert "exit code 7" in ended.result["faults"][0]["text"]


@pytest.mark.tour
def test_an_agent_reaches_nothing_but_its_own_keys(tmp_path):
    """Listening to everything and writing everywhere shows it nothing and changes nothing."""
    spied = fly(TINY_ROOM, tmp_path / "spied", *with_agent("spying"), "--set", "referee.stop.time_limit_s=8")
    assert spied.result["valid"] is True, spied.errors
    assert spied.result["end_reason"] == "time_limit"
    log = next((spied.run_dir / "logs").glob("agent_*.log")).read_text()
    assert "foreign: []" in log
    assert "own only: True" in log


def assert_recording_is_whole(run_dir):
    verified = run_rerun(["rrd", "verify", run_dir / "recording.rrd"], timeout_s=EVENT_S)
    assert verified.returncode == 0, verified.stderr
