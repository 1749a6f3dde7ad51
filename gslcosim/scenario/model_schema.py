"""Schema of the models: values allowed at each place of a scenario, their settings, and errors in the same words."""

import json
import re
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast

import annotated_types
from pydantic import BaseModel, StringConstraints, Tag, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticUndefined

from gslcosim.base.extensions import find_remedy
from gslcosim.base.problems import RULE, Problem
from gslcosim.base.units_of_measure import number_in_unit_of, read_quantity, unit_name, unit_suffix
from gslcosim.scenario.models.base import KindedSpec, OneOf
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.problems import (
    child_path,
    did_you_mean,
    nearest_key,
    parent_path,
)

Segment = str | int
MISSING = "missing"
_UNKNOWN_KEY = "an unknown key"
# More are of no use to a reader, and the search for suggestions takes time.
_MAX_PROBLEMS = 100
_MAX_SHOWN = 60


@dataclass(frozen=True, kw_only=True)
class SchemaNode:
    """A place that the models define: its path, the key whose name has the unit, and the annotation."""

    path: str
    key: str
    annotation: Any
    constraints: tuple[Any, ...] = ()

    @property
    def model(self) -> type[BaseModel] | None:
        """The model of the block that belongs here, if it is a block."""
        return find_model(self.annotation)

    def describe(self) -> str:
        """Return the allowed values in words: `a number greater than 0 in metres`."""
        return _describe(self.annotation, self.constraints, unit_name(self.key))


def find_schema_node(location: tuple[Segment, ...], *, root: type[BaseModel] = Scenario) -> SchemaNode:
    """Return the deepest place on the way to a location that the models define; an unknown key ends the way.

    Args:
        location: Keys and indices from the outermost block inwards.
        root: The model of the outermost block.
    """
    slot = SchemaNode(path="", key="", annotation=root)
    for segment in location:
        inner = _inner_slot(slot, segment)
        if inner is None:
            return slot
        slot = inner
    return slot


def list_keys(model: type[BaseModel]) -> list[str]:
    """Return the keys that a block may have, as written in a file."""
    return [field.alias or name for name, field in model.model_fields.items()]


def paths_of_key(key: str, *, root: type[BaseModel] = Scenario) -> list[str]:
    """Return the places of all blocks, written like `agents[].vehicle`, that have a certain key."""
    return list(dict.fromkeys(path for path, model in _all_blocks(root, "") if key in list_keys(model)))


def list_words(annotation: Any) -> list[str]:
    """Return the fixed words that an annotation allows, such as the names of the wind solvers."""
    kinds = _kinds_of_union(annotation) or [annotation]
    literals = [kind for kind in kinds if typing.get_origin(kind) is Literal]
    return [str(word) for literal in literals for word in typing.get_args(literal)]


def list_kinds(annotation: Any) -> list[str]:
    """Return the kinds that a block here may have, if there are several; those of other packages last."""
    one_of = _one_of(annotation)
    return list(one_of.names()) if one_of else list(_variants(annotation))


def list_blocks(annotation: Any) -> dict[str, type[BaseModel]]:
    """Return the block of each installed kind that a block here may have."""
    return dict(_iterate_variants(annotation))


def find_tag_key(annotation: Any) -> str:
    """Return the key that distinguishes the kinds of a block: `kind` of a layout, `model` of a sensor."""
    if one_of := _one_of(annotation):
        return one_of.tag_key
    tag, model = next(iter(_variants(annotation).items()))
    return next(name for name, field in model.model_fields.items() if typing.get_args(field.annotation) == (tag,))


def find_default_kind(annotation: Any) -> str | None:
    """Return the kind of a block that does not name its kind; None if it has to."""
    if one_of := _one_of(annotation):
        return one_of.default
    return next(iter(_variants(annotation)), None)


def field_annotation(field: FieldInfo) -> Any:
    """Return the annotation of a field, including its kinds of blocks."""
    return _split(_annotation_of(field))[0]


def item_annotation(annotation: Any) -> Any:
    """Return the annotation of the items of a list; None if the annotation is not of a list."""
    return _split(_item_annotation(annotation))[0]


