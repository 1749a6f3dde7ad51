"""A figure of the table of speed that has become worse is named, whatever else varies."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from speed_history import Entry, find_regressions, load_entries, save_entry

BOUNDS = {"speed": "at least", "memory": "at most"}


def entry(speed, memory, *, foreign_cores=0.0):
    medians = {"speed": speed, "memory": memory}
    return Entry(commit="0123abcd", processor="x86_64", foreign_cores=foreign_cores, medians=medians)


@pytest.mark.parametrize(
    ("speed", "memory", "expected"),
    [(0.95, 420.0, []), (0.85, 420.0, ["speed"]), (1.0, 500.0, ["memory"]), (2.0, 100.0, [])],
)
def test_what_is_worse_than_the_median_of_the_last_calm_ones_is_named(speed, memory, expected):
    """Old entries and those of busy machines do not count, nor does what is better."""
    old, busy = [entry(9.0, 9.0)] * 5, [entry(9.0, 9.0, foreign_cores=1.0)] * 20
    entries = [*old, *(entry(1.0 + i / 100, 400.0 + i) for i in range(10)), *busy]
    worse = find_regressions({"speed": speed, "memory": memory, "new": 1.0}, BOUNDS, entries)
    assert [sentence.partition(":")[0] for sentence in worse] == expected


def test_entries_are_read_as_they_were_saved(tmp_path):
    path = tmp_path / "history.jsonl"
    assert load_entries(path) == []
    for speed in (1.0, 2.0):
        save_entry(entry(speed, 400.0), path)
    assert load_entries(path) == [entry(1.0, 400.0), entry(2.0, 400.0)]
