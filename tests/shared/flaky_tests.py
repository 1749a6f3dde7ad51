"""Second tries of tests: `tests/flaky_tests.yaml` names who gets them and why; no other test gets one."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest
import yaml

N_RERUNS = 2
UNKNOWN = pytest.StashKey[list[str]]()


def mark_flaky_tests(config: pytest.Config, items: Iterable[pytest.Item], table: Path) -> None:
    """Give the tests that a table names up to two more tries, each shown as R.

    Where the whole suite was collected, names that no test has are kept for `find_unknown_names`.

    Args:
        config: What was asked for.
        items: All tests that were collected, before any is left out by a mark or a word.
        table: A YAML file: by test (`tests/unit/test_one.py::test_law`, without parameters) the reason.

    Raises:
        pytest.UsageError: a test has no reason.
    """
    reasons: Mapping[str, str | None] = yaml.safe_load(table.read_text(encoding="utf-8")) or {}
    if unexplained := [name for name, reason in reasons.items() if not str(reason or "").strip()]:
        raise pytest.UsageError(
            f"{table}: expected a reason beside each test, was none beside {', '.join(unexplained)}"
        )
    found: set[str] = set()
    for item in items:
        name = item.nodeid.partition("[")[0]
        if name in reasons:
            found.add(name)
            item.add_marker(pytest.mark.flaky(reruns=N_RERUNS))
    if is_whole_suite(config):
        config.stash[UNKNOWN] = [name for name in reasons if name not in found]


def find_unknown_names(config: pytest.Config) -> list[str] | None:
    """Return the names in the table that no test has; None where a part of the suite was collected."""
    return config.stash.get(UNKNOWN, None)


def is_whole_suite(config: pytest.Config) -> bool:
    """Return whether all tests are collected, of which marks and words may leave some out."""
    if config.option.ignore or config.option.ignore_glob or config.option.deselect:
        return False
    asked = {(config.invocation_params.dir / path).resolve() for path in config.args}
    return asked == {(config.rootpath / path).resolve() for path in config.getini("testpaths")}
