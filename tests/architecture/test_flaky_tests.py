"""Second tries: those that the table names get them, nobody else, and a name without a test is an error."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import PROCESS_S
from flaky_tests import find_unknown_names

SHARED = Path(__file__).parents[1] / "shared"
CONFTEST = """
from pathlib import Path
import pytest
from flaky_tests import mark_flaky_tests

@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    mark_flaky_tests(config, items, Path(__file__).parent / "flaky.yaml")
"""
TESTS = """
import pytest
from flaky_tests import find_unknown_names

tries = []

def test_names(pytestconfig):
    assert not find_unknown_names(pytestconfig)

@pytest.mark.parametrize("word", ["only"])
def test_passes_at_last(word):
    tries.append(word)
    assert len(tries) > 2

def test_passes():
    pass
"""


def test_each_name_in_the_table_has_a_test(pytestconfig):
    """A test that has another name now would lose its second try, or its entry."""
    if (unknown := find_unknown_names(pytestconfig)) is None:
        pytest.skip("a part of the suite was collected")
    assert unknown == []


@pytest.fixture
def run_suite(tmp_path):
    (tmp_path / "tests").mkdir()
    (tmp_path / "pytest.ini").write_text(f"[pytest]\ntestpaths = tests\npythonpath = {SHARED}\n")
    (tmp_path / "tests" / "conftest.py").write_text(CONFTEST)
    (tmp_path / "tests" / "test_some.py").write_text(TESTS)

    def run(table, *words):
        (tmp_path / "tests" / "flaky.yaml").write_text(table)
        call = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:randomly", *words]
        # A developer's own options, such as reruns of all tests, are not this suite's.
        environment = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}
        ended = subprocess.run(
            call, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=PROCESS_S, check=False
        )
        return ended.returncode, ended.stdout + ended.stderr

    return run


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["0", "1"])
def test_a_test_that_is_named_is_tried_again(run_suite, processes):
    code, told = run_suite("tests/test_some.py::test_passes_at_last: a reason", "-n", processes)
    assert code == 0, told
    assert "3 passed, 2 rerun" in told


@pytest.mark.slow
def test_no_other_test_is_tried_again(run_suite):
    code, told = run_suite("tests/test_some.py::test_passes: a reason")
    assert code == 1
    assert "1 failed, 2 passed in" in told


@pytest.mark.slow
@pytest.mark.parametrize("words", [("-n", "0"), ("-n", "1"), ("-n", "0", "-k", "test_names")], ids=" ".join)
def test_a_name_without_a_test_fails_where_the_whole_suite_is_collected(run_suite, words):
    """Also where a part of what was collected is left out, as in `make test`."""
    table = "{tests/test_some.py::test_gone: a reason, tests/test_some.py::test_passes_at_last: a reason}"
    code, told = run_suite(table, *words)
    assert code == 1
    assert "assert not ['tests/test_some.py::test_gone']" in told
    code, told = run_suite(table, "tests/test_some.py")
    assert code == 0, told


@pytest.mark.slow
def test_a_name_without_a_reason_is_an_error(run_suite):
    code, told = run_suite("tests/test_some.py::test_passes:")
    assert code == pytest.ExitCode.USAGE_ERROR
    assert "expected a reason beside each test, was none beside tests/test_some.py::test_passes" in told
