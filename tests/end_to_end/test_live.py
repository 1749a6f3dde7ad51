"""A run is shown while it goes on, whole, and flies as it does when nobody looks."""

import os
import re
import signal
import subprocess
import urllib.parse
import urllib.request
from pathlib import Path

import pytest
from deadlines import EVENT_S, PROCESS_S
from real_runs import (
    COMMAND,
    ROOT,
    TINY_ROOM,
    UNRECORDED,
    Flight,
    assert_gone,
    children_of,
    fly,
    is_running,
    start,
    wait_a_moment,
)

from gslcosim_services.recorder.rerun_cli import rerun_environment, rerun_program, run_rerun

LONG = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=20000")
A_MINUTE = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=60")


class Said:
    """What a run says on standard error, line by line as it comes."""

    def __init__(self, flight):
        self._errors = flight.process.stderr
        self.text = ""

    def until(self, pattern):
        """Read on until a line matches, and return the match."""
        for line in self._errors:
            self.text += line
            if found := re.search(pattern, line):
                return found
        raise AssertionError(f"{pattern!r} never came: {self.text}")


def ended(flight, said):
    """Return exit code and the rest of what was said, once the run has ended and left no process."""
    started = children_of(flight.process.pid)
    with flight.process as process:
        process.stdout.read()
        said.text += process.stderr.read()
        process.wait(PROCESS_S)
    assert_gone(started)
    return flight.process.returncode


def rows_of(recording):
    """Return the number of chunks and rows of a recording; nothing of it is cut off."""
    output = run_rerun(["rrd", "stats", recording], timeout_s=EVENT_S).stdout
    numbers = {
        name: int(value.replace(" ", "").replace("\u2009", ""))
        for name, value in re.findall(r"(num_chunks|num_rows) = ([\d \u2009]+)\n", output)
    }
    return numbers.get("num_chunks", 0), numbers.get("num_rows", 0)


def viewer_of(flight):
    """Return the process of the viewer beside a run."""
    found = [pid for pid in children_of(flight.process.pid) if is_viewer(pid)]
    assert len(found) == 1, found
    return found[0]


def is_viewer(pid):
    try:
        return Path(f"/proc/{pid}/exe").readlink() == rerun_program()
    except OSError:
        return False


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The digests of the minute's run that nobody looks at."""
    ended = fly(TINY_ROOM, tmp_path_factory.mktemp("alone"), *A_MINUTE, is_recorded=True)
    return (ended.run_dir / "digest.json").read_bytes()


