"""Validation errors of pydantic, as place, expected, found and remedy."""

import json
import re
import typing
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from gslcosim.scenario.model_schema import (
    SchemaNode,
    Segment,
    find_schema_node,
    find_tag_key,
    holds_blocks,
    kinds_with_key,
    list_keys,
    list_kinds,
    list_words,
    paths_of_key,
)
from gslcosim.scenario.models.base import RULE
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.problems import Problem, child_path, parent_path
from gslcosim.scenario.suggestions import did_you_mean, nearest_key
from gslcosim.scenario.units import number_in_unit_of, read_quantity, unit_name, unit_suffix

MISSING = "missing"
_UNKNOWN_KEY = "an unknown key"
# Nobody reads more, and finding what each of them was meant to be takes its time.
_MAX_PROBLEMS = 100
_MAX_SHOWN = 60


def problems_from_validation(error: ValidationError, *, root: type[BaseModel] = Scenario) -> list[Problem]:
    """Return each problem of a validation once, at the deepest place that the models know.

    Args:
        error: What pydantic says.
        root: The model that was validated.
    """
    problems: dict[str, Problem] = {}
    if (n_more := error.error_count() - _MAX_PROBLEMS) > 0:
        found = f"{n_more} more than those that are told"
        problems[""] = Problem(path="", expected="fewer problems", found=found, remedy="Correct these first.")
    for details in error.errors(include_url=False)[:_MAX_PROBLEMS]:
        problem = _problem_of(details, root)
        if problem is not None:
            problems.setdefault(problem.path, problem)
    suggested = {place for problem in problems.values() if (place := _suggested_path(problem))}
    return [p for p in problems.values() if not (p.found == MISSING and p.path in suggested)]


# A misspelled key is one problem, not two: the key that it stands for is then missing as well.
def _suggested_path(problem: Problem) -> str | None:
    match = re.match(r"Did you mean (\w+)\?", problem.remedy)
    return child_path(parent_path(problem.path), match[1]) if match and problem.found == _UNKNOWN_KEY else None


def _problem_of(details: ErrorDetails, root: type[BaseModel]) -> Problem | None:
    location: tuple[Segment, ...] = details["loc"]
    value = details["input"]
    slot = find_schema_node(location, root=root)
    match details["type"]:
        case rule if rule == RULE:
            context = details.get("ctx", {})
            path = child_path(slot.path, context["key"]) if context["key"] else slot.path
            return Problem(path=path, expected=context["expected"], found=context["found"], remedy=context["remedy"])
        case "default_factory_not_called":
            return None  # what the default depends on is wrong, and told
        case "extra_forbidden":
            return _unknown_key(location[:-1], str(location[-1]), value, root)
        case "missing" if isinstance(location[-1], int):
            return _wrong_value(find_schema_node(location[:-1], root=root), value)
        case "missing":
            return Problem(path=slot.path, expected=slot.describe(), found=MISSING)
        case "union_tag_invalid" | "union_tag_not_found" if isinstance(value, dict):
            return _unknown_kind(slot, typing.cast("dict[str, Any]", value))
        case "too_short" if isinstance(value, list) and typing.cast("list[Any]", value):
            return None  # pydantic counts only the valid items; those that are not have their own problems
        case _:
            return _wrong_value(slot, value)


def _wrong_value(slot: SchemaNode, value: Any) -> Problem:
    return Problem(
        path=slot.path, expected=slot.describe(), found=format_value(value), remedy=_value_remedy(slot, value)
    )


def _unknown_kind(slot: SchemaNode, block: dict[str, Any]) -> Problem:
    kinds, tag_key = list_kinds(slot.annotation), find_tag_key(slot.annotation)
    kind = block.get(tag_key)
    return Problem(
        path=child_path(slot.path, tag_key),
        expected=f"one of {', '.join(kinds[:-1])} or {kinds[-1]}",
        found=format_value(kind),
        remedy=did_you_mean(kind, kinds) if isinstance(kind, str) else "",
    )


