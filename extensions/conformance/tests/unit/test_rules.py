"""The report: every rule is in it, and says what to do."""

import json

import pytest

from gslcosim_conformance.rules import RULES, CheckReport, Failure, build_findings


def report(transport="zenoh", failures=(), unjudged=()):
    broken = {rule: Failure(rule=rule, flight="first", sent="this", expected="that", got="other") for rule in failures}
    findings = build_findings(transport, broken, dict.fromkeys(unjudged, "first put right: x"), {})
    return CheckReport(command=("./agent",), transport=transport, format="msgpack", findings=findings)


def test_every_rule_says_what_a_right_agent_does_and_what_the_author_of_a_wrong_one_does_next():
    for rule in RULES.values():
        assert rule.sentence[0].islower()
        assert not rule.sentence.endswith(".")
        assert rule.remedy.endswith(".")


@pytest.mark.parametrize("rule", RULES)
def test_a_break_is_reported_with_what_was_sent_expected_and_got_and_the_remedy(rule):
    found = report(failures=[rule])
    assert found.failed_rules == (rule,)
    assert not found.has_passed
    lines = found.as_text().splitlines()
    assert f"FAIL  {rule:<16}  {RULES[rule].sentence}" in lines
    for line in ("sent      this", "expected  that", "got       other"):
        assert f"      {line}" in lines
    assert RULES[rule].remedy.split()[0] in found.as_text()


def test_what_was_not_judged_has_not_passed():
    found = report(unjudged=["restart"])
    assert not found.has_passed
    assert found.failed_rules == ()
    assert "(first put right: x)" in found.as_text()


def test_rules_of_the_other_door_do_not_count():
    found = report(transport="stdio", failures=["own-key"])
    assert found.has_passed
    assert found.finding("own-key").status == "not_applicable"


def test_json_has_every_rule_with_its_status():
    fields = json.loads(json.dumps(report(failures=["tick"]).as_fields()))
    assert fields["passed"] is False
    assert [rule["id"] for rule in fields["rules"]] == list(RULES)
    (tick,) = (rule for rule in fields["rules"] if rule["id"] == "tick")
    assert tick["status"] == "failed"
    assert tick.keys() >= {"sentence", "flight", "sent", "expected", "got", "remedy"}
