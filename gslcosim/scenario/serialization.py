"""YAML text as plain values with the place of each, and a resolved scenario back to YAML.

Every scenario's text is read here. Plain values follow YAML 1.2's core schema: see `gslcosim.base.yaml_core`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, cast

import yaml
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from gslcosim.base import yaml_core
from gslcosim.base.problems import Problem
from gslcosim.base.yaml_core import (
    TAG,
    CoreLoader,
    YamlNestingError,
    YamlSizeError,
    parse_real_number,
    parse_whole_number,
)
from gslcosim.scenario.models.base import KindedSpec
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.problems import (
    InvalidScenarioError,
    LocatedProblem,
    TextLocation,
    TextLocations,
    child_path,
    locate,
)

# Aliases repeat their targets; a short file could otherwise unfold to billions of values.
MAX_VALUES = 100_000
# Depth to which lists and blocks may be nested; those of a scenario are seven deep.
MAX_LEVELS = 32

_KNOWNTAGS = ("map", "seq", "str", "null", "bool", "int", "float")


@dataclass(frozen=True)
class YamlTree:
    """The values of a file as dicts, lists and scalars, with the place where each was written.

    `problems` are those of the text itself, such as a repeated key; `values` then has the rest.
    """

    values: Any
    marks: TextLocations
    problems: tuple[LocatedProblem, ...] = ()

    @property
    def block(self) -> dict[str, Any] | None:
        """The values if they are a block with keys, as they should be."""
        values: object = self.values
        return cast("dict[str, Any]", values) if isinstance(values, dict) else None


def read_yaml(text: str, *, source: str, root_path: str = "") -> YamlTree:
    """Return the values of a YAML text with their places.

    Args:
        text: One YAML document.
        source: Name of the text in places: the file as the user wrote it, or an option.
        root_path: The path of the outermost value; empty for a file.
    """
    root = TextLocation(source=source, line=1, column=1)
    try:
        node: yaml.Node | None = cast("Any", yaml).compose(text, Loader=CoreLoader)
        if node is None:
            return YamlTree(None, TextLocations(root))
        reader = _NodeReader(source)
        values = reader.read(node, root_path)
    except YamlNestingError as error:
        expected = f"lists and blocks at most {MAX_LEVELS} deep"
        problem = Problem(where="", expected=expected, found=f"a nest of more than {yaml_core.MAX_NESTING} levels")
        raise InvalidScenarioError(locate([problem], TextLocations(root)), name=source) from error
    except YamlSizeError as error:
        problem = Problem(where="", expected=f"at most {MAX_VALUES} values", found="more")
        raise InvalidScenarioError(locate([problem], TextLocations(root)), name=source) from error
    except yaml.YAMLError as error:
        line, column, expected, found, remedy = _describe_syntax_error(error, text)
        place = TextLocation(source=f"{source}:{line}:{column}")
        located = LocatedProblem(place=place, problem=Problem(where="", expected=expected, found=found, remedy=remedy))
        raise InvalidScenarioError([located], name=source) from error
    marks = TextLocations(root, reader.places)
    return YamlTree(values, marks, locate(reader.problems, marks))


class _NodeReader:
    """Turns nodes into values, and collects their places and the problems of the text itself."""

    def __init__(self, source: str) -> None:
        self.places: dict[str, TextLocation] = {}
        self.problems: list[Problem] = []
        self._source = source
        self._open: list[yaml.Node] = []
        self._n_values = 0

    def read(self, node: yaml.Node, path: str) -> Any:
        self._n_values += 1
        if path:
            self.places.setdefault(path, self._place(node))
        if any(node is outer for outer in self._open):
            return self._refuse(path, "values that do not contain themselves", "an alias of a value around it")
        if self._n_values > MAX_VALUES:
            if self._n_values == MAX_VALUES + 1:
                self._refuse("", f"at most {MAX_VALUES} values", "more", "Are there aliases of aliases?")
            return None
        if len(self._open) >= MAX_LEVELS and not isinstance(node, yaml.ScalarNode):
            return self._refuse(path, f"lists and blocks at most {MAX_LEVELS} deep", "a deeper one")
        self._open.append(node)
        value = self._read_by_kind(node, path)
        self._open.pop()
        return value

    def _read_by_kind(self, node: yaml.Node, path: str) -> Any:
        if node.tag.removeprefix(TAG) not in _KNOWNTAGS:
            return self._refuse(path, "a plain value", f"one with the tag {node.tag}", "Delete the tag.")
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path)
        if isinstance(node, yaml.SequenceNode):
            return [self.read(item, child_path(path, i)) for i, item in enumerate(node.value)]
        return self._scalar(cast("yaml.ScalarNode", node), path)

    def _mapping(self, node: yaml.MappingNode, path: str) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self._refuse(path, "keys that are words", "a list or block as a key", "Put it in quotes.")
                continue
            key = str(key_node.value)
            key_path = child_path(path, key)
            if key in values:
                first, again = (place.line for place in (self.places[key_path], self._place(key_node)))
                self._refuse(
                    key_path, "the key once", f"there on line {first} and again on line {again}", "Delete one."
                )
                continue
            self.places[key_path] = self._place(key_node)
            values[key] = self.read(value_node, key_path)
        return values

    def _scalar(self, node: yaml.ScalarNode, path: str) -> Any:
        text = str(node.value)
        match node.tag.removeprefix(TAG):
            case "str":
                return text
            case "null":
                return None
            case "bool":
                return text.lower() == "true"
            case "int":
                return parse_whole_number(text)
            case _:
                return parse_real_number(text)

    def _refuse(self, path: str, expected: str, found: str, remedy: str = "") -> None:
        self.problems.append(Problem(where=path, expected=expected, found=found, remedy=remedy))

    def _place(self, node: yaml.Node) -> TextLocation:
        return TextLocation(source=self._source, line=node.start_mark.line + 1, column=node.start_mark.column + 1)


def _describe_syntax_error(error: yaml.YAMLError, text: str) -> tuple[int, int, str, str, str]:
    if isinstance(error, yaml.reader.ReaderError):
        position = int(error.position)
        line, column = text.count("\n", 0, position) + 1, position - text.rfind("\n", 0, position)
        return line, column, "printable text", f"the character U+{ord(text[position]):04X}", "Delete it."
    mark = getattr(error, "problem_mark", None)
    line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
    said = str(getattr(error, "problem", "") or error)
    if "'\\t'" in said or text.split("\n")[line - 1][:column].endswith("\t"):
        return line, column, "spaces", "a tab", "Replace tabs by spaces."
    if "but found another document" in said:
        return line, column, "one document", "a second one after ---", "Put each scenario in its own file."
    if "undefined alias" in said:
        return line, column, "aliases of anchors above", said.removeprefix("found "), ""
    context = str(getattr(error, "context", None) or "")
    remedy = "Is a quote, bracket or colon missing above? Text with `: ` or ` #` in it needs quotes."
    return line, column, "YAML", f"text that cannot be read ({context}{', ' if context else ''}{said})", remedy


class _Dumper(yaml.SafeDumper):
    """Quotes every text that YAML 1.1 or 1.2 would read as another type, and keeps short lists on one line."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write repeated values in full."""
        return True


