"""What the machine refuses is one sentence with a remedy; a mistake of ours is not blamed on it."""

import errno
import os

import pytest

from gslcosim.errors import ExitCode, MachineError, ScenarioError
from gslcosim.machine import fault_text, machine_error, unforeseen


def refused(number, *names):
    return OSError(number, os.strerror(number), *names)


def test_an_error_names_place_expected_found_remedy_and_file():
    error = machine_error(refused(errno.ENOSPC), "inputs.log", "a file that can be written", path="runs/a/inputs.log")
    assert str(error) == (
        "inputs.log: expected a file that can be written, was no space left on device. "
        "Free room there, or choose another disk.\nFile: runs/a/inputs.log"
    )
    assert error.exit_code is ExitCode.FAULT


def test_what_nobody_foresaw_has_the_file_that_the_machine_names():
    assert str(unforeseen(refused(errno.EROFS, "/mnt/x"))) == (
        "the machine: expected it to do what was asked, was read-only file system. "
        "Choose a place on a disk that can be written.\nFile: /mnt/x"
    )


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        RuntimeError("can't start new thread"),
        ValueError("Error: engine error: Could not allocate memory"),
        ImportError("libx.so: failed to map segment from shared object"),
        RuntimeError("Failed to spawn background thread: Resource temporarily unavailable (os error 11)"),
    ],
)
def test_lack_of_memory_is_the_machines_in_all_its_words(error):
    told = unforeseen(error)
    assert isinstance(told, MachineError)
    assert "was out of memory. Close programs, or raise the limit on memory (ulimit -v)." in str(told)


def test_a_mistake_of_ours_is_told_with_its_trace():
    assert unforeseen(ValueError("no")) is None
    assert fault_text(ValueError("no"), "the trace") == "the trace"
    assert fault_text(ScenarioError("line 3: no."), "the trace") == "line 3: no."
    assert fault_text(refused(errno.ENOSPC), "the trace").startswith("the machine: expected")
