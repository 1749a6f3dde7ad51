"""Runs that go on are listed, looked at and stopped from another shell, and are the same whether or not."""

import contextlib
import io
import json
import os
import signal
import subprocess
import tempfile
from pathlib import Path

import pytest
from deadlines import EVENT_S
from real_runs import COMMAND, TINY_ROOM, fly, start, wait_a_moment, with_agent

from gslcosim.cli.main import main

LONG = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=20000")
SERVICES = ["world", "fields", "sensing", "referee"]


def call(*words):
    """Call a command in this process; return its exit code, what it printed, and what it said on standard error."""
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        exit_code = main(words)
    return exit_code, output.getvalue(), errors.getvalue()


@pytest.fixture(autouse=True)
def windows(monkeypatch, tmp_path_factory):
    """Runs of other tests have their windows elsewhere; a router's socket needs a folder with a short name."""
    # Pytest's own temporary files stay where they are.
    tmp_path_factory.getbasetemp()
    with tempfile.TemporaryDirectory(prefix="seen-") as folder:
        put_temporary_files_into(Path(folder), monkeypatch)
        yield Path(folder)


def put_temporary_files_into(folder, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr("tempfile.tempdir", None)


def listed():
    return json.loads(call("runs", "active", "--json")[1])


def started(tmp_path, *arguments):
    """Start a run that goes on until it is stopped, and wait until it flies."""
    flight = start(TINY_ROOM, tmp_path / "runs", *LONG, *arguments)
    flight.wait_for(lambda: any(facts["sim_time_s"] > 0 for facts in listed()))
    return flight


@pytest.mark.parametrize("processes", ["separate", pytest.param("grouped", marks=pytest.mark.tour), "one"])
def test_a_run_is_listed_looked_at_and_stopped(tmp_path, processes):
    flight = started(tmp_path, "--processes", processes)
    (facts,) = listed()
    assert facts["scenario"] == "tiny_room"
    assert facts["processes"] == processes
    assert facts["pid"] == flight.process.pid
    assert facts["time_limit_s"] == 20000
    exit_code, output, _ = call("runs", "top", "--once", "--json", "--every", "0.5")
    assert exit_code == 0
    rows = json.loads(output)["participants"]
    assert [row["name"] for row in rows[:4]] == SERVICES
    for row in rows[:4]:
        assert row["tick_rate_hz"] > 0
        assert row["busy"] > 0
        assert row["memory_bytes"] > 1e6
        assert (row["pid"] == flight.process.pid) == (processes == "one")
        assert row["state"] in ("working", "waiting")
    assert rows[4]["tick_rate_hz"] > 0, "the agent's door"
    assert call("runs", "active")[1].splitlines()[1].startswith(facts["run_id"])
    assert call("runs", "stop", facts["run_id"][:12]) == (0, f"stopped    {facts['run_dir']}\n", "")
    ended = flight.end()
    assert ended.exit_code == 130
    assert ended.result["end_reason"] == "interrupted"
    assert listed() == []


def test_a_run_is_seen_where_the_temporary_directory_has_a_long_name(tmp_path, monkeypatch):
    """Its window's path is longer than the address of a unix socket may be."""
    folder = tmp_path / ("t" * 120)
    folder.mkdir()
    put_temporary_files_into(folder, monkeypatch)
    flight = started(tmp_path, "--processes", "one")
    assert call("runs", "stop")[0] == 0
    assert flight.end().exit_code == 130


def test_being_looked_at_changes_nothing(tmp_path):
    """A hundred looks while it flies: the digest of a run that nobody saw."""
    limit = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=60")
    alone = fly(TINY_ROOM, tmp_path / "alone", *limit)
    flight = start(TINY_ROOM, tmp_path / "seen", *limit)
    n_looks = 0
    while flight.process.poll() is None:
        n_looks += len(listed())
    assert n_looks > 0
    assert flight.end().result["digest"] == alone.result["digest"]


def test_a_service_that_stands_still_is_silent_and_the_others_wait_for_it(tmp_path):
    flight = started(tmp_path)
    fields = flight.child("fields")
    os.kill(fields, signal.SIGSTOP)
    try:
        rows = {}
        while rows.get("fields", {}).get("state") != "silent":
            rows = {row["name"]: row for row in listed()[0]["participants"]}
        assert "truth/samples" in rows["sensing"]["waits_for"]
    finally:
        os.kill(fields, signal.SIGCONT)
    assert call("runs", "stop")[0] == 0
    assert flight.end().exit_code == 130


def test_an_agent_that_thinks_is_deciding(tmp_path):
    flight = start(TINY_ROOM, tmp_path / "runs", *with_agent("silent"))
    flight.wait_for(lambda: any(row["state"] == "deciding" for facts in listed() for row in facts["participants"]))
    assert call("runs", "stop")[0] == 0
    flight.end()


def test_a_run_that_stands_still_is_listed_as_silent(tmp_path):
    flight = started(tmp_path, "--processes", "one")
    os.kill(flight.process.pid, signal.SIGSTOP)
    try:
        (facts,) = listed()
        assert (facts["state"], facts["pid"]) == ("silent", flight.process.pid)
        assert call("runs", "active")[0] == 0
    finally:
        os.kill(flight.process.pid, signal.SIGCONT)
    assert call("runs", "stop", "--all")[0] == 0
    assert flight.end().exit_code == 130


def test_the_window_of_a_killed_run_is_removed(tmp_path, windows):
    flight = started(tmp_path, "--processes", "one")
    flight.process.kill()
    flight.process.wait()
    assert list(windows.glob(".gslcosim-flights-*/*"))
    assert listed() == []
    assert not list(windows.glob(".gslcosim-flights-*/*"))


def test_which_of_several_runs_is_meant_has_to_be_said(tmp_path):
    first, second = started(tmp_path / "a"), started(tmp_path / "b")
    while len(listed()) < 2:
        wait_a_moment()
    exit_code, _, errors = call("runs", "stop")
    assert exit_code == 2
    assert errors.startswith("Several runs are active, name one of them: tiny_room-")
    assert call("runs", "stop", str(next((tmp_path / "a" / "runs").iterdir())))[0] == 0
    assert first.end().exit_code == 130
    assert call("runs", "stop", "--all")[0] == 0
    assert second.end().exit_code == 130


def test_the_page_of_top_shows_the_end(tmp_path):
    flight = started(tmp_path)
    top = subprocess.Popen([*COMMAND, "runs", "top", "--every", "0.1"], stdout=subprocess.PIPE, text=True)
    assert top.stdout is not None
    while "sensing" not in (line := top.stdout.readline()):
        assert line or top.poll() is None
    assert call("runs", "stop")[0] == 0
    rest, _ = top.communicate(timeout=EVENT_S)
    assert "has ended." in rest
    assert top.returncode == 0
    flight.end()


def test_a_folder_of_somebody_else_is_no_place_for_windows(tmp_path, windows):
    """Whoever may write there could stand in for a run; the run itself goes on without a window."""
    folder = windows / f".gslcosim-flights-{os.getuid()}"
    folder.mkdir(mode=0o777)
    folder.chmod(0o777)
    ended = fly(TINY_ROOM, tmp_path / "runs")
    assert ended.exit_code == 0
    assert list(folder.iterdir()) == []


def test_without_runs_there_is_nothing_to_show():
    assert call("runs", "active") == (0, "No run is active.\n", "")
    assert call("runs", "active", "--json") == (0, "[]\n", "")
    assert call("runs", "stop", "--all") == (0, "No run is active.\n", "")
    assert call("runs", "top")[0] == 2
    assert call("runs", "stop", "nobody")[2] == "No single active run has the id or folder nobody; active runs: none.\n"
    assert call("runs", "top", "--every", "never")[0] == 2
    assert call("runs", "stop", "x", "--all")[0] == 2
