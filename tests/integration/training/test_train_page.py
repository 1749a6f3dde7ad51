"""The programs of docs/train.md run as they stand."""

import re
from pathlib import Path

import pytest

pytest.importorskip("pettingzoo", reason="extra gym")

PAGE = Path(__file__).parents[3] / "docs" / "train.md"
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS, ids=range(len(PROGRAMS)))
def test_a_program_of_the_page_runs(program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(program, str(PAGE), "exec"), {"__name__": "__main__"})
    assert list(tmp_path.iterdir()) == []
