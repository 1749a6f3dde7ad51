"""Overrides of single values on the command line: `--set path=value`."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from gslcosim.base.bundled import PROGRAM_ENDINGS
from gslcosim.base.problems import Problem
from gslcosim.base.scenario_keys import list_inputs
from gslcosim.scenario.checks.program_checks import SCRIPT_ENDINGS
from gslcosim.scenario.problems import (
    InvalidScenarioError,
    LocatedProblem,
    TextLocation,
    TextLocations,
    child_path,
    parent_path,
)
from gslcosim.scenario.serialization import YamlTree, read_yaml

# The first word of a command is a path only with a slash, and the second only if it is a script.
_PYTHON = re.compile(r"agents\[\d+\]\.start\.python")
_COMMAND = re.compile(r"agents\[\d+\]\.start\.command\[(\d+)\]")
SET_OPTION = "--set"
SEED_OPTION = "--seed"
_PATH = re.compile(r"^[A-Za-z_]\w*(\[\d+\])*(\.[A-Za-z_]\w*(\[\d+\])*)*$")
_SEGMENT = re.compile(r"[A-Za-z_]\w*|\d+")


def make_paths_absolute(path: str, value: Any, directory: Path) -> Any:
    """Return a value with all relative paths in it made absolute.

    Args:
        path: Path of the value in the scenario.
        value: A plain value, or a block or list of them; not modified.
        directory: Base of relative paths.
    """
    if isinstance(value, dict):
        return {
            key: make_paths_absolute(child_path(path, key), inner, directory)
            for key, inner in cast("dict[str, Any]", value).items()
        }
    if isinstance(value, list):
        items = enumerate(cast("list[Any]", value))
        return [make_paths_absolute(child_path(path, i), inner, directory) for i, inner in items]
    if isinstance(value, str) and _is_path(path, value):
        return str(directory / Path(value).expanduser())
    return value


def _is_path(path: str, text: str) -> bool:
    if re.sub(r"\[\d+\]", "[]", path) in {each.place for each in list_inputs()}:
        return True
    if _PYTHON.fullmatch(path):
        return "/" in text or text.endswith(PROGRAM_ENDINGS)
    if command := _COMMAND.fullmatch(path):
        word = int(command[1])
        return (word == 0 and "/" in text) or (word == 1 and text.endswith(SCRIPT_ENDINGS))
    return False


def apply_overrides(
    tree: YamlTree, overrides: Sequence[str], *, seed: int | None = None, source: str = SET_OPTION
) -> YamlTree:
    """Return the tree with values replaced, each marked with its option.

    An override that is not `path=value`, or whose path leads nowhere, becomes one of the tree's problems.

    Args:
        tree: The file's values; they are not modified.
        overrides: Texts like `agents[0].vehicle.hold_s=1`, values in YAML; later ones win.
        seed: Replaces the scenario's seed.
        source: Location of the overrides in problems. Relative paths of a `--set` start at the working directory.
    """
    marks = TextLocations(tree.marks.root, dict(tree.marks.places))
    values = _copy(tree.values)
    problems = list(tree.problems)
    for text in overrides:
        try:
            path, value = _parse(text, source)
            if source == SET_OPTION:
                value = make_paths_absolute(path, value, Path.cwd())
            _put(values, path, value, source)
            _mark(marks, path, TextLocation(source=source))
        except InvalidScenarioError as error:
            problems += error.problems
    if seed is not None and isinstance(values, dict):
        values["seed"] = seed
        _mark(marks, "seed", TextLocation(source=SEED_OPTION))
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


def _mark(marks: TextLocations, path: str, place: TextLocation) -> None:
    parent = parent_path(path)
    while parent and parent not in marks.places:
        marks.places[parent] = place
        parent = parent_path(parent)
    for below in [p for p in marks.places if p.startswith((f"{path}.", f"{path}["))]:
        del marks.places[below]
    marks.places[path] = place


def _refusal(source: str, path: str, expected: str, found: str, remedy: str) -> InvalidScenarioError:
    problem = Problem(where=path, expected=expected, found=found, remedy=remedy)
    return InvalidScenarioError([LocatedProblem(place=TextLocation(source=source), problem=problem)], name=source)


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copy(inner) for key, inner in cast("dict[str, Any]", value).items()}
    return [_copy(inner) for inner in cast("list[Any]", value)] if isinstance(value, list) else value
