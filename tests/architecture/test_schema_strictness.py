"""Published JSON Schemas are taken by strict compilers, such as Ajv with `strict: true`: no keyword without effect."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

ROOT = Path(__file__).parents[2]
SCHEMAS = [
    *sorted((ROOT / "agents" / "contract" / "schemas").glob("*.json")),
    *sorted(ROOT.glob("*/schemas/*.schema.json")),
]
ANNOTATIONS = {
    "$schema",
    "$id",
    "$ref",
    "$defs",
    "$comment",
    "title",
    "description",
    "default",
    "examples",
    "deprecated",
}
OF_ANY_TYPE = {"type", "const", "enum", "anyOf", "oneOf", "allOf", "not", "if", "then", "else", "discriminator"}
OF_TYPE = {
    "object": {
        "properties", "patternProperties", "additionalProperties", "required", "propertyNames", "minProperties",
        "maxProperties", "dependentRequired",
    },
    "array": {"items", "prefixItems", "minItems", "maxItems", "uniqueItems", "contains"},
    "string": {"minLength", "maxLength", "pattern", "format", "contentEncoding", "contentMediaType"},
    "number": {"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "multipleOf"},
}  # fmt: skip
FORMATS = {"date-time", "date", "time", "email", "hostname", "ipv4", "ipv6", "uri", "uri-reference", "uuid", "regex"}
SAME_VALUE = ("anyOf", "oneOf", "allOf", "not", "if", "then", "else")
BELOW = ("additionalProperties", "items", "contains", "prefixItems")
BY_NAME = ("properties", "patternProperties", "$defs")


def find_problems(schema: Any, place: str = "#", outer: dict[str, Any] | None = None) -> Iterator[str]:
    """Yield what a strict compiler refuses; `outer` is the schema of the same value around this one."""
    if isinstance(schema, bool):
        return
    known = {**(outer or {}), **schema}
    kind = known.get("type")
    if isinstance(kind, list):
        yield f"{place}: a union of types {kind}"
    for keyword in schema.keys() - ANNOTATIONS - OF_ANY_TYPE:
        of = next((name for name, words in OF_TYPE.items() if keyword in words), None)
        if of is None:
            yield f"{place}: unknown keyword {keyword}"
        elif kind != of and not (of == "number" and kind == "integer"):
            yield f"{place}: {keyword} beside type {kind}"
    if schema.get("format", "uri") not in FORMATS:
        yield f"{place}: unknown format {schema['format']}"
    if n := len(schema.get("prefixItems", ())):
        is_closed = schema.get("items") is False or schema.get("maxItems") == n
        if schema.get("minItems") != n or not is_closed:
            yield f"{place}: a tuple of open length"
    if missing := set(schema.get("required", ())) - set(known.get("properties", ())):
        yield f"{place}: required without a property {sorted(missing)}"
    if ("if" in schema) != bool({"then", "else"} & schema.keys()):
        yield f"{place}: if without then, or then without if"
    same = {name: known[name] for name in ("type", "properties") if name in known}
    arounds = {**dict.fromkeys(SAME_VALUE, same), **dict.fromkeys(BELOW), "propertyNames": {"type": "string"}}
    for keyword, around in arounds.items():
        inner = schema.get(keyword)
        for i, each in enumerate(inner if isinstance(inner, list) else [] if inner is None else [inner]):
            yield from find_problems(each, f"{place}/{keyword}/{i}", around)
    for keyword in BY_NAME:
        for name, each in schema.get(keyword, {}).items():
            yield from find_problems(each, f"{place}/{keyword}/{name}")


@pytest.mark.parametrize("path", SCHEMAS, ids=lambda path: path.name)
def test_a_strict_compiler_takes_a_published_schema(path: Path) -> None:
    schema = json.loads(path.read_text(encoding="utf-8"))
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    jsonschema.Draft202012Validator.check_schema(schema)
    assert list(find_problems(schema)) == []


@pytest.mark.parametrize(
    ("schema", "what"),
    [
        ({"x-mark": True}, "unknown keyword x-mark"),
        ({"type": ["string", "null"]}, "union of types"),
        ({"properties": {"a": {"type": "string"}}}, "properties beside type None"),
        ({"type": "string", "format": "binary"}, "unknown format binary"),
        ({"type": "array", "prefixItems": [{"type": "string"}]}, "open length"),
        ({"type": "object", "required": ["a"]}, "required without a property"),
        ({"type": "object", "properties": {"a": {"minimum": 1}}}, "minimum beside type None"),
        ({"if": {"type": "string"}}, "if without then"),
    ],
)
def test_what_a_strict_compiler_refuses_is_found(schema: dict[str, Any], what: str) -> None:
    assert what in " ".join(find_problems(schema))


def test_there_are_schemas() -> None:
    assert len(SCHEMAS) > 20
