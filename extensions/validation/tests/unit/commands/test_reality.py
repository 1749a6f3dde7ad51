"""`gslcosim reality`: the table, JSON, the page, and what is told of wrong calls."""

import json

import pytest
from laser_campaigns import write_lasers

from gslcosim.cli.main import main


@pytest.fixture
def field(tmp_path):
    return write_lasers(tmp_path / "our_field")


def test_a_table_of_goals_for_data_of_any_name(field, capsys):
    assert main(["reality", "--data", str(field), "--only", "laser-forward"]) == 0
    out = capsys.readouterr().out
    assert "our_field   source_5: FAC2 of 30 beam minutes" in out
    assert "goals are met." in out


def test_results_as_json_and_as_a_page(field, tmp_path, capsys):
    folder = tmp_path / "page"
    words = ["reality", "--data", str(field), "--only", "laser-forward", "--quick", "--out", str(folder), "--json"]
    assert main(words) == 0
    stored = json.loads(capsys.readouterr().out)
    assert [result["case"] for result in stored] == ["laser-forward"]
    assert stored[0]["rows"][0]["goal"] == "≥ 0.5"
    assert "our_field" in (folder / "reality.md").read_text(encoding="utf-8")


def test_data_that_no_chosen_case_can_use_is_told(tmp_path, capsys):
    (tmp_path / "published.json").write_text('{"entries": []}')
    assert main(["reality", "--data", str(tmp_path), "--only", "laser-forward"]) == 2
    said = capsys.readouterr().err
    assert "--data: expected what a case needs (laser-forward: laser_paths), found no set." in said
