"""The log of an agent: all of its output up to a limit, a notice where it is cut, and nobody waits for it."""

import subprocess
import sys

import pytest
from deadlines import EVENT_S

from gslcosim.base.errors import RunFolderError
from gslcosim.runtime.processes.process_log import ProcessLog


def written(log_path, program, **limits):
    log = ProcessLog(log_path, **limits)
    with log:
        process = subprocess.Popen([sys.executable, "-c", program], stdout=log.fileno(), stderr=subprocess.STDOUT)
    code = process.wait(EVENT_S)
    log.wait(EVENT_S)
    return code, log_path.read_text()


def test_what_a_process_says_is_in_its_log(tmp_path):
    (tmp_path / "agent.log").write_text("before\n")
    code, text = written(tmp_path / "agent.log", "import sys; print('out'); print('err', file=sys.stderr)")
    assert (code, sorted(text.splitlines())) == (0, ["before", "err", "out"])


def test_a_log_that_is_full_is_cut_with_a_notice_and_the_process_goes_on(tmp_path):
    code, text = written(tmp_path / "agent.log", "print('x' * 3_000_000)", most_bytes=1_000_000)
    assert code == 0
    kept, _, notices = text.partition("\n")
    assert len(kept) == 1_000_000
    assert "[gslcosim: the log is cut here, after 1 MB.]" in notices
    assert "[gslcosim: 2.000 MB more were dropped.]" in notices


def test_a_log_that_is_a_link_is_refused(tmp_path):
    (tmp_path / "agent.log").symlink_to(tmp_path / "foreign")
    with pytest.raises(RunFolderError, match=r"agent\.log: expected a log that can be written"):
        ProcessLog(tmp_path / "agent.log")
    assert not (tmp_path / "foreign").exists()


LIVING_ON = "import sys; sys.stdin.read(); print('lived on', flush=True)"


def test_a_descendant_that_holds_the_output_is_not_waited_for(tmp_path):
    leaving = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {LIVING_ON!r}])"
    log = ProcessLog(tmp_path / "agent.log")
    with log:
        process = subprocess.Popen(
            [sys.executable, "-c", leaving], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log.fileno()
        )
    assert process.wait(EVENT_S) == 0
    log.wait(0.1)
    process.stdin.close()
    assert process.stdout.read() == b"lived on\n"
    process.stdout.close()
    log.wait(EVENT_S)
