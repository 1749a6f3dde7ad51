"""One name, one thing: no two public classes or modules of one name, outside of what is listed here with its reason."""

import ast
import re
from collections import defaultdict
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "gslcosim"

# Modules that mean the same in each package, or whose package says which of two is meant.
MODULES = {
    "core", "ports",  # of each participant
    "agent", "export", "participant", "schema",  # commands of the command line, beside what they call
    "frames", "solve", "making", "preparing", "planning", "running", "loading", "judging", "writing", "flying",
    "flight", "page", "figures", "rules", "problems", "places", "random_places", "assembly", "case",
    "beliefs", "columns", "contacts", "instruments", "legs", "onboard", "scene", "course",
}  # fmt: skip
# Words of two trades that never meet in one module.
CLASSES = {
    "Command",  # of an agent, in the contract; of the command line
    "Room", "Leg",  # of the world; as search methods see them
    "Finding", "Problem",  # of a search method, of a scenario; of the conformance kit
    "Estimate", "Declared",  # of a method's declaration; of statistics, of a flight
}  # fmt: skip


def files():
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path.stem not in ("__init__", "__main__")]


def twice(found):
    return {name: places for name, places in found.items() if len(places) > 1}


def modules():
    found = defaultdict(list)
    for path in files():
        found[path.stem].append(path.relative_to(PACKAGE).as_posix())
    return twice(found)


def classes():
    found = defaultdict(list)
    for path in files():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(path.relative_to(PACKAGE).as_posix())
    return twice(found)


def test_no_two_modules_have_one_name():
    assert {name: places for name, places in modules().items() if name not in MODULES} == {}


def test_no_two_public_classes_have_one_name():
    assert {name: places for name, places in classes().items() if name not in CLASSES} == {}


def test_the_lists_name_nothing_that_is_not_there():
    assert MODULES - modules().keys() == set()
    assert CLASSES - classes().keys() == set()


def test_only_modules_that_a_decision_names_are_long():
    page = (PACKAGE.parent / "docs" / "decisions" / "0020-rooms-of-packages.md").read_text()
    named = set(re.findall(r"`([\w/]+\.py)`", page.split("**Modules above 350 lines.**")[1]))
    long = {path.relative_to(PACKAGE).as_posix() for path in files() if len(path.read_text().splitlines()) > 350}
    assert long == named
