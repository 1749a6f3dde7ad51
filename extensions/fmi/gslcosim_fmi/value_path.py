"""Paths to single values in messages, such as `bodies[agent=beetle].position_world_m[0]`."""

import re
import types
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, cast, get_args, get_origin

import msgspec

from gslcosim.base.errors import UsageError
from gslcosim.contract.messages import Message
from gslcosim.scenario.problems import did_you_mean

Scalar = bool | int | float | str
_SCALARS = (bool, int, float, str)
_PART = re.compile(r"([a-z][a-z0-9_]*)((?:\[[^\[\]]*\])*)")
_BRACKET = re.compile(r"\[([^\[\]]*)\]")


@dataclass(frozen=True, kw_only=True)
class _Step:
    """One step into a value: a field or key by `name`, an item by `index`, or the item whose fields are `wanted`."""

    name: str = ""
    index: int | None = None
    wanted: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, kw_only=True)
class ValuePath:
    """Path to one value in the messages of a type.

    Attributes:
        text: As the scenario has it.
        steps: Its steps.
        kinds: The types that the value may have.
    """

    text: str
    steps: tuple[_Step, ...]
    kinds: frozenset[type]

    @property
    def field(self) -> str:
        """The last field by name, whose end is the unit of the value."""
        return [step.name for step in self.steps if step.name][-1]

    def find_names(self, key: str) -> list[str]:
        """Return what the items that it chooses have to have under a key, such as `agent`."""
        return [value for step in self.steps for name, value in step.wanted if name == key]

    def read(self, message: Message) -> Scalar | None:
        """Return the value in a message, None where the message has none."""
        value: Any = message
        for step in self.steps:
            if step.wanted:
                items: Sequence[Any] = value
                value = next((item for item in items if _has_all(item, step.wanted)), None)
            elif step.index is not None:
                value = value[step.index] if -len(value) <= step.index < len(value) else None
            elif isinstance(value, dict):
                value = cast("dict[str, Any]", value).get(step.name)
            else:
                value = getattr(value, step.name, None)
            if value is None:
                return None
        return value if isinstance(value, _SCALARS) else None


def _has_all(item: Any, wanted: Sequence[tuple[str, str]]) -> bool:
    return all(str(getattr(item, name, None)) == text for name, text in wanted)


def parse_value_path(text: str, message_type: type[Message]) -> ValuePath:
    """Return the path that a text stands for.

    Args:
        text: Fields with dots between them; behind a list an index from 0 on, or which fields its item has.
    """
    steps: list[_Step] = []
    kinds: frozenset[Any] = frozenset((message_type,))
    for part in _split(text):
        matched = _PART.fullmatch(part)
        if matched is None:
            raise UsageError(f"expected fields such as bodies[agent=beetle].position_world_m[0], was '{part}'")
        name, brackets = matched.groups()
        kinds = _find_field(kinds, name)
        steps.append(_Step(name=name))
        for inside in _BRACKET.findall(brackets):
            kinds = _find_items(kinds, name)
            steps.append(_parse_bracket(inside, kinds))
    if not kinds or not kinds <= {*_SCALARS}:
        fields = sorted({field for kind in kinds for field in _list_fields(kind)})
        rest = f"one of its fields ({', '.join(fields)})" if fields else "one of its items, such as [0]"
        raise UsageError(f"expected a number, a truth value or a text, which needs {rest}, was '{text}'")
    return ValuePath(text=text, steps=tuple(steps), kinds=kinds)


# Dots within brackets belong to what they compare with.
def _split(text: str) -> list[str]:
    return re.split(r"\.(?![^\[]*\])", text)


def _parse_bracket(inside: str, kinds: frozenset[Any]) -> _Step:
    if re.fullmatch(r"-?\d{1,6}", inside):
        return _Step(index=int(inside))
    wanted: list[tuple[str, str]] = []
    known = sorted({field for kind in kinds for field in _list_fields(kind)})
    for pair in inside.split(","):
        name, sign, value = (word.strip() for word in pair.partition("="))
        if not sign or name not in known:
            example = f"{known[0]}=…" if known else "0"
            raise UsageError(f"expected [{example}] with a field of its items ({', '.join(known)}), was '[{inside}]'")
        wanted.append((name, value))
    return _Step(wanted=tuple(wanted))


def _find_field(kinds: frozenset[Any], name: str) -> frozenset[Any]:
    fields: dict[str, Any] = {}
    values: list[Any] = []
    for kind in kinds:
        fields |= _list_fields(kind)
        if get_origin(kind) is dict:
            values.append(get_args(kind)[1])
    if name in fields:
        values += [_list_fields(kind)[name] for kind in kinds if name in _list_fields(kind)]
    if not values:
        near = did_you_mean(name, fields)
        expected = f"one of {', '.join(sorted(fields))}" if fields else "an item of the list before it, such as [0]"
        raise UsageError(f"expected {expected}, was '{name}'. {near}".rstrip())
    return frozenset(kind for value in values for kind in _strip(value))


def _find_items(kinds: frozenset[Any], name: str) -> frozenset[Any]:
    items = [item for kind in kinds if get_origin(kind) in (tuple, list) for item in get_args(kind) if item is not ...]
    if not items:
        raise UsageError(f"expected no [] behind {name}, which is no list, was some")
    return frozenset(kind for item in items for kind in _strip(item))


def _list_fields(kind: Any) -> dict[str, Any]:
    if not (isinstance(kind, type) and issubclass(kind, msgspec.Struct)):
        return {}
    return {field.name: field.type for field in msgspec.structs.fields(kind)}


# Limits and None are no part of what a value can be.
def _strip(annotation: Any) -> list[Any]:
    origin = get_origin(annotation)
    if origin is Annotated:
        return _strip(get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        return [kind for one in get_args(annotation) if one is not type(None) for kind in _strip(one)]
    if origin is Literal:
        return [type(value) for value in get_args(annotation)]
    return [annotation]
