"""The fork server: one thread, forks that tell how they ended, and nothing left when it is closed or killed."""

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import EVENT_S

from gslcosim.base.errors import SimulationFault
from gslcosim.bus.interface import JoinData
from gslcosim.runtime.distributed.service_main import build_fork_request
from gslcosim.runtime.processes.child_processes import ChildProcesses
from gslcosim.runtime.processes.fork_server import ForkServer

pytestmark = [
    pytest.mark.skipif(not ForkServer.is_possible(), reason="forks are safe on Linux only"),
]
JOIN = JoinData(name="world", endpoint="unixsock-stream/nowhere", namespace="gsl/none", user="service", password="none")


@pytest.fixture(scope="module")
def server():
    with ForkServer() as server:
        yield server


def fork(server, name, log):
    return server.fork(name, build_fork_request([name], JOIN), log=log)


def exists(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_fork_shows_how_it_ended_and_its_log_why(server, tmp_path):
    """Without a run directory in its join data a service refuses, as one that was started does."""
    process = fork(server, "world", log=tmp_path / "world.log")
    assert process.wait(EVENT_S) == 3
    assert process.poll() == 3
    assert "expected run_dir in the join data" in (tmp_path / "world.log").read_text()


def test_the_server_has_one_thread(server, tmp_path):
    """A fork has the thread that forks and no other; whatever a lost one held would be held for ever."""
    fork(server, "world", log=tmp_path / "world.log").wait(EVENT_S)
    assert len(list(Path(f"/proc/{server.pid}/task").iterdir())) == 1


@pytest.mark.slow
def test_a_server_that_is_killed_takes_its_forks_along(tmp_path):
    with ForkServer() as server:
        process = fork(server, "world", log=tmp_path / "world.log")
        process.wait(EVENT_S)
        waiting = fork(server, "fields", log=tmp_path / "fields.log")
        os.kill(server.pid, signal.SIGKILL)
        assert waiting.wait(EVENT_S) in (3, -signal.SIGKILL)
        server.wait_until_gone(EVENT_S)
        assert server.has_failed
        with pytest.raises(SimulationFault, match="fork server: expected it to run, it was killed by SIGKILL"):
            fork(server, "world", log=tmp_path / "world.log")


@pytest.mark.slow
def test_a_stopped_server_shows_the_ends_of_its_forks_when_it_is_woken(server, tmp_path):
    """And nobody has to wait for it to learn that a number is not known yet."""
    os.kill(server.pid, signal.SIGSTOP)
    process = fork(server, "world", log=tmp_path / "world.log")
    assert process.pid == 0
    server.wake()
    assert process.wait(EVENT_S) == 3
    assert process.pid > 0


@pytest.mark.slow
def test_a_run_ends_although_its_fork_server_is_stopped(tmp_path):
    """The end of its forks is not told; they end with the server, which is ended next."""
    with ForkServer() as server, ChildProcesses(lambda name, code, how: None) as children:
        process = fork(server, "world", log=tmp_path / "world.log")
        process.wait(EVENT_S)
        os.kill(server.pid, signal.SIGSTOP)
        children.adopt("fields", fork(server, "fields", log=tmp_path / "fields.log"))
    assert not exists(server.pid)
    assert not children.pids


def children_of(pid):
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def test_who_imports_what_a_recorder_needs_becomes_the_recorder_once(tmp_path):
    with ForkServer() as server:
        fork(server, "world", log=tmp_path / "world.log").wait(EVENT_S)
        (preforked,) = children_of(server.pid)
        pids = []
        for _ in range(2):
            process = fork(server, "recorder", log=tmp_path / "recorder.log")
            assert process.wait(EVENT_S) == 3
            pids.append(process.pid)
    assert pids[0] == preforked
    assert pids[1] != preforked
    assert (tmp_path / "recorder.log").read_text().count("expected run_dir in the join data") == 2


@pytest.mark.slow
def test_a_recorder_is_forked_where_who_should_become_it_was_killed(tmp_path):
    with ForkServer() as server:
        fork(server, "world", log=tmp_path / "world.log").wait(EVENT_S)
        (preforked,) = children_of(server.pid)
        end = os.pidfd_open(preforked)
        os.kill(preforked, signal.SIGKILL)
        assert select.select([end], [], [], EVENT_S)[0]
        os.close(end)
        process = fork(server, "recorder", log=tmp_path / "recorder.log")
        assert process.wait(EVENT_S) == 3
    assert process.pid != preforked


def test_a_run_without_a_process_for_its_recorder_keeps_none_ready(tmp_path):
    with ForkServer() as server:
        fork(server, "world", log=tmp_path / "world.log").wait(EVENT_S)
        (preforked,) = children_of(server.pid)
        server.release_unused()
        fork(server, "world", log=tmp_path / "world.log").wait(EVENT_S)
        assert not exists(preforked)


def test_a_title_replaces_the_command_line():
    """Tools that list processes show what a fork has become; a longer title than there is room for is cut."""
    program = (
        "import sys; from pathlib import Path\n"
        "from gslcosim.runtime.processes.current_process import set_process_title\n"
        "set_process_title('python serves ' + 'x' * 1000)\n"
        "print(Path('/proc/self/cmdline').read_bytes().replace(b'\\0', b' ').decode())"
    )
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert shown.startswith("python serves xxx")
    assert "import" not in shown