def find_model(annotation: Any) -> type[BaseModel] | None:
    """Return the model of the block here, if it is one block of one kind."""
    kind, _ = _split(annotation)
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None


def _all_blocks(model: type[BaseModel], path: str) -> Iterator[tuple[str, type[BaseModel]]]:
    yield path, model
    for name, field in model.model_fields.items():
        inner_path = child_path(path, field.alias or name)
        whole = _annotation_of(field)
        for annotation, place in ((whole, inner_path), (_item_annotation(whole), f"{inner_path}[]")):
            inner = find_model(annotation)
            for each in (
                [inner] if inner else dict.fromkeys(model for _, model in _iterate_variants(_split(annotation)[0]))
            ):
                yield from _all_blocks(each, place)


def _inner_slot(slot: SchemaNode, segment: Segment) -> SchemaNode | None:
    path = child_path(slot.path, segment)
    if isinstance(segment, int):
        item, constraints = _split(_item_annotation(slot.annotation))
        return None if item is None else SchemaNode(path=path, key=slot.key, annotation=item, constraints=constraints)
    if (value := _value_annotation(slot.annotation)) is not None:
        item, constraints = _split(value)
        return SchemaNode(path=path, key=slot.key, annotation=item, constraints=constraints)
    # Pydantic puts the kind of a block between the block's key and its own.
    if (variant := _variant(slot.annotation, segment)) is not None:
        return SchemaNode(path=slot.path, key=slot.key, annotation=variant)
    models = [slot.model] if slot.model else (model for _, model in _iterate_variants(slot.annotation))
    fields = (item for model in models for item in model.model_fields.items())
    field = next((field for name, field in fields if (field.alias or name) == segment), None)
    if field is None:
        return None
    annotation, constraints = _split(_annotation_of(field))
    return SchemaNode(path=path, key=segment, annotation=annotation, constraints=(*constraints, *field.metadata))


# Pydantic takes an annotation apart, and then has the `OneOf` of a block among the metadata.
def _annotation_of(field: FieldInfo) -> Any:
    one_of = next((each for each in field.metadata if isinstance(each, OneOf)), None)
    return field.annotation if one_of is None else typing.Annotated[field.annotation, one_of]


# Reduces Optional[X] and Annotated[X, ...] to X; a union of several kinds stays as it is.
def _split(annotation: Any) -> tuple[Any, tuple[Any, ...]]:
    constraints: tuple[Any, ...] = ()
    while True:
        if typing.get_origin(annotation) is typing.Annotated and not _one_of(annotation):
            annotation, *found = typing.get_args(annotation)
            constraints += tuple(found)
            continue
        kinds = _kinds_of_union(annotation)
        if len(kinds) != 1:
            each_alone = (each.metadata if isinstance(each, FieldInfo) else (each,) for each in constraints)
            return annotation, tuple(constraint for some in each_alone for constraint in some)
        annotation = kinds[0]


def _kinds_of_union(annotation: Any) -> list[Any]:
    if typing.get_origin(annotation) not in (typing.Union, types.UnionType):
        return []
    return [kind for kind in typing.get_args(annotation) if kind is not types.NoneType]


# The `OneOf` of a block of several kinds, to which other packages may add.
def _one_of(annotation: Any) -> OneOf | None:
    if typing.get_origin(annotation) is not typing.Annotated:
        return None
    return next((each for each in typing.get_args(annotation)[1:] if isinstance(each, OneOf)), None)


def _variant(annotation: Any, kind: str) -> type[BaseModel] | None:
    one_of = _one_of(annotation)
    return one_of.block_of(kind) if one_of and kind in one_of.names() else _variants(annotation).get(kind)


# Those of other packages last, each imported at its turn.
def _iterate_variants(annotation: Any) -> Iterator[tuple[str, type[BaseModel]]]:
    one_of = _one_of(annotation)
    yield from one_of.blocks() if one_of else _variants(annotation).items()


