"""docs/extend/layout.md is true: its steps, taken on a copy of the package, give a room."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "extend" / "layout.md").read_text()
STEP = re.compile(r"^In `([^`]+)`, before `([^`]+)`:\n\n```python\n(.*?)```", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(ROOT / "gslcosim", folder / "gslcosim", ignore=shutil.ignore_patterns("__pycache__"))
    for name, place, block in STEP.findall(PAGE):
        file = folder / name
        text = file.read_text()
        assert text.count(f"\n{place}") == 1, f"{name}: {place}"
        file.write_text(text.replace(f"\n{place}", f"\n{block}{place}"))
    return folder


def gslcosim(copy, *words):
    code = "import sys; from gslcosim.cli.main import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", code, *words], cwd=copy, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(copy)},
    )  # fmt: skip


def test_a_layout_is_two_files():
    assert len({name for name, _, _ in STEP.findall(PAGE)}) == 2


@pytest.mark.slow
def test_the_steps_give_a_room_with_its_columns(copy):
    assert '"columns"' in gslcosim(copy, "list", "layouts", "--json").stdout
    made = gslcosim(copy, "environment", "generate", "columns", "--out", "hall", "--set", "wind.solver=uniform")
    assert made.returncode == 0, made.stderr
    scene = (copy / "hall" / "scene.xml").read_text()
    assert {f"column_{i}" for i in range(6)} <= set(re.findall(r'name="(column_\d)"', scene))
