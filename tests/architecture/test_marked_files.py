"""Files of tests that a mark leaves out are not imported, and no test is lost by it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import PROCESS_S
from marked_files import MISREAD

SHARED = Path(__file__).parents[1] / "shared"
CONFTEST = """
from marked_files import is_left_out

def pytest_ignore_collect(collection_path, config):
    return True if is_left_out(collection_path, config) else None
"""
FILES = {
    "test_plain.py": "print('plain is imported')\n\ndef test_plain():\n    pass\n",
    "test_slow.py": "import pytest\n\n@pytest.mark.slow\ndef test_slow():\n    pass\n",
    "given_marks.py": "import pytest\n\nboth = pytest.mark.tour\n",
    "test_by_import.py": "from given_marks import both\n\n@both\ndef test_by_import():\n    pass\n",
}


def test_the_marks_of_every_test_are_seen_in_its_file(pytestconfig):
    assert pytestconfig.stash[MISREAD] == []


@pytest.mark.parametrize(
    ("marks", "found"),
    [
        ("slow", {"test_slow"}),
        ("tour and not soak", {"test_by_import"}),
        ("not soak and (tour or not tour and slow)", {"test_slow", "test_by_import"}),
        ("not slow", {"test_plain", "test_by_import"}),
    ],
)
def test_tests_that_are_asked_for_are_found(tmp_path, marks, found):
    (tmp_path / "tests").mkdir()
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {SHARED} tests\nmarkers =\n slow\n tour\n soak\n")
    for name, text in {"conftest.py": CONFTEST, **FILES}.items():
        (tmp_path / "tests" / name).write_text(text)
    call = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-s", "--collect-only", "-q", "-m", marks]
    ended = subprocess.run(
        call, cwd=tmp_path, env={k: v for k, v in os.environ.items() if k != "PYTEST_ADDOPTS"}, capture_output=True,
        text=True, check=False, timeout=PROCESS_S,
    )  # fmt: skip
    assert {line.rpartition("::")[2] for line in ended.stdout.splitlines() if "::" in line} == found, ended.stdout
    assert ("plain is imported" in ended.stdout) == ("test_plain" in found)
