"""Exception tree: one class for each party that can act, and errors of the operating system in one sentence."""

import errno
import os
import sys
import traceback
from enum import IntEnum
from pathlib import Path
from typing import ClassVar

if sys.platform != "win32":
    import resource

_FREE_SPACE_REMEDY = "Free room there, or choose another disk."
_PERMISSION_REMEDY = "Change its permissions, or choose another place."
_FILE_TYPE_REMEDY = "A file is where a folder should be, or the other way round: move it away, or choose another place."
_REMEDIES = {
    errno.ENOSPC: _FREE_SPACE_REMEDY,
    errno.EDQUOT: _FREE_SPACE_REMEDY,
    errno.EFBIG: "Raise the limit on the size of a file (ulimit -f), or choose another disk.",
    errno.EROFS: "Choose a place on a disk that can be written.",
    errno.EACCES: _PERMISSION_REMEDY,
    errno.EPERM: _PERMISSION_REMEDY,
    errno.ENOENT: "Make it, or choose another place.",
    errno.ENOTDIR: _FILE_TYPE_REMEDY,
    errno.EEXIST: _FILE_TYPE_REMEDY,
    errno.EISDIR: _FILE_TYPE_REMEDY,
    errno.ELOOP: "A symbolic link is where a file or folder of its own should be: take it away.",
    errno.EMFILE: "Raise the limit on open files (ulimit -n).",
    errno.ENFILE: "Close programs.",
    errno.ENOMEM: "Close programs, or raise the limit on memory (ulimit -v).",
    errno.EAGAIN: "Close programs, or raise the limit on processes (ulimit -u).",
    errno.EIO: "Check the disk.",
}
RESOURCE_ERRNOS = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOSPC, errno.EAGAIN)
"""Error numbers of exhausted resources, whatever the request."""

_TARGET_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EEXIST)
_PATH_ERRNOS = (errno.EEXIST, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ENOTEMPTY)
# Messages of Python and packages for lack of memory, without an error class of its own.
_MEMORY_MESSAGES = (
    "cannot allocate memory",
    "failed to map segment",
    "could not allocate memory",
    "out of memory",
)
# llvmlite's message for every reason for which its library could not be loaded.
_LIBRARY_MESSAGE = "could not find/load shared object"
# The system gives one reason for both: no more processes (threads count as such), or no room for a stack.
_PROCESS_MESSAGES = ("can't start new thread", "resource temporarily unavailable")
# With a smaller address space third-party packages hang or abort on import, without a reason.
MIN_ADDRESS_SPACE_MB = 1200
# Package that builds and refuses messages.
_CONTRACT = Path(__file__).resolve().parents[1] / "contract"


class ExitCode(IntEnum):
    """Exit codes of the command line; each stands for the party that has to act."""

    SUCCESS = 0
    AGENT_FAILED = 1
    USAGE = 2
    FAULT = 3
    TIMEOUT = 4
    DIVERGENCE = 5
    INTERRUPTED = 130


class GslCosimError(Exception):
    """Base of all errors raised on purpose; its text is for people."""

    exit_code: ClassVar[ExitCode] = ExitCode.FAULT


class ScenarioError(GslCosimError):
    """A scenario file is wrong; the user corrects the places listed in the message."""

    exit_code = ExitCode.USAGE


class UsageError(GslCosimError):
    """A command line is wrong; the user corrects the call."""

    exit_code = ExitCode.USAGE


class VehicleError(GslCosimError):
    """The folder of a vehicle is incomplete or contradicts itself; the vehicle's author corrects it."""

    exit_code = ExitCode.USAGE


class EnvironmentDataError(GslCosimError):
    """An environment folder or imported file is missing, corrupt or inconsistent; the user fixes the file."""

    exit_code = ExitCode.USAGE


class MachineError(GslCosimError):
    """The machine lacks something: room, permission, memory; the user makes room or chooses another place."""

    exit_code = ExitCode.FAULT


class RecordingError(GslCosimError):
    """A recording cannot be shown or repaired; the user installs the package named, or repeats the run."""

    exit_code = ExitCode.USAGE


class RecordingWriteError(MachineError, RecordingError):
    """A recording cannot be written; the user frees disk space, or runs without a recording."""


class RunFolderError(MachineError):
    """A file in a run's folder cannot be written; the user frees disk space, or finds what removed the folder."""


class FlowError(GslCosimError):
    """A wind solve cannot start or has diverged; the user changes boundary, cell or time step."""

    exit_code = ExitCode.USAGE


class ShapeError(GslCosimError, ValueError):
    """An array argument has the wrong shape or dtype; the caller's code is wrong."""


class MethodError(GslCosimError):
    """A method lacks an input, or its card or a parameter is wrong; the user changes the scenario or the card."""


class ContractError(GslCosimError):
    """A message violates the contract; the sender is at fault."""


class DataflowError(GslCosimError):
    """Declared reads and writes do not form a runnable dataflow (for example a cycle without delay)."""


class ModelError(GslCosimError):
    """A core's state became invalid (not finite, out of its range); the run is stopped."""


class SnapshotError(GslCosimError):
    """A core's state cannot be saved or restored; the text names the part."""


class SimulationFault(GslCosimError):  # noqa: N818 - a fault of a service, which the text names
    """A service failed during a run; the text names the service."""


class RunTimeoutError(GslCosimError):
    """Nothing moved for longer than allowed; the text lists the processes and what each waits for."""

    exit_code = ExitCode.TIMEOUT


