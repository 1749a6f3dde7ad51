"""docs/extend/participant.md: every command is carried out, and what it says of rules and faults is so."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim_conformance.participant_check import PARTICIPANT_RULES
from gslcosim_conformance.scaffold import PARTICIPANT_TEMPLATES

ROOT = Path(__file__).parents[4]
PAGE = (ROOT / "docs" / "extend" / "participant.md").read_text()


def test_every_rule_is_on_the_page_with_its_words_and_in_its_order():
    rows = [f"| `{rule.id}` | {rule.sentence} | {rule.remedy} |" for rule in PARTICIPANT_RULES.values()]
    section = PAGE.partition("| rule | a right participant |")[2].partition("\n\n")[0]
    assert section.splitlines()[2:] == rows


def test_every_fault_on_the_page_is_one_that_is_reported():
    """Each stands, but for numbers and ports, in a test of the program's faults."""
    rows = re.findall(r"^\| [a-z][^`]*\| `([^`]+)`", PAGE.partition("what `result.json` says |")[2], re.MULTILINE)
    tests = (ROOT / "tests" / "integration" / "test_foreign_programs.py").read_text()
    tests += (ROOT / "tests" / "unit" / "runtime" / "external" / "test_protocol.py").read_text()
    parts = [part for row in rows for part in re.split(r"tick \d+\W*|\d[\d.]*|truth/\w+|Participant\w+: ", row)]
    assert len(rows) >= 8
    assert [part for part in parts if part.strip() not in tests] == []


@pytest.mark.slow
@pytest.mark.end_to_end
@pytest.mark.debian
def test_the_commands_of_the_page_lead_to_runs_of_one_digest(tmp_path):
    if shutil.which("cc") is None:
        pytest.skip("needs a C compiler: apt-get install gcc")
    for file in PARTICIPANT_TEMPLATES.iterdir():
        shutil.copy(file, tmp_path)
    (commands,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    lines = commands.replace("python3", sys.executable).splitlines()
    for line in lines:
        program, _, rest = line.partition(" ")
        if program == "gslcosim":
            line = f"{sys.executable} -m gslcosim {rest}"
        done = subprocess.run(line, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    digests = [json.loads(path.read_text())["digest"] for path in tmp_path.glob("runs/*/digest.json")]
    assert len(digests) == len([line for line in lines if line.startswith("gslcosim up")]) == 3
    assert len(set(digests)) == 1
