"""The programs of docs/train.md run as they stand."""

import re
from pathlib import Path

import pytest

from gslcosim.cli.main import main
from gslcosim_training.family import load_family
from gslcosim_training.train_file import load_train_file

PAGE = Path(__file__).parents[4] / "docs" / "train.md"
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS, ids=range(len(PROGRAMS)))
def test_a_program_of_the_page_runs(program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(program, str(PAGE), "exec"), {"__name__": "__main__"})
    assert list(tmp_path.iterdir()) == []


def test_train_files_and_families_of_the_page_are_valid(tmp_path):
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    family, train, method = (
        next(block for block in blocks if text in block)
        for text in ("gslcosim/family/1", "kind: ctrnn", "kind: method")
    )
    (tmp_path / "family.yaml").write_text(family.replace("hall.yaml", "tiny_room"))
    (tmp_path / "train.yaml").write_text(train)
    assert load_family(tmp_path / "family.yaml").values_of("test", 0)["environment.layout.seed"] >= 50000
    assert load_train_file(tmp_path / "train.yaml").spec.trainer.kind == "ctrnn"
    (tmp_path / "method.yaml").write_text(method)
    assert load_train_file(tmp_path / "method.yaml").spec.trainer.robots == 3


@pytest.mark.slow
def test_the_first_training_of_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    lines = re.findall(r"^gslcosim (train open_halls_tiny.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(lines) == 2
    for line in lines:
        assert main([*line.split(), "--record", "0"]) == 0
    assert "4 rounds" in capsys.readouterr().out
    assert (tmp_path / "trained" / "open_halls_tiny" / "policy.npz").is_file()
