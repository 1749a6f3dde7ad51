from pathlib import Path

import pytest
from end_to_end_marks import end_runs_left_over as end_runs_left_over
from end_to_end_marks import mark_tests


def pytest_collection_modifyitems(items):
    """Every test of this folder starts real processes."""
    mark_tests(items, Path(__file__).parent, pytest.mark.end_to_end, pytest.mark.slow)
