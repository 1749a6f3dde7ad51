"""The page about checking agents says what the kit does."""

import re
from pathlib import Path

from gslcosim_conformance.rules import RULES, Failure, Finding

PAGE = (Path(__file__).parents[4] / "docs" / "check-your-agent.md").read_text()


def test_every_rule_is_on_the_page_with_its_words_and_in_its_order():
    rows = [f"| `{rule.id}` | {rule.transports} | {rule.sentence} | {rule.remedy} |" for rule in RULES.values()]
    assert re.findall(r"^\| `[a-z-]+` \| (?:all|zenoh|gateway) \|.*$", PAGE, re.MULTILINE) == rows


def test_the_sample_is_what_a_report_looks_like():
    sample = PAGE.partition("FAIL  tick")[2].partition("```")[0]
    text = f"FAIL  tick{sample}".rstrip().splitlines()
    got = "\n".join(line.strip().removeprefix("got").strip() for line in text[4:6])
    failure = Failure(
        rule="tick",
        flight="first",
        sent="Observation, tick 4, awaiting_command true",
        expected="a Command with tick 4",
        got=got,
    )
    assert Finding(rule=RULES["tick"], status="failed", failure=failure).as_lines() == text


def test_every_session_is_on_the_page():
    variations = {rule.variation for rule in RULES.values()} - {"plain"}
    section = PAGE.partition("## The sessions")[2].partition("When the first session")[0]
    assert set(re.findall(r"^\| ([a-z ]+) \| ", section, re.MULTILINE)) - {"session"} == variations | {"first", "again"}
