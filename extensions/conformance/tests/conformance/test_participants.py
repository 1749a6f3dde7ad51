"""The kit for participants: a right program keeps every rule, and each wrong one breaks the rule that it is about."""

import json
import sys
from pathlib import Path

import pytest

from gslcosim.cli.main import main
from gslcosim_conformance import ConnectionSpec, SessionLimits, check
from gslcosim_conformance.participant_check import PARTICIPANT_RULES, check_participant
from gslcosim_conformance.scaffold import PARTICIPANT_TEMPLATES

PROGRAM = Path(__file__).parents[4] / "tests" / "shared" / "foreign_program.py"
# How busy the machine is decides nothing: only of what breaks a limit anybody waits for its end.
PATIENT = SessionLimits(join_s=60.0, answer_s=20.0, exit_s=20.0, settle_s=0.3)
# Right starts, answers and exits stay within these on a slow and busy machine too.
IMPATIENT = SessionLimits(join_s=60.0, answer_s=10.0, exit_s=5.0, settle_s=0.3)
BREAKS_A_LIMIT = {"hangs", "lingers", "needs_a_step", "stays_behind", "needs_inputs"}

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]


@pytest.fixture(autouse=True)
def _without_a_pause_between_starts(monkeypatch):
    monkeypatch.setattr(check, "MIN_START_INTERVAL_S", 0.0)


def checked(fault, at="3", transport="stdio"):
    command = (sys.executable, str(PROGRAM), fault, str(at))
    return check_participant(
        ConnectionSpec(command=command, transport=transport, format="json"),
        IMPATIENT if fault in BREAKS_A_LIMIT else PATIENT,
    )


@pytest.mark.parametrize("transport", ["stdio", "unix", "tcp"])
def test_a_right_program_keeps_every_rule(transport):
    report = checked("right", transport=transport)
    assert report.has_passed, report.as_text()
    assert [finding.rule.id for finding in report.findings] == list(PARTICIPANT_RULES)


MUTANTS = {
    "never_says_hello": "hello",
    "unknown_port": "ports",
    "other_contract": "contract",
    "hangs": "answers",
    "garbage": "encoding",
    "too_big": "encoding",
    "wrong_tick": "tick",
    "real_tick": "tick",
    "other_output": "outputs",
    "nan": "values",
    "no_share": "values",
    "twice": "once",
    "unasked": "once",
    "exits": "stays",
    "is_killed": "stays",
    "closes": "stays",
    "lingers": "ending",
    "ends_badly": "exit-code",
    "leaves": "leaves-nothing",
    "once_only": "restart",
    "random": "determinism",
    "knows_all_fields": "unknown-fields",
    "needs_inputs": "missing-inputs",
    "needs_a_step": "early-ending",
    "stays_behind": "stream-end",
}


@pytest.mark.parametrize("fault", MUTANTS)
def test_a_wrong_program_breaks_the_rule_that_it_is_about(fault, tmp_path):
    report = checked(fault, at=tmp_path / "lock" if fault == "once_only" else 3)
    broken = report.failed_rules
    assert broken[:1] == (MUTANTS[fault],), report.as_text()
    # What does not end by itself does not end in the other sessions either.
    assert set(broken) <= {MUTANTS[fault], "early-ending", "stream-end", "exit-code"}, report.as_text()
    assert report.finding(broken[0]).failure.expected


def test_every_rule_has_a_program_that_breaks_it():
    assert set(MUTANTS.values()) == set(PARTICIPANT_RULES)


@pytest.mark.tour
def test_the_command_prints_the_same_as_json(capsys, monkeypatch):
    monkeypatch.chdir(PARTICIPANT_TEMPLATES)
    words = ["participant", "check", "--json", "--format", "json", "--", sys.executable, "air_conditioner.py"]
    assert main(words) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["passed"]
    assert [rule["id"] for rule in report["rules"]] == list(PARTICIPANT_RULES)
    assert main([*words[:5], "--", sys.executable, str(PROGRAM), "nan", "3"]) == 1
    (broken,) = [rule for rule in json.loads(capsys.readouterr().out)["rules"] if rule["status"] == "failed"]
    assert broken["id"] == "values"
    assert "was nan" in broken["got"]


def test_what_cannot_be_checked_is_a_wrong_call(capsys):
    assert main(["participant", "check", "--", "./no_such_model"]) == 2
    assert main(["participant", "check", "--parameters", "[1]", "--", "cat"]) == 2
    assert "--parameters: expected a block such as {above_ppm: 0.5}" in capsys.readouterr().err
