"""A run's passwords are out of reach of other processes of the same user."""

import subprocess
import sys

import pytest


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has prctl")
def test_memory_and_environment_can_be_closed_to_others():
    """The kernel says so afterwards, and did not before."""
    code = (
        "from gslcosim.runtime.processes.current_process import is_memory_private, keep_memory_private\n"
        "before = is_memory_private(); keep_memory_private(); print(before, is_memory_private())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
