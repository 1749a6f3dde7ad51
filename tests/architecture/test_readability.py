"""Counting of words, long and passive sentences on pages."""

import json

import pytest
from readability import Counts, count_page, format_table, list_pages, read_markdown, split_sentences

PAGE = """# A heading of words

The wind is solved once.
It carries the gas, e.g. ethanol, to the robot.
<!-- A comment. -->

- The robot [searches](search.md) it.
- The result is a table.

| a cell | was written |
|---|---|

```sh
gslcosim up warehouse_empty
```
"""


def test_sentences_are_those_of_paragraphs_and_lists():
    assert [len(sentence.split()) for sentence in split_sentences(PAGE.replace("<!-- A comment. -->\n", ""))][:4] == [
        5, 9, 4, 5,
    ]  # fmt: skip


def test_programs_and_comments_are_not_counted():
    counts = count_page(PAGE)
    assert counts.words == 4 + 5 + 9 + 4 + 5 + 2 + 2
    assert counts.sentences == 4
    assert counts.passive == 1
    assert counts.long == 0


@pytest.mark.parametrize(
    ("sentence", "passive"),
    [
        ("The run was stopped.", 1),
        ("A file is never written twice.", 1),
        ("Commands are made by hand.", 1),
        ("The referee stops the run.", 0),
        ("The room is large and the red gas spreads.", 0),
    ],
)
def test_passive_is_a_form_of_be_before_a_participle(sentence, passive):
    assert count_page(sentence).passive == passive


def test_a_sentence_is_long_above_25_words():
    assert count_page(" ".join(["word"] * 25) + ".").long == 0
    assert count_page(" ".join(["word"] * 26) + ".").long == 1


def test_habits_are_counted():
    assert count_page("A sensor of one's own: the page says what counts as success.").habits == 2


def test_a_notebook_counts_its_text():
    cells = [{"cell_type": "markdown", "source": ["Two ", "words."]}, {"cell_type": "code", "source": ["x = 1"]}]
    assert count_page(read_markdown("a.ipynb", json.dumps({"cells": cells}))).words == 2


def test_the_table_has_pages_of_both_times_and_totals():
    lines = format_table(
        {"old.md": Counts(words=10, sentences=2, passive=1)}, {"new.md": Counts(words=5, sentences=1)}
    ).splitlines()
    assert [line.split()[:3] for line in lines[1:3]] == [["new.md", "-", "5"], ["old.md", "10", "-"]]
    assert lines[3].split()[2:] == ["10", "5", "0%", "0%", "50%", "0%", "0", "0"]


def test_pages_are_found(tmp_path):
    for name in ("README.md", "docs/a.md", "agents/x/README.md", "agents/x/notes.md"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert list_pages(tmp_path) == ["README.md", "agents/x/README.md", "docs/a.md"]