def check_address_space() -> None:
    """Refuse a limit on the address space below which no run works."""
    limit = _read_address_limit()
    if limit is not None and limit < MIN_ADDRESS_SPACE_MB * 1e6:
        raise MachineError(
            f"the machine: expected room for {MIN_ADDRESS_SPACE_MB} MB of addresses in each process, was a limit of "
            f"{limit / 1e6:.0f} MB. Raise the limit on memory (ulimit -v)."
        )


def _read_address_limit() -> int | None:
    if sys.platform == "win32":
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def check_working_directory() -> None:
    """Refuse a working directory that was removed, in which relative paths have no meaning."""
    try:
        Path.cwd()
    except FileNotFoundError as error:
        raise UsageError(
            "working directory: expected a folder, was removed since it was entered. Change to one that is there (cd)."
        ) from error


def build_process_error() -> MachineError:
    """Return the error for a process or thread that could not be started."""
    if _read_address_limit() is not None:
        return build_machine_error(MemoryError(), "the machine", "memory for one thing more")
    return MachineError(
        "the machine: expected room for one more process or thread, was none. Close programs, or raise the limit on "
        "processes (ulimit -u; in a container, that on its tasks)."
    )


def describe_os_error(error: OSError | MemoryError) -> str:
    """Return the machine's reason, as part of a sentence."""
    if isinstance(error, MemoryError) or error.errno == errno.ENOMEM:
        return "out of memory"
    return (error.strerror or str(error) or type(error).__name__).rstrip(".").lower()


def find_remedy(error: OSError | MemoryError) -> str:
    """Return the remedy for an error of the machine, as a sentence."""
    number = errno.ENOMEM if isinstance(error, MemoryError) else error.errno
    return _REMEDIES.get(number or 0, "Look at what it says, then try again.")


def build_machine_error(
    error: OSError | MemoryError,
    place: str,
    expected: str,
    *,
    path: Path | str | None = None,
    remedy: str = "",
) -> MachineError:
    """Return the readable error for a failure of the machine.

    Args:
        error: Error of the operating system.
        place: The thing that could not be used.
        expected: Its expected state, for example `a folder that can be written`.
        path: The file or folder; by default the one that the error names.
        remedy: A sentence; by default the remedy for this kind of error.
    """
    return MachineError(format_machine_error(error, place, expected, path=path, remedy=remedy))


def format_machine_error(
    error: OSError | MemoryError, place: str, expected: str, *, path: Path | str | None = None, remedy: str = ""
) -> str:
    """Return the text of `build_machine_error`."""
    if path is None and isinstance(error, OSError):
        # For a link, a copy or a move the system also names the existing target.
        is_target = error.filename2 is not None and error.errno in _TARGET_ERRNOS
        path = error.filename2 if is_target else error.filename
    text = f"{place}: expected {expected}, was {describe_os_error(error)}. {remedy or find_remedy(error)}"
    return text if path is None else f"{text}\nFile: {os.fspath(path)}"


def build_path_error(error: OSError, place: str, expected: str, *, path: Path | str) -> GslCosimError:
    """Return the readable error for a path that the caller has named.

    Returns:
        UsageError if another path suffices, MachineError if the machine lacks something.
    """
    text = format_machine_error(error, place, expected, path=path)
    return UsageError(text) if error.errno in _PATH_ERRNOS else MachineError(text)


def translate(error: BaseException) -> MachineError | None:
    """Return the readable error for an unforeseen failure of the machine, else None."""
    if isinstance(error, MachineError):
        return error
    if isinstance(error, OSError) and _is_kernel_cache_error(error):
        remedy = "Free room there, or set GSLCOSIM_CACHE to a folder that can be written."
        return build_machine_error(error, "cache of compiled kernels", "a folder that can be written", remedy=remedy)
    if isinstance(error, BlockingIOError) and error.filename is None:
        return build_process_error()
    said = str(error).lower()
    if isinstance(error, OSError) and _LIBRARY_MESSAGE in said and _read_address_limit() is not None:
        return build_machine_error(MemoryError(), "the machine", "memory for one thing more")
    if isinstance(error, OSError | MemoryError):
        return build_machine_error(error, "the machine", "it to do what was asked")
    is_of_a_package = isinstance(error, RuntimeError | ImportError | SystemError | ValueError)
    if is_of_a_package and any(word in said for word in _PROCESS_MESSAGES):
        return build_process_error()
    if is_of_a_package and any(word in said for word in _MEMORY_MESSAGES):
        return build_machine_error(MemoryError(), "the machine", "memory for one thing more")
    return None


# Numba's errors do not name the file, so the frames of its cache identify them.
def _is_kernel_cache_error(error: BaseException) -> bool:
    frames = (frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(error.__traceback__))
    return "numba.core.caching" in frames


def cut_contract_frames(error: BaseException) -> None:
    """Cut the frames of the contract off an error's traceback, so that it ends at the line that built the message.

    The fault is in that line, not in the contract's checks.
    """
    last, frame = None, error.__traceback__
    while frame is not None:
        if not Path(frame.tb_frame.f_code.co_filename).is_relative_to(_CONTRACT):
            last = frame
        frame = frame.tb_next
    if last is not None:
        last.tb_next = None


def format_fault(error: BaseException, trace: str) -> str:
    """Return the message of an error that ends a run."""
    if isinstance(error, GslCosimError):
        return str(error)
    refused = translate(error)
    return trace if refused is None else str(refused)
