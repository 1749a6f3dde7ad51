"""Schema of the models: what they allow at a place of a scenario, found from their annotations."""

import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import annotated_types
from pydantic import BaseModel, StringConstraints, Tag
from pydantic.fields import FieldInfo

from gslcosim.scenario.models.one_of import OneOf
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.problems import child_path
from gslcosim.scenario.units import unit_name

Segment = str | int


@dataclass(frozen=True, kw_only=True)
class SchemaNode:
    """A place that the models know: its path, the key whose name says the unit, and the annotation."""

    path: str
    key: str
    annotation: Any
    constraints: tuple[Any, ...] = ()

    @property
    def model(self) -> type[BaseModel] | None:
        """The model of the block that belongs here, if it is a block."""
        return _model_in(self.annotation)

    def describe(self) -> str:
        """Return what is allowed here in words: `a number greater than 0 in metres`."""
        return _describe(self.annotation, self.constraints, unit_name(self.key))


def find_schema_node(location: tuple[Segment, ...], *, root: type[BaseModel] = Scenario) -> SchemaNode:
    """Return the deepest place on the way to a location that the models know; unknown keys end the way.

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
    """Return the fixed words that are allowed by an annotation, such as the names of the wind solvers."""
    kinds = _kinds_of_union(annotation) or [annotation]
    literals = [kind for kind in kinds if typing.get_origin(kind) is Literal]
    return [str(word) for literal in literals for word in typing.get_args(literal)]


def list_kinds(annotation: Any) -> list[str]:
    """Return the kinds of which a block that belongs here may be, where there are several; others' packages' last."""
    one_of = _one_of(annotation)
    return list(one_of.names()) if one_of else list(_variants(annotation))


def list_blocks(annotation: Any) -> dict[str, type[BaseModel]]:
    """Return the block of each of gslcosim's kinds of which a block that belongs here may be."""
    return _variants(annotation)


def find_tag_key(annotation: Any) -> str:
    """Return the key that distinguishes the kinds of a block: `kind` of a layout, `model` of a sensor."""
    if one_of := _one_of(annotation):
        return one_of.tag_key
    tag, model = next(iter(_variants(annotation).items()))
    return next(name for name, field in model.model_fields.items() if typing.get_args(field.annotation) == (tag,))


def find_default_kind(annotation: Any) -> str | None:
    """Return the kind of a block that does not say its kind; nothing where it has to."""
    if one_of := _one_of(annotation):
        return one_of.default
    return next(iter(_variants(annotation)), None)


def field_annotation(field: FieldInfo) -> Any:
    """Return the annotation of a field with all that it says about kinds of blocks."""
    return _split(_annotation_of(field))[0]


def item_annotation(annotation: Any) -> Any:
    """Return the annotation of the items of a list that belongs here; nothing where no list does."""
    return _split(_item_annotation(annotation))[0]


def find_model(annotation: Any) -> type[BaseModel] | None:
    """Return the model of the block that belongs here, if it is one block of one kind."""
    return _model_in(annotation)


def kinds_with_key(annotation: Any, key: str) -> list[str]:
    """Return which of gslcosim's kinds of a block that belongs here have a certain key."""
    return [kind for kind, model in _variants(annotation).items() if key in list_keys(model)]


def holds_blocks(annotation: Any) -> bool:
    """Return whether a list of blocks belongs here."""
    item = _item_annotation(annotation)
    return _model_in(item) is not None or bool(_variants(item))


def _all_blocks(model: type[BaseModel], path: str) -> Iterator[tuple[str, type[BaseModel]]]:
    yield path, model
    for name, field in model.model_fields.items():
        inner_path = child_path(path, field.alias or name)
        whole = _annotation_of(field)
        for annotation, place in ((whole, inner_path), (_item_annotation(whole), f"{inner_path}[]")):
            inner = _model_in(annotation)
            for each in [inner] if inner else dict.fromkeys(_variants(_split(annotation)[0]).values()):
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
    models = [slot.model] if slot.model else list(_variants(slot.annotation).values())
    field = next((field for model in models if (field := _field_of(model, segment))), None)
    if field is None:
        return None
    annotation, constraints = _split(_annotation_of(field))
    return SchemaNode(path=path, key=segment, annotation=annotation, constraints=(*constraints, *field.metadata))


def _field_of(model: type[BaseModel], key: str) -> FieldInfo | None:
    return next((field for name, field in model.model_fields.items() if (field.alias or name) == key), None)


# Pydantic takes an annotation apart; what says that a block is one of several kinds is then among the metadata.
def _annotation_of(field: FieldInfo) -> Any:
    one_of = next((each for each in field.metadata if isinstance(each, OneOf)), None)
    return field.annotation if one_of is None else typing.Annotated[field.annotation, one_of]


# Optional[X] and Annotated[X, ...] to X; a union of several kinds stays what it is.
def _split(annotation: Any) -> tuple[Any, tuple[Any, ...]]:
    constraints: tuple[Any, ...] = ()
    while True:
        if typing.get_origin(annotation) is typing.Annotated and not _one_of(annotation):
            annotation, *found = typing.get_args(annotation)
            constraints += tuple(found)
            continue
        kinds = _kinds_of_union(annotation)
        if len(kinds) != 1:
            return annotation, tuple(_flat(constraints))
        annotation = kinds[0]


def _flat(constraints: tuple[Any, ...]) -> Iterator[Any]:
    for constraint in constraints:
        if isinstance(constraint, FieldInfo):
            yield from constraint.metadata
        else:
            yield constraint


def _kinds_of_union(annotation: Any) -> list[Any]:
    if typing.get_origin(annotation) not in (typing.Union, types.UnionType):
        return []
    return [kind for kind in typing.get_args(annotation) if kind is not types.NoneType]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    kind, _ = _split(annotation)
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None


# What says that a block is one of several kinds, where other packages may add some.
def _one_of(annotation: Any) -> OneOf | None:
    if typing.get_origin(annotation) is not typing.Annotated:
        return None
    return next((each for each in typing.get_args(annotation)[1:] if isinstance(each, OneOf)), None)


def _variant(annotation: Any, kind: str) -> type[BaseModel] | None:
    one_of = _one_of(annotation)
    return one_of.block_of(kind) if one_of and kind in one_of.names() else _variants(annotation).get(kind)


# The models of a union by their tags: a block's `kind` says which of them it is.
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


# Of a block whose keys are names of the author's choice.
def _value_annotation(annotation: Any) -> Any:
    kind, _ = _split(annotation)
    key, value = typing.get_args(kind) if typing.get_origin(kind) is dict else (None, None)
    return value if key is str and value is not Any else None


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
    if model := _model_in(kind):
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
    if model := _model_in(item):
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
    return f"{bound:.15g}"


def _alternatives(values: list[str]) -> str:
    return values[0] if len(values) == 1 else f"one of {_join(values, 'or')}"


def _join(words: list[str], conjunction: str) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {conjunction} {words[-1]}"
