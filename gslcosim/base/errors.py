"""Exception tree: one class for each party that can act, and errors of the operating system in one sentence."""

import errno
import os
import sys
import traceback
from enum import IntEnum
from pathlib import Path
from typing import ClassVar


class ExitCode(IntEnum):
    """Exit codes of the command line, which say who has to act."""

    SUCCESS = 0
    AGENT_FAILED = 1
    USAGE = 2
    FAULT = 3
    TIMEOUT = 4
    DIVERGENCE = 5
    INTERRUPTED = 130


class GslCosimError(Exception):
    """Base of all errors raised on purpose; its text is meant for a person."""

    exit_code: ClassVar[ExitCode] = ExitCode.FAULT


class ScenarioError(GslCosimError):
    """A scenario file is wrong; the user corrects the places listed in the message."""

    exit_code = ExitCode.USAGE


class UsageError(GslCosimError):
    """A command line is wrong; the user corrects the call."""

    exit_code = ExitCode.USAGE


class VehicleError(GslCosimError):
    """The folder of a vehicle is incomplete or contradicts itself; who made the vehicle corrects it."""

    exit_code = ExitCode.USAGE


class EnvironmentDataError(GslCosimError):
    """An environment folder or imported file is missing, corrupt or inconsistent; the user fixes the file."""

    exit_code = ExitCode.USAGE


class MachineError(GslCosimError):
    """The machine refuses something: room, permission, memory; the user makes room or chooses another place."""

    exit_code = ExitCode.FAULT


class RecordingError(GslCosimError):
    """A recording cannot be shown or repaired; the user installs what is named, or flies the run again."""

    exit_code = ExitCode.USAGE


class RecordingWriteError(MachineError, RecordingError):
    """A recording cannot be written; the user frees the disk, or does without the recording."""


class RunFolderError(MachineError):
    """A file in a run's folder cannot be written; the user frees the disk, or finds out who took the folder away."""


class FlowError(GslCosimError):
    """A wind solve cannot start or has diverged; the user changes boundary, cell or time step."""

    exit_code = ExitCode.USAGE


class ShapeError(GslCosimError, ValueError):
    """An array argument has the wrong shape or dtype; the caller's code is wrong."""


class MethodError(GslCosimError):
    """A method lacks what it needs, or its card or a parameter is wrong; the user changes the scenario or the card."""


class ContractError(GslCosimError):
    """A message is not what the contract says; the sender is wrong."""


class DataflowError(GslCosimError):
    """Declared reads and writes do not form a runnable dataflow (for example a cycle without delay)."""


class ModelError(GslCosimError):
    """A core's state became invalid (not finite, out of its range); the run is stopped."""


class SnapshotError(GslCosimError):
    """A core's state cannot be kept or brought back; the text says what of it."""


class SimulationFault(GslCosimError):  # noqa: N818 - it is somebody's fault, and the text says whose
    """A service failed during a run; names the culprit."""


class RunTimeoutError(GslCosimError):
    """Nothing moved for longer than allowed; says who waits for whom."""

    exit_code = ExitCode.TIMEOUT


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
"""Error numbers of exhausted resources, whatever was asked for."""

_TARGET_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EEXIST)
_PATH_ERRNOS = (errno.EEXIST, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ENOTEMPTY)
# What Python and packages say instead of an error of a class of its own.
_MEMORY_MESSAGES = (
    "cannot allocate memory",
    "failed to map segment",
    "could not allocate memory",
    "out of memory",
)
# What llvmlite makes of every reason for which its library could not be loaded.
_LIBRARY_MESSAGE = "could not find/load shared object"
# The system gives one reason for both: no more processes, which threads count as, or no room for a stack.
_PROCESS_MESSAGES = ("can't start new thread", "resource temporarily unavailable")
# With less room for addresses packages of other people hang or abort while they are loaded, and nobody can tell why.
MIN_ADDRESS_SPACE_MB = 1200


def check_address_space() -> None:
    """Refuse a limit on addresses below which no run works."""
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
    """Refuse a working directory that was removed, in which no relative path means anything."""
    try:
        Path.cwd()
    except FileNotFoundError as error:
        raise UsageError(
            "working directory: expected a folder, was removed since it was entered. Change to one that is there (cd)."
        ) from error


def build_process_error() -> MachineError:
    """Return an error for a person where a process or thread could not be started."""
    if _read_address_limit() is not None:
        return build_machine_error(MemoryError(), "the machine", "memory for one thing more")
    return MachineError(
        "the machine: expected room for one more process or thread, was none. Close programs, or raise the limit on "
        "processes (ulimit -u; in a container, that on its tasks)."
    )


def describe_os_error(error: OSError | MemoryError) -> str:
    """Return the reason that the machine gives, as part of a sentence."""
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
    """Return an error for a person, made of what the machine said.

    Args:
        error: What the machine said.
        place: What could not be used.
        expected: What it should have been, for example `a folder that can be written`.
        path: The file or folder; by default the one that the error names.
        remedy: What to do; by default what helps against this kind of error.
    """
    return MachineError(format_machine_error(error, place, expected, path=path, remedy=remedy))


def format_machine_error(
    error: OSError | MemoryError, place: str, expected: str, *, path: Path | str | None = None, remedy: str = ""
) -> str:
    """Return the text of `build_machine_error`."""
    named = _get_refused_path(error) if path is None and isinstance(error, OSError) else path
    text = f"{place}: expected {expected}, was {describe_os_error(error)}. {remedy or find_remedy(error)}"
    return text if named is None else f"{text}\nFile: {os.fspath(named)}"


# Of a link, a copy or a move the machine names what is there already as well.
def _get_refused_path(error: OSError) -> Path | str | None:
    return error.filename2 if error.filename2 is not None and error.errno in _TARGET_ERRNOS else error.filename


def build_path_error(error: OSError, place: str, expected: str, *, path: Path | str) -> GslCosimError:
    """Return an error for a person about a place that the call itself has named.

    Returns:
        UsageError where another place is all that is needed, MachineError where the machine lacks something.
    """
    text = format_machine_error(error, place, expected, path=path)
    return UsageError(text) if error.errno in _PATH_ERRNOS else MachineError(text)


def translate(error: BaseException) -> MachineError | None:
    """Return an error for a person where the machine has refused something that nobody has foreseen, else None."""
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


# Numba does not say which file it was; what it reads and writes are our functions.
def _is_kernel_cache_error(error: BaseException) -> bool:
    frames = (frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(error.__traceback__))
    return "numba.core.caching" in frames


# Where messages are made and refused.
_CONTRACT = Path(__file__).resolve().parents[1] / "contract"


def cut_contract_frames(error: BaseException) -> None:
    """Cut the frames of the contract off an error's traceback, so that it ends at the line that made the message.

    Whoever wrote that line has to look at it, not at how the contract checked it.
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
