"""Joining a run whose supervisor is stopped: members wait for its router, and refusals are still errors."""

import os
import signal
import socket
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import zenoh

from gslcosim.base.errors import SimulationFault
from gslcosim.base.files import ScratchFolder
from gslcosim.bus.interface import JoinData, Mesh
from gslcosim.bus.zenoh_bus import ZenohBus, open_with_retries, wait_for_router

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="members are watched on Linux only")

NAMESPACE = "gsl/test"
ROUTER = """
import sys
from pathlib import Path
from gslcosim.bus.zenoh_bus import ZenohBus
router = ZenohBus.open_router(
    endpoints=[sys.argv[1]], namespace=sys.argv[2], service_password="s", agents=[], secrets_dir=Path(sys.argv[3])
)
sys.stdout.write("open\\n")
sys.stdout.flush()
sys.stdin.read()
"""


@pytest.fixture
def folder():
    with ScratchFolder.for_sockets() as scratch:
        yield scratch.path


@pytest.fixture
def router(folder):
    """A router in a process of its own, with its endpoint."""
    endpoint = f"unixsock-stream/{folder}/router.sock"
    command = [sys.executable, "-c", ROUTER, endpoint, NAMESPACE, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"open\n"
        yield process, endpoint
        process.kill()


def count_connections(endpoint: str) -> int:
    """Return how many connections to a listening socket the kernel knows, accepted or not."""
    path = endpoint.removeprefix("unixsock-stream/")
    lines = Path("/proc/net/unix").read_text().splitlines()
    return sum(line.endswith(f" {path}") for line in lines) - 1


def wait_until(is_true):
    """Wait for a condition that other processes make true."""
    while not is_true():
        threading.Event().wait(0.01)


# A thread that runs on another processor goes on for a moment.
def is_stopped(pid):
    """Return whether no thread of a process runs any more."""
    try:
        states = {path.read_text().rpartition(")")[2].split()[0] for path in Path(f"/proc/{pid}/task").glob("*/stat")}
    except OSError:  # a thread has ended since the list was made
        return False
    return states == {"T"}


# Zenoh gives up after 2 s as a peer, and after 10 s as a client.
@pytest.mark.parametrize(
    "is_in_mesh",
    [
        pytest.param(False, marks=pytest.mark.slow, id="client"),
        pytest.param(True, marks=[pytest.mark.slow, pytest.mark.tour], id="peer"),
    ],
)
def test_a_member_that_began_to_join_at_a_stopped_router_joins_when_it_continues(router, folder, is_in_mesh):
    """Each attempt of Zenoh's has failed by then."""
    process, endpoint = router
    mesh = Mesh(listen=f"unixsock-stream/{folder}/world.mesh", connect=()) if is_in_mesh else None
    join = JoinData(
        name="world", endpoint=endpoint, namespace=NAMESPACE, user="service", password="s", is_watched=True, mesh=mesh
    )
    os.kill(process.pid, signal.SIGSTOP)
    wait_until(lambda: is_stopped(process.pid))
    with ThreadPoolExecutor(1) as pool:
        joining = pool.submit(ZenohBus.open_member, join)
        # The failed attempt's, and that of anyone who waits for an answer.
        wait_until(lambda: count_connections(endpoint) == 2 or joining.done())
        is_waiting = not joining.done()
        os.kill(process.pid, signal.SIGCONT)
        joining.result().close()
    assert is_waiting


def test_a_password_that_is_refused_is_an_error_of_a_watched_member_too(router):
    join = JoinData(
        name="world", endpoint=router[1], namespace=NAMESPACE, user="service", password="wrong", is_watched=True
    )
    with pytest.raises(SimulationFault, match="its password were refused"):
        ZenohBus.open_member(join)


def test_an_answer_is_waited_for_until_the_listener_reads(folder):
    """A connection that nobody accepts is no answer."""
    path = folder / "silent.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener, ThreadPoolExecutor(1) as pool:
        listener.bind(str(path))
        listener.listen()
        waiting = pool.submit(wait_for_router, f"unixsock-stream/{path}")
        connection, _ = listener.accept()
        assert connection.recv(1) == b""
        assert not waiting.done()
        connection.close()
        assert waiting.result()


def test_nobody_who_listens_is_not_waited_for(folder):
    assert not wait_for_router(f"unixsock-stream/{folder}/absent.sock")
    assert not wait_for_router("tcp/127.0.0.1:9")


def test_attempts_are_bounded_at_a_router_that_answers(router):
    attempts = []

    def fail():
        attempts.append(1)
        raise zenoh.ZError("refused")

    with pytest.raises(zenoh.ZError, match="refused"):
        open_with_retries(fail, router[1])
    assert len(attempts) == 3
