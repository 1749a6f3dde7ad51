"""Files of one block that users write beside scenarios: read with all problems at once."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from gslcosim.base.files import read_regular_file
from gslcosim.base.problems import Problem
from gslcosim.scenario.loader import MAX_BYTES, find_scenario, read_text
from gslcosim.scenario.model_schema import format_value, problems_from_validation
from gslcosim.scenario.problems import InvalidScenarioError, locate
from gslcosim.scenario.serialization import read_yaml

S = TypeVar("S", bound=BaseModel)


def find_scenario_beside(source: str, directory: Path) -> Path:
    """Return the scenario that a file in a folder names: one beside it, or a bundled one; see `find_scenario`."""
    beside = directory / source
    return find_scenario(beside if beside.is_file() else source)


def read_spec_file(
    path: Path, model: type[S], *, shown_path: str, keys: str, check: Callable[[S], Iterable[Problem]] = lambda _: ()
) -> S:
    """Return what a file says.

    Args:
        path: The file.
        model: What it has to be.
        shown_path: How errors name it.
        keys: Its required keys, for who has written no block of keys.
        check: Finds problems that the model does not.
    """
    text = read_text(path, shown_path=shown_path)
    tree = read_yaml(text, source=shown_path)
    if tree.block is None:
        problem = Problem(where="", expected=f"a block of keys with {keys}", found=format_value(tree.values))
        raise InvalidScenarioError(locate([problem], tree.marks), name=shown_path)
    try:
        spec = model.model_validate_json(json.dumps(tree.block), strict=True)
    except ValidationError as error:
        problems = locate(problems_from_validation(error, root=model), tree.marks)
        raise InvalidScenarioError([*tree.problems, *problems], name=shown_path) from error
    if problems := [*tree.problems, *locate(list(check(spec)), tree.marks)]:
        raise InvalidScenarioError(problems, name=shown_path)
    return spec


def raise_located(problems: Iterable[Problem], path: Path, *, shown_path: str) -> None:
    """Raise problems of a file that has been read, with the lines where their causes stand; do nothing without any.

    Args:
        problems: What was found.
        path: The file.
        shown_path: How errors name it.
    """
    if found := list(problems):
        tree = read_yaml(read_regular_file(path, max_bytes=MAX_BYTES).decode("utf-8-sig"), source=shown_path)
        raise InvalidScenarioError(locate(found, tree.marks), name=shown_path)