for _first, _resolvers in CoreLoader.yaml_implicit_resolvers.items():
    for _tag, _pattern in _resolvers:
        cast("Any", _Dumper).add_implicit_resolver(_tag, _pattern, [_first])


def _represent_list(dumper: Any, items: list[Any]) -> yaml.Node:
    is_flat = not any(isinstance(item, dict | list) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=is_flat)


cast("Any", _Dumper).add_representer(list, _represent_list)


def dump_resolved(scenario: Scenario) -> str:
    """Return the YAML of a valid scenario with all defaults and overrides filled in; it loads back equal."""
    return dump_values(plain_values(scenario))


def dump_values(values: Any) -> str:
    """Return plain values as YAML, quoted so that they load back equal."""
    return cast("Any", yaml).dump(values, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)


def plain_values(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as in a file, with all defaults filled in: dicts, lists and scalars."""
    return _plain(scenario)


# None is left out where it is the default anyway, and so are keys without a meaning for a block's kind.
def _plain(value: Any, useless: Iterable[str] = ()) -> Any:
    if isinstance(value, BaseModel):
        left_out = {*useless, *(value.useless_keys() if isinstance(value, KindedSpec) else ())}
        return {
            # Of paths such as `plume.meander_s` those inside `plume`, without this prefix.
            field.alias or name: _plain(
                getattr(value, name),
                [path.removeprefix(f"{name}.") for path in left_out if path.startswith(f"{name}.")],
            )
            for name, field in type(value).model_fields.items()
            if name not in left_out
            and (getattr(value, name) is not None or field.default not in (None, PydanticUndefined))
        }
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in cast("dict[str, Any]", value).items()}
    return [_plain(item) for item in cast("tuple[Any, ...]", value)] if isinstance(value, tuple) else value