# Models of a union by their tags; the `kind` of a block selects one of them.
def _variants(annotation: Any) -> dict[str, type[BaseModel]]:
    if one_of := _one_of(annotation):
        return dict(one_of.own)
    variants: dict[str, type[BaseModel]] = {}
    for each in _kinds_of_union(annotation):
        kind, constraints = _split(each)
        tags = [constraint.tag for constraint in constraints if isinstance(constraint, Tag)]
        if tags and isinstance(kind, type) and issubclass(kind, BaseModel):
            variants[tags[0]] = kind
    return variants


def _item_annotation(annotation: Any) -> Any:
    kind, _ = _split(annotation)
    return typing.get_args(kind)[0] if typing.get_origin(kind) is tuple else None


# Annotation of the values of a block whose keys are names of the author's choice.
def _value_annotation(annotation: Any) -> Any:
    kind, _ = _split(annotation)
    key, value = typing.get_args(kind) if typing.get_origin(kind) is dict else (None, None)
    # If names have a form of their own, the problem of a name is reported for its block.
    is_named = key is str or (key is not None and _split(key)[0] is str and find_model(value) is not None)
    return value if is_named and value is not Any else None


def _describe(annotation: Any, constraints: tuple[Any, ...], unit: str) -> str:
    kind, inner = _split(annotation)
    constraints = (*inner, *constraints)
    in_unit = f" in {unit}" if unit and not unit.startswith("per") else f" {unit}" if unit else ""
    if kinds := list_kinds(kind):
        return f"a block with the key {find_tag_key(kind)}, {_alternatives(kinds)}"
    if kinds := _kinds_of_union(kind):
        return " or ".join(_describe(each, (), unit).removeprefix("one of ") for each in kinds)
    if typing.get_origin(kind) is Literal:
        return _alternatives([str(value) for value in typing.get_args(kind)])
    if typing.get_origin(kind) is tuple:
        return _describe_list(typing.get_args(kind), constraints, unit)
    if typing.get_origin(kind) is dict:
        key, value = typing.get_args(kind)
        if typing.get_origin(key) is not Literal:
            return f"a block with names as keys, of which each is {_describe(value, (), '')}"
        name = typing.get_args(key)[0]
        return f"{{{name}: a text}}" if value is str else f"{{{name}: N}} with N {_describe(value, (), '')}"
    if model := find_model(kind):
        return f"a block with the keys {_join(list_keys(model), 'and')}"
    words = {float: "a number", int: "a whole number", bool: "true or false", str: "a text", Any: "a value"}
    texts = [constraint for constraint in constraints if isinstance(constraint, StringConstraints)]
    if kind is str and any(text.pattern for text in texts):
        return "a name: a small letter, then small letters, digits and _, at most 40 in all"
    if kind is str and texts:
        return f"a text of at most {texts[0].max_length} characters"
    return f"{words[kind]}{_range(constraints)}{in_unit}"


def _describe_list(items: tuple[Any, ...], constraints: tuple[Any, ...], unit: str) -> str:
    if items[-1] is not Ellipsis:
        words = _describe(items[0], (), unit).removeprefix("a ")
        return f"a list of {len(items)} {_plural(words)}"
    least = max((c.min_length for c in constraints if isinstance(c, annotated_types.MinLen)), default=0)
    what = _describe_item(items[0], unit)
    if least == 1:
        return f"a list of at least one {what}"
    return f"a list of {f'at least {least} ' if least else ''}{_plural(what)}"


def _describe_item(item: Any, unit: str) -> str:
    if model := find_model(item):
        return f"block with the keys {_join(list_keys(model), 'and')}"
    if _one_of(item) or _variants(item):
        return f"block with the key {find_tag_key(item)} and what belongs to it"
    if _kinds_of_union(item):
        return "value of these kinds"
    return _describe(item, (), unit).removeprefix("a ").partition(":")[0]


def _plural(words: str) -> str:
    first, _, rest = words.partition(" ")
    if first == "whole":
        return f"whole {_plural(rest)}"
    return f"{first}s {rest}".rstrip()


