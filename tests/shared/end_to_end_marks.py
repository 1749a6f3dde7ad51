"""Marks of tests that start real processes, and the end of runs left over, for `conftest.py` of a folder."""

from collections.abc import Iterable
from pathlib import Path

import pytest


def mark_tests(items: Iterable[pytest.Item], folder: Path, *marks: pytest.MarkDecorator) -> None:
    """Give every test of a folder marks, which `marked_files` reads where they are given."""
    for item in items:
        if folder in item.path.parents:
            for mark in marks:
                item.add_marker(mark)


@pytest.fixture(autouse=True)
def end_runs_left_over():
    from real_runs import STARTED

    yield
    while STARTED:
        STARTED.pop().abandon()
