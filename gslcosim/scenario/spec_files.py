"""Spec files: YAML files that are one block of keys, such as suites, families of cases and trainings."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from gslcosim.base.errors import ScenarioError
from gslcosim.base.files import read_regular_file
from gslcosim.base.os_errors import describe_os_error
from gslcosim.scenario.problems import InvalidScenarioError, Problem, locate
from gslcosim.scenario.validation_errors import format_value, problems_from_validation
from gslcosim.scenario.yaml_tree import read_yaml

S = TypeVar("S", bound=BaseModel)
MAX_BYTES = 2_000_000


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

    Raises:
        ScenarioError: it cannot be read, or has problems: all of them in one error.
    """
    try:
        text = read_regular_file(path, max_bytes=MAX_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = describe_os_error(error) if isinstance(error, OSError) else "no UTF-8"
        raise ScenarioError(
            f"{shown_path}: expected a file of UTF-8 text, was one that cannot be read ({reason})."
        ) from error
    tree = read_yaml(text, source=shown_path)
    if tree.block is None:
        problem = Problem(path="", expected=f"a block of keys with {keys}", found=format_value(tree.values))
        raise InvalidScenarioError(locate([problem], tree.marks), name=shown_path)
    try:
        spec = model.model_validate_json(json.dumps(tree.block), strict=True)
    except ValidationError as error:
        problems = locate(problems_from_validation(error, root=model), tree.marks)
        raise InvalidScenarioError([*tree.problems, *problems], name=shown_path) from error
    if problems := [*tree.problems, *locate(list(check(spec)), tree.marks)]:
        raise InvalidScenarioError(problems, name=shown_path)
    return spec
