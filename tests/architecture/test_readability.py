"""Counting of words, long and passive sentences on pages."""

import pytest
from readability import count_page

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
