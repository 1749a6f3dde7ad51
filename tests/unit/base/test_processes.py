"""Signals that ask to end, as a flag, and as KeyboardInterrupt."""

import os
import signal
import subprocess
import sys

import pytest

from gslcosim.base.processes import Interruption

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no such signals")


def send(number: int) -> None:
    """Send a signal to this process."""
    os.kill(os.getpid(), number)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_each_signal_sets_the_flag_once_and_handlers_come_back(name):
    """A closed terminal is as Ctrl-C."""
    number, before, calls = getattr(signal, name), signal.getsignal(signal.SIGTERM), []
    hangup = signal.getsignal(signal.SIGHUP)
    try:
        with Interruption(lambda: calls.append(1)) as interruption:
            assert not interruption.is_set()
            send(number)
            assert interruption.is_set()
        assert calls == [1]
        assert signal.getsignal(signal.SIGTERM) is before
    finally:
        signal.signal(signal.SIGHUP, hangup)


def test_a_terminal_that_is_closed_twice_is_closed_once():
    """The shell sends SIGHUP as well as the system, which must not kill a run that is ending."""
    hangup = signal.getsignal(signal.SIGHUP)
    try:
        with Interruption() as interruption:
            send(signal.SIGHUP)
            send(signal.SIGHUP)
        send(signal.SIGHUP)
        assert interruption.is_set()
    finally:
        signal.signal(signal.SIGHUP, hangup)


def test_nohup_is_respected():
    """Who starts a run with SIGHUP ignored wants it to outlive the terminal."""
    hangup = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interruption() as interruption:
            send(signal.SIGHUP)
            assert not interruption.is_set()
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, hangup)


RAISES = """
import os, signal, sys
from gslcosim.base.processes import Interruption, is_asked_to_end, raise_on_signals
number = getattr(signal, sys.argv[1])
raise_on_signals()
assert not is_asked_to_end()
try:
    os.kill(os.getpid(), number)
    sys.exit("went on")
except KeyboardInterrupt:
    pass
assert is_asked_to_end()
# What a library has swallowed still ends the run.
with Interruption() as interruption:
    assert interruption.is_set()
if not (pid := os.fork()):
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGTERM)
    os._exit(1)
assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == -signal.SIGTERM
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_raise_in_this_process_and_end_its_forks(name):
    """SIGTERM would otherwise end a command without a word."""
    subprocess.run(
        [sys.executable, "-c", RAISES, name],
        check=True,
        # Whoever runs the tests in the background may have had SIGINT ignored, which children inherit.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
