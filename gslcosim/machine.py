"""What the machine refuses, told as one sentence with a remedy: no room, no permission, no memory."""

import errno
import os
import sys
import traceback
from pathlib import Path

from gslcosim.errors import GslCosimError, MachineError, UsageError

if sys.platform != "win32":
    import resource

_FREE_ROOM = "Free room there, or choose another disk."
_CHOOSE_ANOTHER = "Change its permissions, or choose another place."
_IN_THE_WAY = "A file is where a folder should be, or the other way round: move it away, or choose another place."
_REMEDIES = {
    errno.ENOSPC: _FREE_ROOM,
    errno.EDQUOT: _FREE_ROOM,
    errno.EFBIG: "Raise the limit on the size of a file (ulimit -f), or choose another disk.",
    errno.EROFS: "Choose a place on a disk that can be written.",
    errno.EACCES: _CHOOSE_ANOTHER,
    errno.EPERM: _CHOOSE_ANOTHER,
    errno.ENOENT: "Make it, or choose another place.",
    errno.ENOTDIR: _IN_THE_WAY,
    errno.EEXIST: _IN_THE_WAY,
    errno.EISDIR: _IN_THE_WAY,
    errno.ELOOP: "A symbolic link is where a file or folder of its own should be: take it away.",
    errno.EMFILE: "Raise the limit on open files (ulimit -n).",
    errno.ENFILE: "Close programs.",
    errno.ENOMEM: "Close programs, or raise the limit on memory (ulimit -v).",
    errno.EAGAIN: "Close programs, or raise the limit on processes (ulimit -u).",
    errno.EIO: "Check the disk.",
}
LACKING = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOSPC, errno.EAGAIN)
"""What the machine has too little of, whatever is asked of it."""

_ABOUT_TARGETS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EEXIST)
_WRONG_PLACE = (errno.EEXIST, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ENOTEMPTY)
# What Python and packages say instead of an error of a class of its own.
_LACKS_MEMORY = (
    "cannot allocate memory",
    "failed to map segment",
    "could not allocate memory",
    "out of memory",
)
# The system gives one reason for both: no more processes, which threads count as, or no room for a stack.
_LACKS_PROCESSES = ("can't start new thread", "resource temporarily unavailable")
# With less room for addresses packages of other people hang or abort while they are loaded, and nobody can tell why.
LEAST_ADDRESSES_MB = 1200


def check_address_space() -> None:
    """Refuse a limit on addresses below which no flight works.

    Raises:
        MachineError: it is as low.
    """
    limit = _address_limit()
    if limit is not None and limit < LEAST_ADDRESSES_MB * 1e6:
        raise MachineError(
            f"the machine: expected room for {LEAST_ADDRESSES_MB} MB of addresses in each process, was a limit of "
            f"{limit / 1e6:.0f} MB. Raise the limit on memory (ulimit -v)."
        )


def _address_limit() -> int | None:
    if sys.platform == "win32":
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def check_working_directory() -> None:
    """Refuse a working directory that was removed, in which no relative path means anything.

    Raises:
        UsageError: it is gone.
    """
    try:
        Path.cwd()
    except FileNotFoundError as error:
        raise UsageError(
            "working directory: expected a folder, was removed since it was entered. Change to one that is there (cd)."
        ) from error


def no_process_error() -> MachineError:
    """Return an error for a person where a process or thread could not be started."""
    if _address_limit() is not None:
        return machine_error(MemoryError(), "the machine", "memory for one thing more")
    return MachineError(
        "the machine: expected room for one more process or thread, was none. Close programs, or raise the limit on "
        "processes (ulimit -u; in a container, that on its tasks)."
    )


def reason_of(error: OSError | MemoryError) -> str:
    """Return what the machine says, as part of a sentence."""
    if isinstance(error, MemoryError) or error.errno == errno.ENOMEM:
        return "out of memory"
    return (error.strerror or str(error) or type(error).__name__).rstrip(".").lower()


def remedy_of(error: OSError | MemoryError) -> str:
    """Return what helps against what the machine says, as a sentence."""
    number = errno.ENOMEM if isinstance(error, MemoryError) else error.errno
    return _REMEDIES.get(number or 0, "Look at what it says, then try again.")


def machine_error(
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
    return MachineError(machine_text(error, place, expected, path=path, remedy=remedy))


def machine_text(
    error: OSError | MemoryError, place: str, expected: str, *, path: Path | str | None = None, remedy: str = ""
) -> str:
    """Return the text of `machine_error`."""
    named = _refused_file(error) if path is None and isinstance(error, OSError) else path
    told = f"{place}: expected {expected}, was {reason_of(error)}. {remedy or remedy_of(error)}"
    return told if named is None else f"{told}\nFile: {os.fspath(named)}"


# Of a link, a copy or a move the machine names what is there already as well.
def _refused_file(error: OSError) -> Path | str | None:
    return error.filename2 if error.filename2 is not None and error.errno in _ABOUT_TARGETS else error.filename


def refused_place(error: OSError, place: str, expected: str, *, path: Path | str) -> GslCosimError:
    """Return an error for a person about a place that the call itself has named.

    Args:
        error: What the machine said.
        place: The option or argument.
        expected: What it should have been.
        path: The file or folder.

    Returns:
        UsageError where another place is all that is needed, MachineError where the machine lacks something.
    """
    text = machine_text(error, place, expected, path=path)
    return UsageError(text) if error.errno in _WRONG_PLACE else MachineError(text)


def unforeseen(error: BaseException) -> MachineError | None:
    """Return an error for a person where the machine has refused something that nobody has foreseen, else None."""
    if isinstance(error, MachineError):
        return error
    if isinstance(error, OSError) and _is_of_kernel_cache(error):
        remedy = "Free room there, or set GSLCOSIM_CACHE to a folder that can be written."
        return machine_error(error, "cache of compiled kernels", "a folder that can be written", remedy=remedy)
    if isinstance(error, BlockingIOError) and error.filename is None:
        return no_process_error()
    if isinstance(error, OSError | MemoryError):
        return machine_error(error, "the machine", "it to do what was asked")
    said = str(error).lower()
    is_of_a_package = isinstance(error, RuntimeError | ImportError | SystemError | ValueError)
    if is_of_a_package and any(word in said for word in _LACKS_PROCESSES):
        return no_process_error()
    if is_of_a_package and any(word in said for word in _LACKS_MEMORY):
        return machine_error(MemoryError(), "the machine", "memory for one thing more")
    return None


# Numba does not say which file it was; what it reads and writes are our functions.
def _is_of_kernel_cache(error: BaseException) -> bool:
    frames = (frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(error.__traceback__))
    return "numba.core.caching" in frames


def fault_text(error: BaseException, trace: str) -> str:
    """Return what to say of an error that ends a run.

    Args:
        error: The error.
        trace: Its traceback, which is told where the error is nobody's but ours.
    """
    if isinstance(error, GslCosimError):
        return str(error)
    refused = unforeseen(error)
    return trace if refused is None else str(refused)
