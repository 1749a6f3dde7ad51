"""Files of tests that a mark leaves out whole: they need not be imported, which takes longer than to read them."""

import ast
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

MISREAD = pytest.StashKey[list[str]]()
_MARK = re.compile(r"\bmark\.(\w+)")
_IMPORT = re.compile(r"^(?:from|import) (\w+)", re.MULTILINE)


def is_whole_suite(config: pytest.Config) -> bool:
    """Return whether all tests are collected, of which marks and words may leave some out."""
    if config.option.ignore or config.option.ignore_glob or config.option.deselect:
        return False
    asked = {(config.invocation_params.dir / path).resolve() for path in config.args}
    return asked == {(config.rootpath / path).resolve() for path in config.getini("testpaths")}


def is_left_out(path: Path, config: pytest.Config) -> bool:
    """Return whether no test of a file can have the marks that `-m` asks for.

    An expression that tests without a mark satisfy leaves out no file, nor does one that this function cannot read.
    """
    expression = config.option.markexpr
    if not expression or not path.name.startswith("test_"):
        return False
    asked = _parse(expression)
    return asked is not None and not _possible(asked, frozenset())[0] and not _possible(asked, _marks_of(path))[0]


def find_misread(items: Iterable[pytest.Item], marks: Iterable[str]) -> list[str]:
    """Return the tests with one of the marks that is not seen in their file, so that `is_left_out` may be wrong."""
    asked = set(marks)
    return [item.nodeid for item in items if not {m.name for m in item.iter_markers()} & asked <= _marks_of(item.path)]


@cache
def _parse(expression: str) -> ast.expr | None:
    try:
        return ast.parse(expression, mode="eval").body
    except SyntaxError:
        return None


# Whether an expression can be true and can be false of a test that may have some of the named marks.
def _possible(node: ast.expr, marks: frozenset[str]) -> tuple[bool, bool]:
    if isinstance(node, ast.Name):
        return node.id in marks, True
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        can_hold, can_fail = _possible(node.operand, marks)
        return can_fail, can_hold
    if isinstance(node, ast.BoolOp):
        can_hold, can_fail = zip(*(_possible(value, marks) for value in node.values), strict=True)
        return (all(can_hold), any(can_fail)) if isinstance(node.op, ast.And) else (any(can_hold), all(can_fail))
    return True, True


# The marks that a file names, those in modules of tests that it imports, and those that its folders give.
@cache
def _marks_of(path: Path) -> frozenset[str]:
    texts = [_read(path), *(_read(folder / "conftest.py") for folder in path.parents[:-1])]
    marks = {mark for text in texts for mark in _MARK.findall(text)}
    for name in _IMPORT.findall(texts[0]):
        for helper in {path.with_name(f"{name}.py"), *_helpers().get(name, ())} - {path}:
            marks |= _marks_of(helper)
    return frozenset(marks)


@cache
def _helpers() -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for path in Path(__file__).parents[1].rglob("*.py"):
        found.setdefault(path.stem, []).append(path)
    return found


@cache
def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""
