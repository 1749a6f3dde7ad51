"""`gslcosim reality`: the table, JSON, the page, and what is told of wrong calls."""

import json
import shutil
from pathlib import Path

import pytest
from laser_campaigns import write_lasers

from gslcosim.cli.main import main

STUDIES = Path(__file__).parents[5] / "docs" / "studies"


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


def test_errors_of_runs_are_made_anew_from_stored_results(tmp_path, field, capsys):
    shutil.copytree(STUDIES / "reality", tmp_path / "reality")
    (tmp_path / "reality" / "expected-error.json").unlink()
    assert main(["reality", "--data", str(field), "--only", "expected-error", "--out", str(tmp_path), "--json"]) == 0
    (stored,) = json.loads(capsys.readouterr().out)
    assert stored == json.loads((STUDIES / "reality" / "expected-error.json").read_text(encoding="utf-8"))
    assert (tmp_path / "reality.md").read_text(encoding="utf-8") == (STUDIES / "reality.md").read_text(encoding="utf-8")


def test_errors_of_runs_need_results(field, capsys):
    assert main(["reality", "--data", str(field), "--only", "expected-error"]) == 2
    said = capsys.readouterr().err
    assert "expected what a case needs (expected-error: --out with results of others), found our_field" in said