def _range(constraints: tuple[Any, ...]) -> str:
    low, high = "", ""
    for constraint in constraints:
        match constraint:
            case annotated_types.Gt(gt=bound):
                low = f"greater than {_number(bound)}"
            case annotated_types.Ge(ge=bound):
                low = f"from {_number(bound)}"
            case annotated_types.Le(le=bound):
                high = f"to {_number(bound)}"
            case annotated_types.Lt(lt=bound):
                high = f"below {_number(bound)}"
            case _:
                pass
    if low.startswith("from") and not high:
        low = low.replace("from", "of at least", 1)
    if high.startswith("to") and not low:
        high = high.replace("to", "of at most", 1)
    return f" {f'{low} {high}'.strip()}" if low or high else ""


def _number(bound: Any) -> str:
    # Whole numbers keep all digits: a rounded bound may lie beyond the true one.
    return str(bound) if isinstance(bound, int) else f"{bound:.15g}"


def _alternatives(values: list[str]) -> str:
    return values[0] if len(values) == 1 else f"one of {_join(values, 'or')}"


def _join(words: list[str], conjunction: str) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {conjunction} {words[-1]}"


@dataclass(frozen=True, kw_only=True)
class SettingRow:
    """A setting of a block; the key of one inside a block of the block is written `plume.meander_s`."""

    key: str
    unit: str
    default: str
    meaning: str


def list_settings(
    block: type[BaseModel], *, kind: str | None = None, without: frozenset[str] = frozenset()
) -> list[SettingRow]:
    """Return the settings of a block in the order of its fields.

    Args:
        block: The block's class.
        kind: The kind, if several share the block: settings of the others are left out.
        without: Keys to leave out.
    """
    belongs: Mapping[str, tuple[str, ...]] = block.belongs if issubclass(block, KindedSpec) else {}
    foreign = {key for key, kinds in belongs.items() if kind is not None and kind not in kinds}
    return [each for each in _settings(block, "") if not {each.key, each.key.partition(".")[0]} & (without | foreign)]


def _settings(block: type[BaseModel], prefix: str) -> Iterator[SettingRow]:
    for name, field in block.model_fields.items():
        key = f"{prefix}{field.alias or name}"
        inner = find_model(field.annotation)
        if inner is not None:
            yield from _settings(inner, f"{key}.")
            continue
        words = list_words(field.annotation)
        choice = f" ({', '.join(words)})" if len(words) > 1 else ""
        meaning = f"{field.description or ''}{choice}".strip()
        yield SettingRow(key=key, unit=unit_text(name), default=default_text(field), meaning=meaning)


def unit_text(name: str) -> str:
    """Return the unit of a number under a key in words; empty if the key's name has none, or only a part of it.

    An ending such as that of `hits_per_s_per_ppm` is only a part of a unit; the meaning has the rest.
    """
    return "" if "_per_" in name.removesuffix("_per_s") else unit_name(name)


def default_text(field: FieldInfo) -> str:
    """Return the default of a field in the notation of scenario files, `required`, or a word."""
    if field.default_factory is not None:
        return "see meaning"
    return "required" if field.default is PydanticUndefined else _shown(field.default)


def _shown(value: Any) -> str:
    match value:
        case None:
            return "absent"
        case BaseModel():
            return "its defaults"
        case bool():
            return str(value).lower()
        case float():
            return f"{value:g}"
        case tuple():
            return f"[{', '.join(_shown(item) for item in cast('tuple[Any, ...]', value))}]"
        case _:
            return str(value)


def problems_from_validation(error: ValidationError, *, root: type[BaseModel] = Scenario) -> list[Problem]:
    """Return each problem of a validation once, at the deepest place that the models define."""
    problems: dict[str, Problem] = {}
    if (n_more := error.error_count() - _MAX_PROBLEMS) > 0:
        found = f"{n_more} more than those that are told"
        problems[""] = Problem(where="", expected="fewer problems", found=found, remedy="Correct these first.")
    for details in error.errors(include_url=False)[:_MAX_PROBLEMS]:
        problem = _problem_of(details, root)
        if problem is not None:
            problems.setdefault(problem.where, problem)
    suggested = {place for problem in problems.values() if (place := _suggested_path(problem))}
    return [p for p in problems.values() if not (p.found == MISSING and p.where in suggested)]


