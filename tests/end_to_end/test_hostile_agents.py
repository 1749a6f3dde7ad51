"""Floods and payloads of a hundred megabytes, through both transports: the run goes on and memory stays bounded."""

import json
import sys
import threading
from pathlib import Path

import pytest
from real_runs import AGENTS, TINY_ROOM, start, wait_a_moment


def through_gateway(what, frame_format):
    command = [sys.executable, str(AGENTS / "framed_wrong.py"), what, frame_format]
    return {"command": command, "door": "stdio", "format": frame_format}


def over_zenoh(what):
    return {"command": [sys.executable, str(AGENTS / "flood_over_zenoh.py"), what]}


@pytest.fixture(scope="module")
def quiet_mb(tmp_path_factory):
    return peak_memory_mb(tmp_path_factory.mktemp("quiet"), through_gateway("hold", "json"))[0]


# Zenoh puts a message together before anybody can look at its length, two at a time.
@pytest.mark.parametrize(
    ("start_by", "allowed_mb", "expected"),
    [
        (through_gateway("flood", "msgpack"), 50, "Command: tick: "),
        (through_gateway("huge", "json"), 50, "expected a line of at most 1048576 bytes"),
        (over_zenoh("small"), 100, "Command: tick: "),
        (over_zenoh("large"), 500, "expected at most 1048576 bytes, was 100000000"),
    ],
    ids=["flood in msgpack", "100 MB in JSON", "flood over Zenoh", "100 MB over Zenoh"],
)
def test_memory_stays_bounded_whatever_an_agent_sends(tmp_path, quiet_mb, start_by, allowed_mb, expected):
    """The referee ends the run as always, and the fault is the agent's."""
    peak_mb, faults = peak_memory_mb(tmp_path, start_by)
    assert peak_mb - quiet_mb < allowed_mb
    assert faults[0]["participant"] == "agent beetle"
    assert expected in faults[0]["text"]


def peak_memory_mb(runs_dir, start_by):
    """Fly and return the most memory that the supervisor's process has held [MB], and the faults."""
    change = ("--set", f"agents[0].start={json.dumps(start_by)}", "--set", "referee.stop.time_limit_s=8")
    flight = start(TINY_ROOM, runs_dir, *change)
    peaks_kb = [0]

    def watch():
        status = Path(f"/proc/{flight.process.pid}/status")
        while flight.process.poll() is None:
            try:
                lines = [line for line in status.read_text().splitlines() if line.startswith("VmHWM")]
            except OSError:  # it has ended since: no such file, or no such process while the file is open
                return
            peaks_kb.extend(int(line.split()[1]) for line in lines)
            wait_a_moment()

    watching = threading.Thread(target=watch)
    watching.start()
    ended = flight.end()
    watching.join()
    assert ended.result["valid"] is True, ended.errors
    assert ended.result["end_reason"] == "time_limit"
    return max(peaks_kb) / 1000, ended.result["faults"]
