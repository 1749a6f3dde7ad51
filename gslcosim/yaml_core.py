"""YAML 1.2's core schema for PyYAML, which knows 1.1: `yes`, `on` and `12:30` are text, `1e-3` is a number."""

import re
from typing import Any, cast

import yaml

TAG = "tag:yaml.org,2002:"


class CoreLoader(yaml.SafeLoader):
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
