import sys
from pathlib import Path

import pytest

# Importlib mode puts no test folder on the path; `flights` is shared by the tests of this folder.
sys.path.insert(0, str(Path(__file__).parent))


def pytest_collection_modifyitems(items):
    """Every test of this folder starts real processes."""
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.end_to_end)
            item.add_marker(pytest.mark.slow)


@pytest.fixture(autouse=True)
def _no_flight_is_left_over():
    from real_runs import STARTED

    yield
    while STARTED:
        STARTED.pop().abandon()
