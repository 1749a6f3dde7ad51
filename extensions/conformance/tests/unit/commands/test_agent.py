"""`gslcosim agent`: exit codes, and what is printed where."""

import json
import sys

import pytest

from gslcosim.cli.main import main

END_AT_ONCE = [sys.executable, "-S", "-c", "raise SystemExit(7)"]


@pytest.mark.slow
def test_a_broken_rule_is_exit_code_1_and_json_is_alone_on_stdout(capsys):
    assert main(["agent", "check", "--door", "stdio", "--json", "--", *END_AT_ONCE]) == 1
    output = capsys.readouterr()
    report = json.loads(output.out)
    assert report["passed"] is False
    assert report["command"] == END_AT_ONCE
    assert "exit code 7" in report["rules"][0]["got"]
    assert "flight: first" in output.err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["agent", "check", "--", "./there-is-no-such-agent"], "expected an agent's command that can be started"),
        (["agent", "check", "--door", "window", "--", "true"], "expected one of zenoh, stdio, tcp, unix, was 'window'"),
        (["agent", "check", "--timeout", "0", "--", "true"], "expected a number of seconds above 0, was '0'"),
        (["participant", "check", "--timeout", "0", "--", "true"], "expected a number of seconds above 0, was '0'"),
        (["agent", "new", "cobol", "x"], "expected one of the languages python"),
        (["agent", "chekc", "--", "true"], "was 'chekc'. Did you mean check? See"),
    ],
)
def test_a_wrong_call_is_exit_code_2(capsys, words, expected):
    assert main(words) == 2
    assert expected in capsys.readouterr().err


def test_a_new_agent_is_announced_with_what_to_do_next(capsys, tmp_path):
    assert main(["agent", "new", "python", "gas_finder", "--dir", str(tmp_path / "new")]) == 0
    text = capsys.readouterr().out
    assert "gslcosim agent check" in text
    assert (tmp_path / "new" / "agent.py").is_file()
