"""A limit on an ordinary user's processes and threads (ulimit -u), which no limit of root's shows."""

import sys

import pytest
from ordinary_user import run_as_ordinary_user
from real_runs import TINY_ROOM

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]


# Too few for a library of this process, for the threads of its session, and for those of a service.
@pytest.mark.parametrize("n_processes", [4, 12, 60])
def test_a_limit_on_processes_is_reported_with_its_remedy(n_processes):
    up = [sys.executable, "-m", "gslcosim", "up", str(TINY_ROOM), "--runs-dir", "{home}/runs"]
    ended = run_as_ordinary_user(["prlimit", f"--nproc={n_processes}", *up])
    assert ended.returncode == 3, ended.stderr
    assert "ulimit -u" in ended.stderr
    for words in ("Interrupted", "panicked", "OpenBLAS", "Traceback"):
        assert words not in ended.stderr


# What others have started by then leaves a router no thread when the first member comes.
_ROUTER = """
import resource, subprocess, sys, tempfile
from pathlib import Path
from gslcosim.bus.zenoh_bus import ZenohBus

member = subprocess.Popen([sys.executable, "-c", sys.argv[1]], stdin=subprocess.PIPE, text=True)
with tempfile.TemporaryDirectory() as folder:
    endpoint = "unixsock-stream/" + folder + "/router"
    kept = dict(namespace="few", service_password="secret", agents=[], secrets_dir=Path(folder))
    with ZenohBus.open_router(endpoints=[endpoint], **kept):
        resource.setrlimit(resource.RLIMIT_NPROC, (1, 1))
        member.communicate(endpoint)
sys.exit(member.returncode)
"""
_MEMBER = """
import sys
import zenoh
from gslcosim.bus.zenoh_bus import SERVICE_ACCOUNT, JoinData, ZenohBus

endpoint = sys.stdin.read()
ZenohBus.open_member(
    JoinData(name="world", endpoint=endpoint, namespace="few", user=SERVICE_ACCOUNT, password="secret")
).close()
"""


def test_a_router_needs_no_thread_more_when_its_first_member_comes():
    ended = run_as_ordinary_user(["prlimit", "--nproc=2000", sys.executable, "-c", _ROUTER, _MEMBER])
    assert ended.returncode == 0, ended.stderr
    assert "panicked" not in ended.stderr
