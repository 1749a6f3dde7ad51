"""What a replay reads, and what it refuses."""

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.runtime.replay.past_run import PastRun, read_recorded_commands

HOLD = '{"agent": "beetle", "tick": 3, "kind": "hold", "hold_s": 2.0}'


def test_commands_are_found_by_agent_and_tick(tmp_path):
    (tmp_path / "inputs.log").write_text(HOLD + "\n" + HOLD.replace("beetle", "moth").replace("3", "4") + "\n")
    commands = read_recorded_commands(tmp_path / "inputs.log")
    assert commands["beetle"][3].hold_s == 2.0
    assert list(commands["moth"]) == [4]


@pytest.mark.parametrize(
    "line", ["{", "[]", '{"tick": 3, "kind": "hold"}', '{"agent": "a", "tick": 3, "kind": "sing"}']
)
def test_a_line_that_is_no_command_is_reported_with_its_number(tmp_path, line):
    (tmp_path / "inputs.log").write_text(f"{HOLD}\n{line}\n")
    with pytest.raises(UsageError, match=r"inputs\.log:2: expected an agent's command"):
        read_recorded_commands(tmp_path / "inputs.log")


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"expected a folder with manifest\.json"):
        PastRun.load(tmp_path)
