"""How long an agent may take to start, and what it may leave behind."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim_conformance import ConnectionSpec, SessionLimits, check_agent
from gslcosim_conformance.transports import OrphanProcesses

MUTANT = Path(__file__).parent / "agents" / "mutant.py"

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]


def test_an_agent_that_starts_slowly_breaks_no_rule(tmp_path):
    """Over stdio it has joined by being started, and is sent the end before it can read."""
    limits = SessionLimits(answer_s=20.0, exit_s=2.5, settle_s=0.15)
    command = (sys.executable, str(MUTANT), "slow_starter", "stdio", "msgpack")
    report = check_agent(ConnectionSpec(command=command, transport="stdio", directory=tmp_path), limits)
    assert report.has_passed, report.as_text()


@pytest.mark.skipif(not OrphanProcesses.is_possible(), reason="only Linux tells who a process belonged to")
def test_a_daemon_without_a_trace_is_found_and_ended(tmp_path):
    command = (sys.executable, str(MUTANT), "leaves_a_nameless_daemon", "stdio", "msgpack")
    report = check_agent(ConnectionSpec(command=command, transport="stdio", directory=tmp_path))
    assert report.failed_rules == ("leaves-nothing",), report.as_text()
    (pid,) = re.findall(r"sleep 1000 \(process (\d+)\)", report.finding("leaves-nothing").failure.got)
    assert not Path("/proc", pid).exists()


@pytest.mark.skipif(not OrphanProcesses.is_possible(), reason="only Linux tells who a process belonged to")
def test_a_program_that_another_thread_starts_meanwhile_is_not_the_agents():
    orphans = OrphanProcesses("of a check")
    orphans.begin()
    with subprocess.Popen(["/bin/sleep", "1000"]) as other:
        try:
            assert orphans.end() == ()
            assert other.poll() is None
        finally:
            other.kill()
