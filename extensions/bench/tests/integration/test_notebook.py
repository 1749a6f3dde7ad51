"""The notebook about the benchmark from Python runs from the first cell to the last."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).parents[4] / "docs" / "benchmark" / "python.ipynb"


@pytest.mark.end_to_end
def test_every_cell_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    output = capsys.readouterr().out
    assert "12 trials of ('dung_beetle', 'oracle', 'random_walker')" in output
    assert re.search(r"2 pairs: [+]\d[.]\d\d in success", output)
    assert output.count("nearest 0.") == 2
