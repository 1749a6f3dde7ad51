"""The part of the freeze that is fast, on any machine; and whether the freeze finds what has changed.

`make freeze-check` compares all of it, in a quarter of an hour.
"""

import functools
import json

import freeze
import pytest
from commands import CommandFailed, Skipped
from jobs import Job, all_jobs, bad_inputs, errors_of
from versions import differing, installed_versions

FROZEN = freeze.Frozen.load(freeze.FROZEN)
HERE = installed_versions()
# Every test of bad input is held by tests of its own.
EACH = 6


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Errors of the command line are wrapped to it.
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path


@functools.cache
def jobs_by_name() -> dict[str, Job]:
    return {job.name: job for job in all_jobs()}


def assert_frozen(entries, names):
    frozen = {name: FROZEN.entries[name] for name in names}
    assert freeze.differences(frozen, entries) == {}, "`make freeze-check` tells all; CONTRIBUTING.md has what to do"


@pytest.mark.slow
@pytest.mark.tour
@pytest.mark.parametrize("name", ["wire/contract", "wire/past_contracts", "list", "resolved"])
def test_what_is_portable_is_as_it_was_frozen(name):
    job = jobs_by_name()[name]
    assert_frozen(job.entries(), [entry for entry in FROZEN.entries if job.holds(entry)])


@pytest.mark.slow
@pytest.mark.tour
def test_errors_are_worded_as_they_were_frozen():
    if FROZEN.versions["python"] != HERE["python"]:
        pytest.skip(f"frozen with Python {FROZEN.versions['python']}, which words some errors itself")
    entries = {f"error/{name}": entry for name, entry in errors_of(bad_inputs()[::EACH]).items()}
    assert_frozen(entries, entries)


@pytest.mark.slow
def test_processes_do_not_matter_to_a_run_which_is_as_it_was_frozen():
    runs = {mode: jobs_by_name()[f"run/tiny_room/seed2/{mode}"] for mode in ("one", "separate")}
    entries = {mode: run.entries()[run.name] for mode, run in runs.items()}
    assert entries["one"].items() >= entries["separate"].items()
    skip_with_other_versions()
    assert_frozen({run.name: entries[mode] for mode, run in runs.items()}, [run.name for run in runs.values()])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["warehouse_empty/full", "event_door/seed1/one", "event_rotor/seed1/one"])
def test_a_run_has_the_digest_that_was_frozen_on_another_processor(name):
    skip_with_other_versions()
    job = jobs_by_name()[f"run/{name}"]
    assert_frozen(job.entries(), [job.name])


def skip_with_other_versions():
    if differences := differing(FROZEN.versions, HERE):
        pytest.skip(f"digests were frozen with other versions: {differences}")


# --- the freeze itself -----------------------------------------------------------------------------------------------


def test_every_job_is_frozen_or_skipped_with_a_reason():
    """A job that was added and not frozen holds nothing."""
    missing = [
        job.name
        for job in jobs_by_name().values()
        if not any(job.holds(entry) for entry in FROZEN.entries) and not FROZEN.skipped.get(job.name)
    ]
    assert missing == []


def test_a_changed_and_a_missing_entry_are_named_with_what_they_were():
    frozen = {"run/a": {"digest": "1", "end": "success"}, "run/b": {"digest": "2"}}
    now = {"run/a": {"digest": "3", "end": "success"}, "run/new": {"digest": "4"}}
    assert freeze.differences(frozen, now) == {"run/a": "digest: was 1, is 3", "run/b": "gone"}
    assert freeze.differences({"run/a": {"digest": "1"}}, {"run/a": {}}) == {"run/a": "digest: was 1, is missing"}


def test_no_entry_holds_where_code_lies_or_which_version_it_has():
    """Code moves below the freeze: no module path, path of this checkout or version of the framework is in it."""
    text = freeze.FROZEN.read_text(encoding="utf-8")
    assert str(freeze.ROOT) not in text
    entries = json.dumps({name: entry for name, entry in FROZEN.entries.items() if not name.startswith("error/")})
    assert "gslcosim." not in entries
    assert "/home/" not in text
    assert "/tmp/" not in text


def test_other_versions_are_reported_and_only_what_is_portable_compared():
    other = {**HERE, "numpy": "9.0", "python": "3.99"}
    assert differing(HERE, HERE) == ""
    assert f"numpy {HERE['numpy']}, here 9.0" in differing(HERE, other)
    names = {job.name for job in freeze.comparable_jobs(all_jobs(), HERE, other)}
    assert names == {"wire/contract", "wire/past_contracts", "list", "resolved"}
    other["python"] = HERE["python"]
    assert {job.name for job in freeze.comparable_jobs(all_jobs(), HERE, other)} == {*names, "error"}
    assert len(freeze.comparable_jobs(all_jobs(), HERE, HERE)) == len(all_jobs())


def test_a_frozen_file_has_an_entry_a_line_and_is_read_as_it_was_written(tmp_path):
    frozen = freeze.Frozen({"numpy": "9.0"}, {"b": {"digest": "2"}, "a": {"x": "1"}}, {"c": "no camera"})
    frozen.save(tmp_path / "frozen.json")
    assert freeze.Frozen.load(tmp_path / "frozen.json") == frozen
    assert '\n  "a": {"x": "1"},\n  "b": {"digest": "2"}\n' in (tmp_path / "frozen.json").read_text()


def test_an_interrupted_freeze_goes_on_unless_an_input_has_changed(tmp_path, monkeypatch):
    path = tmp_path / "partial.jsonl"
    first = freeze.Partial(path, HERE)
    assert first.is_new
    first.begin()
    first.add(freeze.Done("a", {"a": {"x": "1"}}))
    first.add(freeze.Done("b", failed="it hung"))
    with path.open("a") as file:
        file.write('{"job": "c", "entr')
    again = freeze.Partial(path, HERE)
    assert {name: done.entries for name, done in again.done.items()} == {"a": {"a": {"x": "1"}}}
    assert freeze.Partial(path, {**HERE, "numpy": "9.0"}).is_new
    monkeypatch.setattr(freeze, "hash_of_files", lambda *places: "other sources")
    assert freeze.Partial(path, HERE).is_new


def test_what_fails_is_tried_twice_and_named_and_what_cannot_be_is_skipped(monkeypatch):
    calls = []

    def fails():
        calls.append("fails")
        raise CommandFailed("expected exit code 0, was 3")

    def cannot():
        raise Skipped("cameras need EGL or OSMesa")

    monkeypatch.setattr(freeze, "all_jobs", lambda: [Job("fails", fails), Job("cannot", cannot)])
    assert "expected exit code 0, was 3" in freeze.compute("fails").failed
    assert len(calls) == 2
    done = freeze.compute("cannot")
    assert (done.skipped, done.failed, done.entries) == ("cameras need EGL or OSMesa", "", {})


def test_patterns_choose_jobs_by_name_and_by_beginning():
    names = [job.name for job in freeze.chosen_jobs(["run/tiny_room", "error", "batch/*"])]
    assert {"run/tiny_room/seed1/one", "error", "batch/open_halls"} <= set(names)
    assert not any(name.startswith(("travel", "run/warehouse")) for name in names)
    assert freeze.chosen_jobs(["no_such_job"]) == []
