"""A run's passwords are out of reach of other processes of the same user."""

import subprocess
import sys

import pytest


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has prctl")
def test_memory_and_environment_can_be_closed_to_others():
    """The kernel says so afterwards, and did not before."""
    code = (
        "import ctypes\n"
        "from gslcosim.runtime.processes.current_process import keep_memory_private\n"
        "get_dumpable = lambda: ctypes.CDLL(None).prctl(3)  # PR_GET_DUMPABLE\n"
        "before = get_dumpable(); keep_memory_private(); print(before, get_dumpable())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1", "0"]
