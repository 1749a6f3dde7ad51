"""What `gslcosim join … agent` starts, and what it refuses to."""

import json
import sys

import pytest
from deadlines import has_ended

from gslcosim.base.errors import SimulationFault, UsageError
from gslcosim.runtime.network import JoinFile
from gslcosim.runtime.remote_join import build_agent_command, join_as_agent

AGENT = {"name": "beetle", "endpoint": "tcp/host:7447", "namespace": "gsl/x", "user": "agent_beetle", "password": "p"}
GUEST = {"name": "ant", "gateway": "tcp:host:1", "token": "t", "format": "json"}


@pytest.fixture
def joined(tmp_path):
    def joined(fields):
        path = tmp_path / "file.json"
        path.write_text(json.dumps(fields))
        return JoinFile.read(path)

    return joined


def test_bundled_agents_files_and_commands_are_distinguished(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").touch()
    assert build_agent_command(["dung_beetle"], is_behind_gateway=False)[-1].endswith("dung_beetle/agent.py")
    assert build_agent_command(["mine.py"], is_behind_gateway=False)[-1] == str(tmp_path / "mine.py")
    assert build_agent_command(["sleep", "1"], is_behind_gateway=False) == ["sleep", "1"]
    assert build_agent_command(["true"], is_behind_gateway=True) == ["true"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [([], "a program after agent"), (["none.py"], r"a \.py file or one of"), (["no_such", "x"], "no such program")],
)
def test_what_cannot_be_started_is_refused(words, expected):
    with pytest.raises(UsageError, match=expected):
        build_agent_command(words, is_behind_gateway=False)


def test_a_python_agent_does_not_connect_to_the_gateway_itself():
    with pytest.raises(UsageError, match="without door: tcp"):
        build_agent_command(["dung_beetle"], is_behind_gateway=True)


@pytest.mark.slow
def test_a_program_finds_how_to_join_and_its_end_is_reported(joined):
    reads = "import json, os; fields = json.load(open(os.environ['GSLCOSIM_JOIN'])); assert fields['password'] == 'p'"
    said = []
    join_as_agent(joined(AGENT), [sys.executable, "-c", reads], say=said.append)
    assert said[-1] == "agent beetle: has ended with the run"
    tells = "import os; assert (os.environ['GSLCOSIM_GATEWAY'], os.environ['GSLCOSIM_TOKEN']) == ('tcp:host:1', 't')"
    join_as_agent(joined(GUEST), [sys.executable, "-c", tells], say=said.append)
    with pytest.raises(SimulationFault, match="agent beetle: the program ended with exit code 4"):
        join_as_agent(joined(AGENT), [sys.executable, "-c", "raise SystemExit(4)"], say=said.append)


@pytest.mark.slow
@pytest.mark.parametrize("fields", [AGENT, GUEST], ids=["bus", "gateway"])
def test_tokens_of_the_user_do_not_reach_the_program(joined, monkeypatch, fields):
    """Its environment is the short one that it would have in a run of this host."""
    monkeypatch.setenv("A_TOKEN", "of the user")
    monkeypatch.setenv("LC_TIME", "C")
    reads = "import os; assert 'A_TOKEN' not in os.environ and os.environ['LC_TIME'] == 'C'"
    join_as_agent(joined(fields), [sys.executable, "-c", reads], say=lambda text: None)


@pytest.mark.skipif(sys.platform != "linux", reason="the end of a process of others is seen on Linux")
def test_what_a_program_has_started_ends_with_it(joined, tmp_path):
    """It went on alone, on a host where nobody looked for it."""
    number = tmp_path / "number"
    starts = f"import subprocess; print(subprocess.Popen(['sleep', '600']).pid, file=open({str(number)!r}, 'w'))"
    join_as_agent(joined(AGENT), [sys.executable, "-c", starts], say=lambda text: None)
    assert has_ended(int(number.read_text()))
