"""What the machine refuses is one sentence with a remedy; a mistake of ours is not blamed on it."""

import errno
import os
import resource

import pytest

from gslcosim.base import errors
from gslcosim.base.errors import (
    ExitCode,
    MachineError,
    ScenarioError,
    UsageError,
    build_machine_error,
    check_working_directory,
    format_fault,
    translate,
)


def refused(number, *names):
    return OSError(number, os.strerror(number), *names)


def test_an_error_names_place_expected_found_remedy_and_file():
    error = build_machine_error(
        refused(errno.ENOSPC), "inputs.log", "a file that can be written", path="runs/a/inputs.log"
    )
    assert str(error) == (
        "inputs.log: expected a file that can be written, was no space left on device. "
        "Free room there, or choose another disk.\nFile: runs/a/inputs.log"
    )
    assert error.exit_code is ExitCode.FAULT


def test_what_nobody_foresaw_has_the_file_that_the_machine_names():
    assert str(translate(refused(errno.EROFS, "/mnt/x"))) == (
        "the machine: expected it to do what was asked, was read-only file system. "
        "Choose a place on a disk that can be written.\nFile: /mnt/x"
    )


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        ValueError("Error: engine error: Could not allocate memory"),
        ImportError("libx.so: failed to map segment from shared object"),
    ],
)
def test_lack_of_memory_is_the_machines_in_all_its_words(error):
    translated = translate(error)
    assert isinstance(translated, MachineError)
    assert "was out of memory. Close programs, or raise the limit on memory (ulimit -v)." in str(translated)


STARTS_NO_THREAD = pytest.mark.parametrize(
    "error",
    [
        RuntimeError("can't start new thread"),
        RuntimeError("Failed to spawn background thread: Resource temporarily unavailable (os error 11)"),
        BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable"),
    ],
)


@STARTS_NO_THREAD
def test_lack_of_processes_is_reported_as_such(error):
    """Where nothing limits memory, there are too many threads."""
    translated = translate(error)
    assert isinstance(translated, MachineError)
    assert str(translated) == (
        "the machine: expected room for one more process or thread, was none. Close programs, or raise the limit on "
        "processes (ulimit -u; in a container, that on its tasks)."
    )


@STARTS_NO_THREAD
def test_a_thread_that_finds_no_room_under_a_limit_on_memory_lacks_memory(error, monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda _: (2_000_000_000, resource.RLIM_INFINITY))
    assert "was out of memory. Close programs, or raise the limit on memory (ulimit -v)." in str(translate(error))


def test_of_two_files_the_one_that_cannot_be_made_is_named():
    """What is there already was named where a link to it found no room."""
    assert str(translate(refused(errno.ENOSPC, "/cache/there", None, "/tmp/new"))).endswith("\nFile: /tmp/new")
    assert str(translate(refused(errno.EACCES, "/cache/there", None, "/tmp/new"))).endswith("\nFile: /cache/there")


def test_a_working_directory_that_was_removed_is_refused(tmp_path, monkeypatch):
    check_working_directory()
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(UsageError, match="working directory: expected a folder, was removed since it was entered"):
        check_working_directory()


def test_a_mistake_of_ours_is_reported_with_its_trace():
    assert translate(ValueError("no")) is None
    assert format_fault(ValueError("no"), "the trace") == "the trace"
    assert format_fault(ScenarioError("line 3: no."), "the trace") == "line 3: no."
    assert format_fault(refused(errno.ENOSPC), "the trace").startswith("the machine: expected")


@pytest.mark.parametrize(("limit", "remedy"), [(10**9, "raise the limit on memory (ulimit -v)."), (None, "try again.")])
def test_a_library_that_cannot_be_loaded_lacks_memory_where_that_is_limited(monkeypatch, limit, remedy):
    monkeypatch.setattr(errors, "_read_address_limit", lambda: limit)
    error = OSError(
        "Could not find/load shared object file 'libllvmlite.so' from resource location: 'llvmlite.binding'"
    )
    assert str(translate(error)).endswith(remedy)
