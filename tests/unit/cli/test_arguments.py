"""Runs by folder, file, id or age."""

import os

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import find_in_run


@pytest.fixture
def runs(tmp_path):
    """Three runs: an old and a new one with a digest, and the newest without."""
    for age, (name, has_digest) in enumerate([("hall-1-new", True), ("hall-2-old", True), ("room-3", False)]):
        folder = tmp_path / "runs" / name
        folder.mkdir(parents=True)
        if has_digest:
            (folder / "digest.json").touch()
            os.utime(folder / "digest.json", (1000 - age, 1000 - age))
    return tmp_path / "runs"


@pytest.mark.parametrize("run", ["{runs}/hall-2-old", "{runs}/hall-2-old/digest.json", "hall-2-old", "hall-2"])
def test_a_run_is_found_by_folder_file_id_or_its_beginning(runs, run):
    found = find_in_run(run.format(runs=runs), runs_dir=runs, file_name="digest.json")
    assert found == runs / "hall-2-old" / "digest.json"


def test_the_newest_run_that_has_the_file_is_the_default(runs):
    assert find_in_run(None, runs_dir=runs, file_name="digest.json") == runs / "hall-1-new" / "digest.json"


@pytest.mark.parametrize(
    ("run", "expected"),
    [
        ("none", "none: expected a run's folder or the id of one run in {runs}, found none."),
        ("hall", "hall: expected a run's folder or the id of one run in {runs}, found 2 that fit: hall-1-new, "
         "hall-2-old."),
        ("room-3", "room-3: expected a run with a digest.json, found none. Has the run ended well?"
         "\nFile: {runs}/room-3/digest.json"),
    ],
)  # fmt: skip
def test_a_run_that_is_not_there_is_reported(runs, run, expected):
    with pytest.raises(UsageError) as refusal:
        find_in_run(run, runs_dir=runs, file_name="digest.json")
    assert str(refusal.value) == expected.format(runs=runs)


def test_where_there_is_no_run_one_is_proposed(tmp_path):
    with pytest.raises(UsageError, match="Fly one: gslcosim up warehouse_empty"):
        find_in_run(None, runs_dir=tmp_path, file_name="digest.json")


@pytest.mark.parametrize("run", ["/no/such/folder", "*", "../hall", "[", "hall**"])
def test_a_path_that_is_not_there_and_a_pattern_are_reported_like_any_other(runs, run):
    """No text makes it look somewhere else, or end with a traceback."""
    with pytest.raises(UsageError, match="found none"):
        find_in_run(run, runs_dir=runs, file_name="digest.json")
