"""`--set path=value`: single values of a scenario changed on the command line."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from gslcosim.scenario.problems import (
    InvalidScenarioError,
    LocatedProblem,
    Marks,
    Place,
    Problem,
    child_path,
    parent_of,
)
from gslcosim.scenario.set_paths import from_directory
from gslcosim.scenario.yaml_tree import YamlTree, read_yaml

SET_OPTION = "--set"
SEED_OPTION = "--seed"

_PATH = re.compile(r"^[A-Za-z_]\w*(\[\d+\])*(\.[A-Za-z_]\w*(\[\d+\])*)*$")
_SEGMENT = re.compile(r"[A-Za-z_]\w*|\d+")


def apply_overrides(
    tree: YamlTree, overrides: Sequence[str], *, seed: int | None = None, source: str = SET_OPTION
) -> YamlTree:
    """Return the tree with values replaced, each marked with the option that gave it.

    An override that is not `path=value`, or whose path leads nowhere, becomes one of the tree's problems.

    Args:
        tree: The file's values; they are not modified.
        overrides: Texts like `agents[0].vehicle.hold_s=1`, values in YAML; later ones win.
        seed: Replaces the scenario's seed.
        source: What problems with them are said to stand in. Relative paths of a `--set` start at the working
            directory.
    """
    marks = Marks(tree.marks.root, dict(tree.marks.places))
    values = _copy(tree.values)
    problems = list(tree.problems)
    for text in overrides:
        try:
            path, value = _parse(text, source)
            if source == SET_OPTION:
                value = from_directory(path, value, Path.cwd())
            _put(values, path, value, source)
            _mark(marks, path, Place(source=source))
        except InvalidScenarioError as error:
            problems += error.problems
    if seed is not None and isinstance(values, dict):
        values["seed"] = seed
        _mark(marks, "seed", Place(source=SEED_OPTION))
    return YamlTree(values, marks, tuple(problems))


def _parse(text: str, source: str) -> tuple[str, Any]:
    path, equals, value_text = text.partition("=")
    path = path.strip()
    if not equals:
        raise _refusal(source, text, "path=value", f"'{text}'", "For example: agents[0].vehicle.hold_s=1")
    if not _PATH.match(path):
        numbered = re.sub(r"\.(\d+)(?=\.|$)", r"[\1]", path)
        remedy = f"Write {numbered}." if _PATH.match(numbered) else "For example: agents[0].vehicle.hold_s"
        raise _refusal(source, path, "a path of keys and [indices]", f"'{path}'", remedy)
    value = read_yaml(value_text, source=source, root_path=path)
    if value.problems:
        raise InvalidScenarioError(value.problems, name=source)
    return path, value.values


def _put(values: Any, path: str, value: Any, source: str) -> None:
    segments = [int(word) if word.isdigit() else word for word in _SEGMENT.findall(path)]
    holder: Any = values
    so_far = ""
    for segment, following in zip(segments, [*segments[1:], None], strict=True):
        _check_step(holder, segment, path, so_far, source)
        so_far = child_path(so_far, segment)
        if following is None:
            holder[segment] = value
            return
        if isinstance(holder, dict) and cast("dict[str, Any]", holder).get(str(segment)) is None:
            holder[segment] = [] if isinstance(following, int) else {}
        holder = cast("Any", holder)[segment]


def _check_step(holder: Any, segment: str | int, path: str, so_far: str, source: str) -> None:
    place = so_far or "the scenario"
    if isinstance(segment, int):
        n = len(cast("list[Any]", holder)) if isinstance(holder, list) else None
        if n is None:
            raise _refusal(source, path, f"{place} to be a list", _kind(holder), f"Leave out [{segment}].")
        if segment >= n:
            counts = f"an index below {n}, as {place} has {n} item{'s' * (n != 1)}"
            raise _refusal(source, path, counts, f"[{segment}]", "")
    elif not isinstance(holder, dict):
        remedy = f"Write {so_far}[0].{segment}." if isinstance(holder, list) else ""
        raise _refusal(source, path, f"{place} to be a block with keys", _kind(holder), remedy)


def _kind(value: Any) -> str:
    return "a list" if isinstance(value, list) else "a block" if isinstance(value, dict) else f"'{value}'"


def _mark(marks: Marks, path: str, place: Place) -> None:
    parent = parent_of(path)
    while parent and parent not in marks.places:
        marks.places[parent] = place
        parent = parent_of(parent)
    for below in [p for p in marks.places if p.startswith((f"{path}.", f"{path}["))]:
        del marks.places[below]
    marks.places[path] = place


def _refusal(source: str, path: str, expected: str, found: str, remedy: str) -> InvalidScenarioError:
    problem = Problem(path=path, expected=expected, found=found, remedy=remedy)
    return InvalidScenarioError([LocatedProblem(place=Place(source=source), problem=problem)], name=source)


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copy(inner) for key, inner in cast("dict[str, Any]", value).items()}
    return [_copy(inner) for inner in cast("list[Any]", value)] if isinstance(value, list) else value
