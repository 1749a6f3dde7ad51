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
