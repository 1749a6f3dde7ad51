"""A stopped process is seen, given some time, and ended; anyone who looked away himself blames nobody for it."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from deadlines import EVENT_S

from gslcosim.runtime.processes.stop_detection import (
    MIN_PAUSE_S,
    STOP_POLL_PERIOD_S,
    STOP_TIMEOUT_S,
    PauseDetector,
    StopDetector,
    StopMonitor,
    can_detect_stops,
    describe_stop,
    is_stopped,
)

linux = pytest.mark.skipif(not can_detect_stops(), reason="only Linux tells which processes are stopped")
SLEEPING = [sys.executable, "-c", "import signal; signal.pause()"]


def wait_until(is_true, limit_s=EVENT_S):
    deadline = time.monotonic() + limit_s
    while not is_true():
        assert time.monotonic() < deadline, f"not within {limit_s} s"
        os.sched_yield()


@pytest.fixture
def sleeping():
    """A process that waits for signals, as a leader of its own group."""
    with subprocess.Popen(SLEEPING, start_new_session=True) as process:
        yield process
        process.kill()


def looks(stops, until_s, stopped, start_s=0.0):
    """Look four times a second; return when each name was first said to be stopped for too long."""
    reported, now_s = {}, start_s
    while now_s < until_s:
        for name in stops.look(stopped(now_s), now_s):
            reported.setdefault(name, now_s)
        now_s += STOP_POLL_PERIOD_S
    return reported


def test_who_goes_on_in_time_is_not_named():
    stopped = lambda now_s: ["world"] if now_s % 6 < 4.5 else []  # noqa: E731
    assert looks(StopDetector(), 60, stopped) == {}


def test_who_stays_stopped_is_named_after_the_limit():
    reported = looks(StopDetector(), 20, lambda now_s: ["recorder"] if now_s >= 3 else [])
    assert reported.keys() == {"recorder"}
    assert 3 + STOP_TIMEOUT_S < reported["recorder"] <= 3 + STOP_TIMEOUT_S + 2 * STOP_POLL_PERIOD_S


def test_time_in_which_nobody_looked_does_not_count():
    """The watch itself stood still for a minute: the other has its whole limit from then on."""
    stops = StopDetector()
    assert looks(stops, 2, lambda _: ["world"]) == {}
    reported = looks(stops, 80, lambda _: ["world"], start_s=62)
    assert 62 + STOP_TIMEOUT_S - 2 <= reported["world"] <= 62 + STOP_TIMEOUT_S


def test_a_pause_is_far_longer_than_a_look():
    pauses = PauseDetector()
    assert [pauses.missed_s(now_s) for now_s in (7.0, 7.1, 7.1 + 0.9 * MIN_PAUSE_S)] == [0.0, 0.0, 0.0]
    assert pauses.missed_s(60.0) == pytest.approx(60.0 - 7.1 - 0.9 * MIN_PAUSE_S)
    assert pauses.missed_s(60.1) == 0.0


@linux
def test_a_stopped_process_is_seen_and_one_that_goes_on_is_not(sleeping):
    assert not is_stopped(sleeping.pid)
    os.kill(sleeping.pid, signal.SIGSTOP)
    wait_until(lambda: is_stopped(sleeping.pid))
    os.kill(sleeping.pid, signal.SIGCONT)
    wait_until(lambda: not is_stopped(sleeping.pid))


@linux
def test_a_launcher_is_stopped_with_what_it_has_started():
    """As a sandbox that waits for its agent; with two children nobody knows which one matters."""
    program = (
        "import subprocess, sys\n"
        "for child in [subprocess.Popen(sys.argv[2:]) for _ in range(int(sys.argv[1]))]: child.wait()"
    )
    for n_children, expected in ((1, True), (2, False)):
        call = [sys.executable, "-c", program, str(n_children), *SLEEPING]
        with subprocess.Popen(call, start_new_session=True) as launcher:
            children = Path(f"/proc/{launcher.pid}/task/{launcher.pid}/children")
            wait_until(lambda file=children, n=n_children: len(file.read_text().split()) == n)
            child = int(children.read_text().split()[0])
            os.kill(child, signal.SIGSTOP)
            wait_until(lambda child=child: is_stopped(child))
            assert is_stopped(launcher.pid) is expected
            os.killpg(launcher.pid, signal.SIGKILL)


def test_a_process_that_is_gone_is_not_stopped(sleeping):
    sleeping.kill()
    sleeping.wait()
    assert not is_stopped(sleeping.pid)


@pytest.mark.slow
@linux
def test_the_watch_reports_once_and_kills(sleeping):
    reported, has_told = [], threading.Event()

    def on_stopped(name):
        reported.append(name)
        has_told.set()

    os.kill(sleeping.pid, signal.SIGSTOP)
    with StopMonitor(lambda: {"world": sleeping.pid, "not begun": 0}, on_stopped):
        assert has_told.wait(STOP_TIMEOUT_S + EVENT_S)
        assert sleeping.wait(EVENT_S) == -signal.SIGKILL
    assert reported == ["world"]
    assert "stopped by a signal" in describe_stop()


@pytest.mark.slow
@linux
def test_what_a_launcher_has_started_is_killed_with_it():
    """A child with a group of its own, which nobody told to end with its launcher."""
    program = "import subprocess, sys; subprocess.Popen(sys.argv[1:], start_new_session=True).wait()"
    has_told = threading.Event()
    with subprocess.Popen([sys.executable, "-c", program, *SLEEPING], start_new_session=True) as launcher:
        children = Path(f"/proc/{launcher.pid}/task/{launcher.pid}/children")
        wait_until(lambda: children.read_text().split())
        child = int(children.read_text())
        os.kill(child, signal.SIGSTOP)
        with StopMonitor(lambda: {"beetle": launcher.pid}, lambda _: has_told.set()):
            assert has_told.wait(STOP_TIMEOUT_S + EVENT_S)
            launcher.wait(EVENT_S)
    wait_until(lambda: not is_running(child))


def is_running(pid):
    """Return whether a process exists and has not just ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False