def test_a_browser_that_comes_late_gets_all_of_the_recording(tmp_path, alone):
    flight = start(TINY_ROOM, tmp_path / "runs", "--serve", *A_MINUTE, is_recorded=True, is_fresh=True)
    said = Said(flight)
    page, query = said.until(r"Watch it at (http://127\.0\.0\.1:\d+)\?url=(\S+)").groups()
    said.until("stays open until Ctrl-C")
    (run_dir,) = (tmp_path / "runs").glob("*/")
    with urllib.request.urlopen(page, timeout=EVENT_S) as answer:
        assert b"<html" in answer.read().lower()
    late = tmp_path / "late.rrd"
    address = urllib.parse.unquote(query)
    call = [str(rerun_program()), "--bind", "127.0.0.1", "--port", "auto", address, "--save", str(late)]
    visitor = subprocess.Popen(call, env=rerun_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        expected = rows_of(run_dir / "recording.rrd")
        assert expected[1] > 1000
        flight.wait_for(lambda: late.exists() and rows_of(late) == expected)
    finally:
        visitor.kill()
        visitor.wait()
    flight.process.send_signal(signal.SIGINT)
    assert ended(flight, said) == 1, "the time was up, which is the flight's exit code"
    assert (run_dir / "digest.json").read_bytes() == alone


def test_a_recording_is_served_afterwards(tmp_path):
    flown = fly(TINY_ROOM, tmp_path / "runs", is_recorded=True)
    call = [*COMMAND, "view", str(flown.run_dir), "--web"]
    server = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    flight = Flight(server, tmp_path)
    said = Said(flight)
    try:
        page = said.until(r"Watch it at (http://127\.0\.0\.1:\d+)")[1]
        with urllib.request.urlopen(page, timeout=EVENT_S) as answer:
            assert answer.status == 200
        said.until("stays open until Ctrl-C")
        server.send_signal(signal.SIGINT)
        assert ended(flight, said) == 0
    finally:
        # Its viewer ends with it.
        server.kill()


def test_the_page_names_commands_that_work(tmp_path, monkeypatch):
    """What the page's commands start is served, seen, listed and stopped; windows need a screen, which is reported."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    page = (ROOT / "docs" / "live.md").read_text()
    lines = [
        line.split("#")[0].split()
        for block in re.findall(r"```sh\n(.*?)```", page, re.DOTALL)
        for line in block.splitlines()
    ]
    flight = None
    for line in lines:
        words = [str(next(Path("runs").iterdir())) if word == "RUN" else word for word in line[1:]]
        if {"--serve", "--web"} & set(words):
            served = _started(*words)
            said = Said(served)
            said.until("stays open until Ctrl-C")
            served.process.send_signal(signal.SIGINT)
            assert ended(served, said) == 0, words
        elif words[0] in ("up", "view"):
            assert "expected a screen, was none" in _told(*words)
        else:
            if flight is None:
                flight = _started("up", str(TINY_ROOM), *LONG, *UNRECORDED, "--pace", "1")
                flight.wait_for(lambda: "flying" in _told("runs", "active"))
            output = _told(*words, *(("--once",) if words[:2] == ["runs", "top"] else ()))
            assert "tiny_room" in output, words
    assert flight is not None
    # The last of the commands has stopped it.
    assert words == ["runs", "stop"]
    flight.process.communicate(timeout=PROCESS_S)
    assert flight.process.returncode == 130


def _started(*words):
    call = [*COMMAND, *words]
    return Flight(subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True), Path.cwd())


def _told(*words):
    output = subprocess.run([*COMMAND, *words], capture_output=True, text=True, timeout=EVENT_S, check=False)
    return output.stdout + output.stderr


def test_ctrl_c_in_a_run_ends_run_and_viewer(tmp_path):
    flight = start(TINY_ROOM, tmp_path / "runs", "--serve", *LONG, is_recorded=True, is_fresh=True)
    said = Said(flight)
    said.until("Watch it at")
    flight.process.send_signal(signal.SIGINT)
    assert ended(flight, said) == 130
    assert "stays open" not in said.text


def test_a_viewer_that_is_killed_changes_nothing(tmp_path, alone):
    flight = start(TINY_ROOM, tmp_path / "runs", "--serve", *A_MINUTE, is_recorded=True, is_fresh=True)
    said = Said(flight)
    said.until("Watch it at")
    os.kill(viewer_of(flight), signal.SIGKILL)
    assert ended(flight, said) == 1
    assert "viewer: expected to end with 0, it ended with -9" in said.text
    (run_dir,) = (tmp_path / "runs").glob("*/")
    assert (run_dir / "digest.json").read_bytes() == alone


def test_a_viewer_ends_with_a_command_that_is_killed(tmp_path):
    flight = start(TINY_ROOM, tmp_path / "runs", "--serve", *LONG, is_recorded=True, is_fresh=True)
    Said(flight).until("Watch it at")
    viewer = viewer_of(flight)
    flight.process.kill()
    flight.process.communicate()
    while is_running(viewer):
        wait_a_moment()


def test_two_runs_are_served_at_once(tmp_path):
    pages = set()
    words = ("--serve", "--in-process", *A_MINUTE)
    flights = [start(TINY_ROOM, tmp_path / f"{i}", *words, is_recorded=True, is_fresh=True) for i in range(2)]
    for flight in flights:
        said = Said(flight)
        pages.add(said.until(r"Watch it at (\S+)")[1])
        said.until("stays open until Ctrl-C")
        flight.process.send_signal(signal.SIGINT)
        assert ended(flight, said) == 1
    assert len(pages) == 2


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--live",), "expected a screen, was none"),
        (("--serve", "--set", "recording.enabled=false"), "expected recording.enabled to be true, was false"),
        (("--live", "--serve"), "not allowed with argument"),
    ],
)
def test_what_cannot_be_shown_is_reported_before_anything_runs(tmp_path, monkeypatch, arguments, expected):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    flown = fly(TINY_ROOM, tmp_path / "runs", *arguments, is_recorded=True)
    assert flown.exit_code == 2
    assert expected in flown.errors
    assert not (tmp_path / "runs").exists()
