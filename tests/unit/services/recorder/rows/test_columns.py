"""Columns of rows are as the rows are, whatever the order of their items."""

from types import SimpleNamespace

import pytest

from gslcosim_services.recorder.rows.columns import split_columns


def make_items(names):
    return tuple(SimpleNamespace(agent=name, sensor=f"nose of {name}") for name in names)


@pytest.mark.parametrize(
    "all_names",
    [["ab", "ab", "ab"], ["ab", "ba", "ab"], ["ab", "b", "abc"], ["", "a", ""], ["", ""], []],
    ids=["alike", "another order", "some missing", "seldom any", "never any", "no rows"],
)
def test_each_key_has_its_items_at_their_ticks(all_names):
    ticks, rows = range(5, 5 + len(all_names)), [make_items(names) for names in all_names]
    found = {key: list(zip(*column, strict=True)) for key, column in split_columns(ticks, rows, "agent")}
    assert found == {
        name: [(tick, item) for tick, row in zip(ticks, rows, strict=True) for item in row if item.agent == name]
        for name in sorted({*"".join(all_names)})
    }


def test_several_attributes_make_one_key():
    ((key, column),) = split_columns([3], [make_items("a")], "agent", "sensor")
    assert key == ("a", "nose of a")
    assert [item.agent for item in column[1]] == ["a"]
