"""The notebook about training runs from the first cell to the last, with a tiny budget."""

import json
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).parents[4] / "docs" / "train-a-policy.ipynb"
BUDGET = {"ROUNDS": "2", "ENVS": "8", "CASES": "4"}


@pytest.mark.slow
@pytest.mark.tour
@pytest.mark.extras
def test_every_cell_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    for name, value in BUDGET.items():
        monkeypatch.setenv(f"GSLCOSIM_TRAIN_{name}", value)
    names: dict[str, Any] = {}
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    output = capsys.readouterr().out
    assert "round   2:" in output
    assert "of 4 sources that it has never seen" in output
    assert "4 pairs: " in output
    assert len(names["results"]) == 12
    assert (tmp_path / "mine.npz").is_file()