# A misspelled key is one problem, not two: the key that was meant is missing as well.
def _suggested_path(problem: Problem) -> str | None:
    match = re.match(r"Did you mean (\w+)\?", problem.remedy)
    return child_path(parent_path(problem.where), match[1]) if match and problem.found == _UNKNOWN_KEY else None


def _problem_of(details: ErrorDetails, root: type[BaseModel]) -> Problem | None:
    location: tuple[Segment, ...] = details["loc"]
    value = details["input"]
    slot = find_schema_node(location, root=root)
    match details["type"]:
        case rule if rule == RULE:
            context = details.get("ctx", {})
            path = child_path(slot.path, context["key"]) if context["key"] else slot.path
            return Problem(where=path, expected=context["expected"], found=context["found"], remedy=context["remedy"])
        case "default_factory_not_called":
            return None  # the default depends on a wrong value, which is reported
        case "extra_forbidden":
            return _unknown_key(location[:-1], str(location[-1]), value, root)
        case "missing" if isinstance(location[-1], int):
            return _wrong_value(find_schema_node(location[:-1], root=root), value)
        case "missing":
            return Problem(where=slot.path, expected=slot.describe(), found=MISSING)
        case "union_tag_invalid" | "union_tag_not_found" if isinstance(value, dict):
            return _unknown_kind(slot, typing.cast("dict[str, Any]", value))
        case "too_short" if isinstance(value, list) and typing.cast("list[Any]", value):
            return None  # pydantic counts only valid items; the others have problems of their own
        case _:
            return _wrong_value(slot, value)


def _wrong_value(slot: SchemaNode, value: Any) -> Problem:
    return Problem(
        where=slot.path, expected=slot.describe(), found=format_value(value), remedy=_value_remedy(slot, value)
    )


def _unknown_kind(slot: SchemaNode, block: dict[str, Any]) -> Problem:
    kinds, tag_key = list_kinds(slot.annotation), find_tag_key(slot.annotation)
    kind, where = block.get(tag_key), child_path(slot.path, tag_key)
    remedy = (find_remedy("keys", f"{where}={kind}") or did_you_mean(kind, kinds)) if isinstance(kind, str) else ""
    return Problem(
        where=where,
        expected=f"one of {', '.join(kinds[:-1])} or {kinds[-1]}",
        found=format_value(kind),
        remedy=remedy,
    )


def _unknown_key(location: tuple[Segment, ...], key: str, value: Any, root: type[BaseModel]) -> Problem:
    block = find_schema_node(location, root=root)
    keys = list_keys(block.model) if block.model else []
    path = child_path(block.path, key)
    expected = f"one of the keys {', '.join(keys)}"
    if (remedy := _kinds_that_have(location, key, root)) and key not in keys:
        return Problem(where=path, expected=expected, found=_UNKNOWN_KEY, remedy=remedy)
    if absent := find_remedy("keys", re.sub(r"\[\d+\]", "[]", path)):
        return Problem(where=path, expected=expected, found=_UNKNOWN_KEY, remedy=absent)
    match = nearest_key(key, keys)
    homes = [home for home in paths_of_key(key, root=root) if home != block.path]
    if match:
        remedy = f"Did you mean {match}?{_unit_hint(key, find_schema_node((*location, match), root=root), value)}"
    elif homes:
        remedy = f"{key} belongs to {' or '.join(home or 'the top level' for home in homes)}."
    else:
        remedy = "If an extension adds it, install that." if block.path.endswith(".start") else ""
    return Problem(where=path, expected=expected, found=_UNKNOWN_KEY, remedy=remedy)


# Kinds of the same block that have the key.
def _kinds_that_have(location: tuple[Segment, ...], key: str, root: type[BaseModel]) -> str:
    for end in range(len(location), 0, -1):
        annotation = find_schema_node(location[:end], root=root).annotation
        if kinds := [kind for kind, model in _iterate_variants(annotation) if key in list_keys(model)]:
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
    """Return a value in the notation of YAML, shortened."""
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
        if slot.constraints:
            return _name_remedy(value)
        return f"Put it in quotes: '{format_value(value)}'." if isinstance(value, int | float) else ""
    item = _item_annotation(kind)
    if (find_model(item) or _variants(item)) and not isinstance(value, list):
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
