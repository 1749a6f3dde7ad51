"""docs/extend/mox_model.md is true: its steps, taken on a copy, change the model in single runs and compiled."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import BUILD_S

ROOT = Path(__file__).parents[2]
KIT = ROOT / "tests" / "kit"
PAGE = (ROOT / "docs" / "extend" / "mox_model.md").read_text()
CODE = r"\n\n```python\n(.*?)```"
CHANGE = re.compile(rf"^In `([^`]+)`,{CODE}\n\nbecomes{CODE}", re.MULTILINE | re.DOTALL)
MODEL, TEST = "services/sensing/models/mox.py", "tests/unit/services/sensing/test_mox.py"


@pytest.fixture
def copy(tmp_path):
    for name in ("gslcosim", "services"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "gslcosim_services").symlink_to("services")
    for name in (TEST, "tests/unit/test_scalar_kernels.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def run_tests(copy):
    (command,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    program, *words = shlex.split(command)
    assert program == "pytest"
    plain = ["--import-mode=importlib", "-q", "-c", os.devnull, "--rootdir", str(copy), "-p", "no:cacheprovider"]
    # This process has set the folder of its own kernels.
    variables = {name: text for name, text in os.environ.items() if not name.startswith("NUMBA")}
    return subprocess.run(
        [sys.executable, "-m", "pytest", *plain, "-k", "mox or tgs2600", *words],
        env=variables | {"PYTHONPATH": f"{copy}{os.pathsep}{KIT}", "GSLCOSIM_CACHE": str(copy / "cache")},
        cwd=copy, capture_output=True, text=True, check=False, timeout=BUILD_S,
    )  # fmt: skip


def test_the_model_is_one_file():
    assert {name for name, _, _ in CHANGE.findall(PAGE)} == {MODEL}


@pytest.mark.slow
def test_the_steps_change_the_model(copy):
    (added,) = re.findall(rf"At the end of `{TEST}`:{CODE}", PAGE, re.DOTALL)
    (line,) = re.findall(r"with `(.*?)` at its top", PAGE)
    test = copy / TEST
    test.write_text(f"{line}\n{test.read_text()}\n\n{added}")
    before = run_tests(copy)
    assert "1 failed" in before.stdout, before.stdout + before.stderr
    assert "housing_s" in before.stdout
    for name, old, new in CHANGE.findall(PAGE):
        text = (copy / name).read_text()
        # Some blocks end within a line.
        old, new = old.rstrip("\n"), new.rstrip("\n")
        assert text.count(old) == 1, old
        (copy / name).write_text(text.replace(old, new))
    after = run_tests(copy)
    assert after.returncode == 0, after.stdout + after.stderr
