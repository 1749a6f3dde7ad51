"""A warm server: runs from it are those without it, it forks with one thread, and says what it cannot do."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest
from deadlines import EVENT_S, PROCESS_S
from real_runs import COMMAND, TINY_ROOM, fly_here, start, wait_a_moment, with_agent

from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim.runtime.processes import daemon

pytestmark = [
    pytest.mark.end_to_end,
    pytest.mark.skipif(sys.platform != "linux", reason="forks are safe on Linux only"),
]
ONE_TICK = ("--set", "referee.stop.time_limit_s=0.1")
LONG = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=20000")


@contextlib.contextmanager
def own_place():
    """Servers of other tests are elsewhere; the socket needs a folder of this user alone."""
    with tempfile.TemporaryDirectory(prefix="warm-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", folder)
        patch.setattr("tempfile.tempdir", None)
        yield


@contextlib.contextmanager
def serving():
    """Start a server, and end it in order."""
    process = subprocess.Popen([*COMMAND, "serve"], stdout=subprocess.PIPE, text=True, start_new_session=True)
    try:
        assert "--warm" in process.stdout.readline()
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        assert process.wait(EVENT_S) in (0, -signal.SIGKILL)
        process.stdout.close()


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    # Pytest's own temporary files stay where they are.
    tmp_path_factory.getbasetemp()
    with own_place(), serving() as process:
        yield process


def refused(*words):
    """Call a command that says what is wrong, in this process."""
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors):
        assert main(words) == 2
    return errors.getvalue()


def test_a_warm_run_is_the_same_as_a_cold_one(server, tmp_path):
    """And the server has one thread before it and after: Zenoh's and MuJoCo's are those of its forks."""
    cold = fly_here(TINY_ROOM, tmp_path / "cold")
    warm = start(TINY_ROOM, tmp_path / "warm", "--warm").end()
    grouped = start(TINY_ROOM, tmp_path / "grouped", "--warm", "--processes", "grouped").end()
    assert warm.exit_code == cold.exit_code
    assert warm.result["digest"] == grouped.result["digest"] == cold.result["digest"]
    assert len(list(Path(f"/proc/{server.pid}/task").iterdir())) == 1
    assert server.poll() is None


def long_flight(tmp_path):
    flight = start(TINY_ROOM, tmp_path, *LONG, *with_agent("holding"), "--warm")
    flight.wait_until_flying()
    return flight


def test_ctrl_c_reaches_the_run(server, tmp_path):
    flight = long_flight(tmp_path)
    flight.process.send_signal(signal.SIGINT)
    ended = flight.end()
    assert ended.exit_code == 130
    assert ended.result["end_reason"] == "interrupted"


def test_a_run_ends_with_the_command_that_has_asked_for_it(server, tmp_path):
    long_flight(tmp_path).abandon()
    for _ in range(1000):
        if found := [*tmp_path.glob("*/result.json")]:
            break
        wait_a_moment()
    assert json.loads(found[0].read_text())["end_reason"] == "interrupted"


def test_a_server_ends_its_runs(tmp_path):
    with own_place(), serving():
        flight = long_flight(tmp_path)
    ended = flight.end()
    assert ended.exit_code == 130
    assert ended.result["end_reason"] == "interrupted"


def test_a_second_server_refuses(server):
    second = subprocess.run([*COMMAND, "serve"], capture_output=True, text=True, check=False)
    assert second.returncode == 2
    assert (
        f"A server of this user is already running (pid {server.pid}). Stop it with `kill {server.pid}`."
        in second.stderr
    )


def test_a_server_with_other_imports_refuses(server, monkeypatch):
    """Whatever differs is named: code, packages, Python, or what libraries read when they are imported."""
    monkeypatch.setenv("NUMBA_OPT", "0")
    text = refused("up", str(TINY_ROOM), "--warm")
    assert f"found one with another environment. Start it again: kill {server.pid}; gslcosim serve" in text


def test_one_process_is_refused(server, tmp_path):
    flight = start(TINY_ROOM, tmp_path, "--warm", "--processes", "one")
    _, errors = flight.process.communicate(timeout=PROCESS_S)
    assert flight.process.returncode == 2
    assert "--warm: expected --processes separate or grouped with it, was one" in errors


def test_a_server_that_does_not_answer_is_named(server, monkeypatch):
    monkeypatch.setattr(daemon, "ANSWER_TIMEOUT_S", 0.2)
    os.kill(server.pid, signal.SIGSTOP)
    try:
        text = refused("up", str(TINY_ROOM), "--warm")
    finally:
        os.kill(server.pid, signal.SIGCONT)
    assert f"expected an answer of the server, process {server.pid}, within 0.2 s, got none" in text


def test_a_killed_server_is_distinguished_from_none_and_replaced(tmp_path):
    with own_place():
        text = refused("up", str(TINY_ROOM), "--warm")
        assert "expected a server, found none. Start one in another shell: gslcosim serve" in text
        with serving() as process:
            process.kill()
            process.wait(EVENT_S)
            assert "found one that was killed. Start one" in refused("up", str(TINY_ROOM), "--warm")
        with serving():
            ended = start(TINY_ROOM, tmp_path, *ONE_TICK, "--warm").end()
        assert ended.exit_code == 1
        assert not daemon.get_daemon_socket().exists()


def test_no_other_can_enter_its_folder(server):
    assert daemon.get_daemon_folder().stat().st_mode & 0o077 == 0


def test_a_process_with_a_second_thread_does_not_fork():
    """Whatever a thread holds when its process forks, Zenoh's locks for example, is held for ever in the fork."""
    go_on = threading.Event()
    thread = threading.Thread(target=go_on.wait, name="somebody")
    thread.start()
    try:
        with pytest.raises(UsageError, match=r"expected one thread, to fork from, was \d+ .*somebody"):
            daemon.check_one_thread()
    finally:
        go_on.set()
        thread.join()


def test_changed_code_is_seen(tmp_path, monkeypatch):
    """By name, size and time of any file of the package; not what Python compiles beside it."""
    module = tmp_path / "module.py"
    module.write_text("one = 1\n")
    monkeypatch.setattr(daemon, "get_code_roots", lambda: {"package": tmp_path})
    before = daemon.read_code_identity()
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "module.pyc").write_text("compiled")
    assert daemon.find_differences(before, daemon.read_code_identity()) == []
    os.utime(module, ns=(0, 0))
    assert daemon.find_differences(before, daemon.read_code_identity()) == ["code"]
