"""Reading YAML with the place of each value."""

import pytest
import yaml

from gslcosim.base import yaml_core
from gslcosim.base.errors import ScenarioError
from gslcosim.base.yaml_core import CoreLoader
from gslcosim.scenario import serialization
from gslcosim.scenario.serialization import read_yaml


def places(text):
    marks = read_yaml(text, source="f.yaml").marks
    return {path: (place.line, place.column) for path, place in marks.places.items()}


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("1", 1), ("-7", -7), ("012", 12), ("0x1F", 31), ("0o17", 15), ("1.5", 1.5), (".5", 0.5), ("1e-3", 0.001),
        ("true", True), ("False", False), ("~", None), ("null", None), ("", None), (".inf", float("inf")),
        ("yes", "yes"), ("on", "on"), ("12:30", "12:30"), ("2024-01-01", "2024-01-01"), ("1_000", "1_000"),
        ("'1'", "1"), ("!!str 1", "1"), ("!!float x", "x"), ("!!int x", "x"), ("2 m", "2 m"), ("9" * 5000, "9" * 5000),
    ],
)  # fmt: skip
def test_plain_values_follow_yaml_1_2(written, value):
    assert read_yaml(f"key: {written}", source="f.yaml").values == {"key": value}


def test_every_value_has_the_place_of_its_key_or_item():
    text = "a: 1\nb:\n  - c: 2\n    d: [3, 4]\n  - 5\n"
    assert places(text) == {
        "a": (1, 1), "b": (2, 1), "b[0]": (3, 5), "b[0].c": (3, 5), "b[0].d": (4, 5),
        "b[0].d[0]": (4, 9), "b[0].d[1]": (4, 12), "b[1]": (5, 5),
    }  # fmt: skip


def test_a_place_without_a_mark_is_that_of_its_parent():
    marks = read_yaml("\na:\n  b: 1\n", source="f.yaml").marks
    assert [marks.place_of(path).line for path in ("a.b", "a.b.c[3]", "a.x", "x.y", "")] == [3, 3, 2, 1, 1]


def test_an_alias_stands_where_it_is_written_and_its_content_where_the_anchor_is():
    assert places("a: &x {b: 1}\nc: *x\n")["c"] == (2, 1)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a:\n\tb: 1", "f.yaml:2:1: expected spaces, was a tab. Replace tabs by spaces."),
        ("a: {b: 1,\n\tc: 2}", "f.yaml:2:1: expected spaces, was a tab. Replace tabs by spaces."),
        ("a: 1\n---\nb: 2", "f.yaml:2:1: expected one document, was a second one after ---."),
        ("a: *b", "f.yaml:1:4: expected aliases of anchors above, was undefined alias 'b'."),
        ("a: 1\nb: \x07", "f.yaml:2:4: expected printable text, was the character U+0007. Delete it."),
        ("a: [1\nb: 2", "f.yaml:2:2: expected YAML, was text that cannot be read (while parsing a flow sequence, "),
        ("a: b: c", "f.yaml:1:5: expected YAML, was text that cannot be read (mapping values are not allowed here)"),
        ("a: 'open", "f.yaml:1:9: expected YAML, was text that cannot be read (while scanning a quoted scalar"),
        ("[" * 100_000, "f.yaml:1: expected lists and blocks at most 32 deep, was a nest of more than 64 levels."),
        ("a: " * 70, "f.yaml:1:5: expected YAML, was text that cannot be read (mapping values are not allowed here)"),
        ("- " * 100, "f.yaml:1: expected lists and blocks at most 32 deep, was a nest of more than 64 levels."),
    ],
)
def test_text_that_is_not_yaml_is_refused_with_line_and_column(text, expected):
    with pytest.raises(ScenarioError) as refusal:
        read_yaml(text, source="f.yaml")
    assert str(refusal.value).startswith(expected)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1\nb: 2\na: 3", "f.yaml:1: a: expected the key once, was there on line 1 and again on line 3. Delete "
         "one."),
        ("a: &x [*x]", "f.yaml:1: a[0]: expected values that do not contain themselves, was an alias of a value aro"),
        ("a: !!set {b}", "f.yaml:1: a: expected a plain value, was one with the tag tag:yaml.org,2002:set. Delete "
         "the t"),
        ("a: 1\nb:\n  c: " + "[" * 31 + "]" * 31,
         "f.yaml:3: b.c" + "[0]" * 30 + ": expected lists and blocks at most 32 deep, was a deeper one."),
        ("a: !mine 3", "f.yaml:1: a: expected a plain value, was one with the tag !mine. Delete the tag."),
        ("a:\n  ? [b]\n  : 1", "f.yaml:1: a: expected keys that are words, was a list or block as a key. Put it in "
         "quo"),
    ],
)  # fmt: skip
def test_problems_of_the_text_are_collected(text, expected):
    problems = read_yaml(text, source="f.yaml").problems
    assert [str(problem)[: len(expected)] for problem in problems] == [expected]


def test_the_deepest_that_is_allowed_is_read():
    assert read_yaml("a: " + "[" * 31 + "1" + "]" * 31, source="f.yaml").problems == ()


def test_the_first_of_two_equal_keys_counts():
    assert read_yaml("a: 1\na: 2", source="f.yaml").values == {"a": 1}


def test_a_short_file_cannot_unfold_to_billions_of_values(monkeypatch):
    monkeypatch.setattr(serialization, "MAX_VALUES", 1000)
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
    bomb += "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 10))
    (problem,) = read_yaml(bomb, source="f.yaml").problems
    assert str(problem) == "f.yaml:1: expected at most 1000 values, was more. Are there aliases of aliases?"


def test_a_long_file_is_not_read_to_its_end(monkeypatch):
    monkeypatch.setattr(yaml_core, "MAX_NODES", 100)
    assert len(read_yaml("[" + "1, " * 90 + "]", source="f.yaml").values) == 90
    with pytest.raises(ScenarioError, match=r"^f\.yaml:1: expected at most 100000 values, was more\.$"):
        read_yaml("[" + "1, " * 101 + "]", source="f.yaml")


@pytest.mark.parametrize(
    "text", ["0x" + "f" * 4000, "0o" + "7" * 4000, "9" * 5000, "!!int x"], ids=["hex", "octal", "decimal", "tag"]
)
def test_a_number_that_is_none_stays_text(text):
    value = text.removeprefix("!!int ")
    assert read_yaml(f"a: {text}", source="f.yaml").values == {"a": value}
    assert yaml.load(f"a: {text}", Loader=CoreLoader) == {"a": value}


def test_an_empty_text_has_no_values():
    tree = read_yaml("# nothing\n", source="f.yaml")
    assert tree.values is None
    assert tree.block is None
