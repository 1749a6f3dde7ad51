"""Comments and docstrings of the core name programs as programs: no persons, and no clause in place of a noun."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PATHS = sorted([*ROOT.glob("gslcosim/**/*.py"), *ROOT.glob("services/**/*.py")])
WORDS = re.compile(
    r"(?i:\b(?:who|whom|whoever|nobody|somebody|everybody|anybody|told|tells|says|hears|knows|flown)\b)"
    r"|(?:^\W*|[.:;]\s+)What\b",
    re.MULTILINE,
)
# Code in a text, and the names of arguments and attributes that a docstring lists.
CODE = re.compile(r"``.*?``|`[^`]*`|^ *\*{0,2}\w+:(?= )", re.MULTILINE | re.DOTALL)


def list_prose(source):
    """Return the docstrings, texts below constants, and comments of a module."""
    strings = [
        node.value.value
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    ]
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return [*strings, *(token.string for token in tokens if token.type == tokenize.COMMENT)]


def find_words(source):
    """Return the words in the prose of a module that stand for a person, or begin a sentence with a clause."""
    # Most modules have no such word anywhere, and parsing them all would take seconds.
    if not WORDS.search(source):
        return []
    texts = (CODE.sub("", text) for text in list_prose(source))
    return sorted({word.lstrip("# .:;\n") for text in texts for word in WORDS.findall(text)})


def test_prose_of_the_core_has_no_persons_for_programs():
    found = {path.relative_to(ROOT).as_posix(): find_words(path.read_text()) for path in PATHS}
    assert {name: words for name, words in found.items() if words} == {}


@pytest.mark.parametrize(
    "source",
    [
        '"""Agents that nobody starts."""',
        'def f():\n    """Return what is needed.\n\n    Args:\n        x: Whoever asks.\n    """',
        'class C:\n    """What a run needs."""',
        'LIMIT = 1\n"""It says how many."""',
        "# The last one: who comes later waits.",
        "x = 1  # somebody's",
        "# The first. What follows is the second.",
        "# Told apart by identity.",
    ],
)
def test_words_are_found_in_docstrings_and_comments(source):
    assert len(find_words(source)) == 1


@pytest.mark.parametrize(
    "source",
    [
        'raise Error("nobody reads it")',
        "def nobody(who): return who.knows",
        '"""Return `knows`, as ``who`` has it."""',
        'def f(knows):\n    """Return a card.\n\n    Args:\n        knows: Granted knowledge.\n    """',
        "# Return what is left, whose size is known.",
    ],
)
def test_texts_names_and_clauses_within_a_sentence_are_passed_over(source):
    assert find_words(source) == []
