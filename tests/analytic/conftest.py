import importlib.util
import sys
from pathlib import Path

import pytest

STUDIES_DIR = Path(__file__).parents[2] / "docs" / "studies"


def load_study(name):
    """A script of docs/studies as a module."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, STUDIES_DIR / f"{name}.py")
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


@pytest.fixture
def robot_study():
    return load_study("robot_accuracy")


@pytest.fixture(scope="module")
def plume_study():
    return load_study("plume_statistics")


# One test for each line of the report.
def pytest_generate_tests(metafunc):
    if "figure" in metafunc.fixturenames:
        figures = load_study("robot_accuracy").figures()
        metafunc.parametrize("figure", figures, ids=[figure.name for figure in figures])
