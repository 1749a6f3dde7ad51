"""Constants of a module stand before its first class or function, unless they need what is defined above them."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("gslcosim", "services", "extensions", "agents")
# Folders with programs of users, and with tests.
OTHER_FOLDERS = {"templates", "tests"}
DEFINITIONS = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def find_late_constants(source):
    """Return the constants behind the first class or function that could stand before it."""
    defined, late = set(), []
    for node in ast.parse(source).body:
        if isinstance(node, DEFINITIONS):
            defined.add(node.name)
        elif defined:
            names = [each for each in ast.walk(node) if isinstance(each, ast.Name)]
            stored = {each.id for each in names if isinstance(each.ctx, ast.Store)}
            if not isinstance(node, ast.Assign | ast.AnnAssign) or any(each.id in defined for each in names):
                defined |= stored
            else:
                late += sorted(stored - {"__all__"})
    return late


@pytest.mark.parametrize("package", PACKAGES)
def test_constants_stand_before_the_first_definition(package):
    paths = sorted((ROOT / package).rglob("*.py"))
    modules = [path for path in paths if not OTHER_FOLDERS & set(path.relative_to(ROOT).parts)]
    found = {path.name: find_late_constants(path.read_text()) for path in modules}
    assert {name: late for name, late in found.items() if late} == {}


def test_a_constant_behind_a_function_is_found_unless_it_needs_one_above():
    source = "A = 1\ndef f(): ...\nB = 2\nC = f()\nD = C\nfor E in (): ...\nF: int = 3\nG = E"
    assert find_late_constants(source) == ["B", "F"]
