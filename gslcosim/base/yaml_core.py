"""YAML 1.2's core schema for PyYAML, which implements 1.1: `yes`, `on` and `12:30` are text, `1e-3` is a number."""

import re
from typing import Any, cast

import yaml

TAG = "tag:yaml.org,2002:"
MAX_NESTING = 64
"""Depth to which lists and blocks may be nested in any file; ours are seven deep."""

MAX_NODES = 200_000
"""Maximum number of values and keys in a file."""

MAX_DIGITS = 1000
"""Maximum number of characters in a number; Python's own limit covers decimal ones only."""


EDITOR_HEADER = "# yaml-language-server: "
"""Beginning of a file's first line that names its JSON Schema, for editors."""


_FIRST_COMMENTS = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s*#.*\n?)*")
_EDITOR_LINE = re.compile(rb"^(?:\xef\xbb\xbf)?[ \t]*#[ \t]*yaml-language-server:.*\n?", re.MULTILINE)


def without_editor_header(content: bytes) -> bytes:
    """Return a file's content without the line for editors at its beginning, which hashes leave out."""
    head = content[: cast("re.Match[bytes]", _FIRST_COMMENTS.match(content)).end()]
    return _EDITOR_LINE.sub(b"", head) + content[len(head) :]


class YamlNestingError(yaml.MarkedYAMLError):
    """A YAML text is nested deeper than `MAX_NESTING`."""


class YamlSizeError(yaml.MarkedYAMLError):
    """A YAML text has more values and keys than `MAX_NODES`."""


class BoundedLoader(yaml.SafeLoader):
    """Reads YAML 1.1 as PyYAML does, and refuses texts of an implausible depth or size."""

    _n_levels = 0
    _n_nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Return the next node as PyYAML does, but before Python's limit of recursion is reached."""
        self._n_levels += 1
        self._n_nodes += 1
        mark = cast("Any", self).peek_event().start_mark
        if self._n_levels > MAX_NESTING:
            raise YamlNestingError(None, None, f"lists and blocks more than {MAX_NESTING} deep", mark)
        if self._n_nodes > MAX_NODES:
            raise YamlSizeError(None, None, f"more than {MAX_NODES} values and keys", mark)
        node = cast("Any", super()).compose_node(parent, index)
        self._n_levels -= 1
        return node


class CoreLoader(BoundedLoader):
    """Composes nodes with YAML 1.2's core schema in place of PyYAML's YAML 1.1."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012


def _resolve(kind: str, pattern: str, first_characters: list[str]) -> None:
    cast("Any", CoreLoader).add_implicit_resolver(TAG + kind, re.compile(pattern), first_characters)


_resolve("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", list("tTfF"))
_resolve("null", r"^(?:~|null|Null|NULL|)$", ["~", "n", "N", ""])
_resolve("int", r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$", list("-+0123456789"))
_resolve(
    "float",
    r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$",
    list("-+0123456789."),
)


def parse_whole_number(text: str) -> int | str:
    """Return the number of a scalar tagged `int`; the text itself if it is no number, or has thousands of digits."""
    base = {"0o": 8, "0x": 16}.get(text[:2].lower(), 10)
    try:
        return int(text, base) if len(text) <= MAX_DIGITS else text
    except ValueError:  # `!!int x`
        return text


def parse_real_number(text: str) -> float | str:
    """Return the number of a scalar tagged `float`; the text itself if it is no number."""
    try:
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    except ValueError:  # `!!float x`
        return text


def _construct_int(loader: CoreLoader, node: yaml.ScalarNode) -> int | str:
    return parse_whole_number(str(cast("Any", loader).construct_scalar(node)))


def _construct_float(loader: CoreLoader, node: yaml.ScalarNode) -> float | str:
    return parse_real_number(str(cast("Any", loader).construct_scalar(node)))


# PyYAML's own constructors cover YAML 1.1 only, and fail at `08` and numbers of thousands of digits.
cast("Any", CoreLoader).add_constructor(TAG + "int", _construct_int)
cast("Any", CoreLoader).add_constructor(TAG + "float", _construct_float)
