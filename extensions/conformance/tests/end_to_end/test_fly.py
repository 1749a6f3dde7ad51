"""A person flies: keys of a real terminal move the vehicle, the run is like any other, the terminal is given back."""

import fcntl
import json
import os
import pty
import re
import select
import struct
import subprocess
import termios
import time

import pytest
from deadlines import EVENT_S, PROCESS_S
from real_runs import COMMAND, TINY_ROOM, UNRECORDED, assert_gone, children_of
from repeated_runs import replayed

LEFT_RIGHT_M = re.compile(rb"at \((-?[\d.]+), (-?[\d.]+), (-?[\d.]+)\) m")


class Terminal:
    """`gslcosim fly` in a terminal of its own, and what a person would see and press."""

    def __init__(self, runs_dir, *arguments, columns=100, rows=40):
        self.runs_dir = runs_dir
        self.number, inner = pty.openpty()
        fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.before = termios.tcgetattr(inner)
        self.inner = inner
        words = ["fly", str(TINY_ROOM), "--runs-dir", str(runs_dir), *UNRECORDED, *arguments]
        self.process = subprocess.Popen(
            [*COMMAND, *words], stdin=inner, stdout=inner, stderr=inner, start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )  # fmt: skip
        self.seen = b""

    def read(self, wait_s=0.1):
        if select.select([self.number], [], [], wait_s)[0]:
            self.seen += os.read(self.number, 65536)

    def wait_for(self, is_true, limit_s=EVENT_S):
        deadline = time.monotonic() + limit_s
        while not is_true():
            assert time.monotonic() < deadline, self.seen[-3000:].decode(errors="replace")
            self.read()

    def press(self, keys):
        os.write(self.number, keys)

    def shows(self, text):
        return text in self.seen

    @property
    def position_m(self):
        found = LEFT_RIGHT_M.findall(self.seen)
        return tuple(map(float, found[-1])) if found else None

    def end(self):
        """Wait for the end; return the exit code, the run and how the terminal is."""
        started = children_of(self.process.pid)
        self.wait_for(lambda: self.process.poll() is not None, PROCESS_S)
        self.read(0)
        after = termios.tcgetattr(self.inner)
        os.close(self.inner)
        os.close(self.number)
        assert_gone(started)
        runs = sorted(self.runs_dir.glob("*/"))
        return self.process.returncode, runs[-1] if runs else None, after


def result_of(run):
    return json.loads((run / "result.json").read_text())


def assert_given_back(terminal, after):
    assert after[:4] == terminal.before[:4]
    assert terminal.seen.count(b"\x1b[?1049h") == terminal.seen.count(b"\x1b[?1049l") == 1
    assert terminal.seen.count(b"\x1b[?25h") == 1


@pytest.mark.tour
def test_keys_move_the_vehicle_and_the_run_replays(tmp_path):
    """Three steps to the left lead to the source, as the log says too; a person's run repeats to the bit."""
    terminal = Terminal(tmp_path / "past", "--pace", "4", "--processes", "one", "--name", "alice")
    terminal.wait_for(lambda: terminal.position_m is not None and terminal.position_m[2] > 0.8)
    terminal.press(b"a\x1b[D")
    terminal.wait_for(lambda: terminal.position_m[0] < 3)
    terminal.press(b"as")
    exit_code, run, after = terminal.end()
    assert exit_code == 0, terminal.seen[-2000:]
    assert terminal.shows(b"The source was found")
    assert terminal.shows(b"nose")
    assert terminal.shows("█".encode())
    assert_given_back(terminal, after)
    commands = [json.loads(line) for line in (run / "inputs.log").read_text().splitlines()]
    steps = [command["position_world_m"] for command in commands if command["kind"] == "waypoint"]
    # Keys that come within one tick are one waypoint.
    assert 2 <= len(steps) <= 4
    assert steps[-1][0] == pytest.approx(1.5, abs=0.2)
    assert result_of(run)["agents"][0]["steps"] == len(steps)
    again = replayed(run, tmp_path / "again")
    assert (again.exit_code, again.result["digest"]) == (0, result_of(run)["digest"])


def test_a_person_is_waited_for_when_asked_and_may_give_up(tmp_path):
    terminal = Terminal(tmp_path, "--asked", "--processes", "one")
    terminal.wait_for(lambda: terminal.shows(b"YOU ARE ASKED"))
    terminal.press(b"d")
    terminal.wait_for(lambda: terminal.position_m[0] > 5.4)
    terminal.press(b"q")
    terminal.wait_for(lambda: terminal.shows(b"Press q again"))
    terminal.press(b"q")
    exit_code, run, after = terminal.end()
    assert exit_code == 1
    assert result_of(run)["end_reason"] == "agent_failed"
    assert_given_back(terminal, after)


def test_ctrl_c_ends_in_order(tmp_path):
    terminal = Terminal(tmp_path, "--processes", "grouped")
    terminal.wait_for(lambda: terminal.position_m is not None)
    terminal.press(b"\x03")
    exit_code, run, after = terminal.end()
    assert exit_code == 130
    assert result_of(run)["end_reason"] == "interrupted"
    assert_given_back(terminal, after)


def test_a_terminal_that_is_too_small_is_one_sentence(tmp_path):
    terminal = Terminal(tmp_path, columns=60, rows=20)
    exit_code, run, _ = terminal.end()
    assert (exit_code, run) == (2, None)
    assert terminal.seen.decode().strip() == (
        "fly: expected a terminal of at least 72 columns and 22 rows, was 60 x 20. Enlarge it, or take a smaller font."
    )