def _unknown_key(location: tuple[Segment, ...], key: str, value: Any, root: type[BaseModel]) -> Problem:
    block = find_schema_node(location, root=root)
    keys = list_keys(block.model) if block.model else []
    path = child_path(block.path, key)
    expected = f"one of the keys {', '.join(keys)}"
    if (remedy := _kinds_that_have(location, key, root)) and key not in keys:
        return Problem(path=path, expected=expected, found=_UNKNOWN_KEY, remedy=remedy)
    match = nearest_key(key, keys)
    homes = [home for home in paths_of_key(key, root=root) if home != block.path]
    if match:
        remedy = f"Did you mean {match}?{_unit_hint(key, find_schema_node((*location, match), root=root), value)}"
    elif homes:
        remedy = f"{key} belongs to {' or '.join(home or 'the top level' for home in homes)}."
    else:
        remedy = ""
    return Problem(path=path, expected=expected, found=_UNKNOWN_KEY, remedy=remedy)


# A key that other kinds of the same block have.
def _kinds_that_have(location: tuple[Segment, ...], key: str, root: type[BaseModel]) -> str:
    for end in range(len(location), 0, -1):
        annotation = find_schema_node(location[:end], root=root).annotation
        if kinds := kinds_with_key(annotation, key):
            return f"{key} belongs to {find_tag_key(annotation)}: {', '.join(kinds)}."
    return ""


def _unit_hint(key: str, meant: SchemaNode, value: Any) -> str:
    unit = unit_name(meant.key)
    if not unit or unit_suffix(key) == unit_suffix(meant.key):
        return ""
    written = read_quantity(value) if isinstance(value, str) and meant.annotation in (int, float) else None
    number = written and number_in_unit_of(meant.key, written)
    return f" It is in {unit}." if number is None else f" Write {meant.key}: {number:.6g}, in {unit}."


def format_value(value: Any) -> str:
    """Return a value as people write it in YAML, shortened."""
    if value is None:
        return "nothing"
    if isinstance(value, float):
        return repr(value)
    text = f"'{value}'" if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _MAX_SHOWN else f"{text[: _MAX_SHOWN - 3]}..."


def _value_remedy(slot: SchemaNode, value: Any) -> str:
    if isinstance(value, str) and len(value) > _MAX_SHOWN:
        return ""
    kind = slot.annotation
    if words := list_words(kind):
        return did_you_mean(value, words) if isinstance(value, str) else ""
    if kind in (float, int):
        return _number_remedy(slot, value)
    if kind is bool:
        return "Write true or false." if isinstance(value, str | int) else ""
    if kind is str:
        return _name_remedy(value) if slot.constraints else _text_remedy(value)
    if holds_blocks(kind) and not isinstance(value, list):
        return "Begin each block with a dash."
    if typing.get_origin(kind) is tuple and not isinstance(value, list | tuple):
        return "Put it in brackets: [ … ]."
    return ""


def _number_remedy(slot: SchemaNode, value: Any) -> str:
    if isinstance(value, float) and slot.annotation is int and value.is_integer():
        return f"Write {int(value)}."
    quantity = read_quantity(value) if isinstance(value, str) else None
    if quantity is None:
        return ""
    number = number_in_unit_of(slot.key, quantity)
    if not quantity.unit:
        return f"Write it without quotes: {quantity.number:.15g}."
    unit = unit_name(slot.key)
    if number is None:
        return f"Give the number in {unit} without a unit." if unit else "Give the number without a unit."
    return f"Give the number in {unit} without a unit: {number:.6g}."


def _name_remedy(value: Any) -> str:
    words = re.sub(r"[^a-z0-9]+", "_", str(value).lower()).strip("_")
    name = words if words[:1].isalpha() else f"n_{words}"
    return f"For example {name[:40]}." if words and isinstance(value, str) else ""


def _text_remedy(value: Any) -> str:
    return f"Put it in quotes: '{format_value(value)}'." if isinstance(value, int | float) else ""
