"""docs/events.md: its commands are carried out, and it has every event."""

import json
import re
import shlex
from pathlib import Path

import pytest

from gslcosim.cli.main import main
from gslcosim.scenario.model_schema import find_schema_node, item_annotation, list_blocks
from gslcosim.scenario.models.scenario import Scenario

PAGE = (Path(__file__).parents[2] / "docs" / "events.md").read_text()


def test_the_page_has_every_event():
    table = PAGE.split("## What\n")[1].split("\n## ")[0]
    rows = [name for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)]
    names = list_blocks(item_annotation(find_schema_node(("events",), root=Scenario).annotation))
    assert sorted(set(rows) - {"what"}) == sorted(names)


@pytest.mark.slow
@pytest.mark.end_to_end
def test_the_example_runs_and_prints_what_the_page_shows(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, second = re.findall(r"```sh\n(gslcosim up .*)\n```", PAGE)
    assert main([*shlex.split(first)[1:], "--in-process", "--quiet"]) in (0, 1)
    assert main([*shlex.split(second)[1:], "--in-process", "--quiet"]) == 0
    capsys.readouterr()
    (path,) = (tmp_path / "runs").glob("event_source*/result.json")
    (shown,) = re.findall(r'```json\n"events": (\[.*\])\n```', PAGE)
    assert json.loads(path.read_text())["events"][:1] == json.loads(shown)


def test_what_goes_wrong_is_reported_as_the_page_says(capsys):
    ((line, output),) = re.findall(r"```console\n\$ (gslcosim .*)\n(.*)\n```", PAGE)
    assert main(shlex.split(line)[1:]) == 2
    said = capsys.readouterr()
    assert output in said.out + said.err
