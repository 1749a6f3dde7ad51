"""Start of processes: the one way in which programs of a run and workers are started."""

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import RESOURCE_ERRNOS, UsageError, build_machine_error
from gslcosim.base.processes import build_parent_death_prefix

# Where programs and their libraries are, the user's language and time, private folders, and numbers of threads.
PASSED_ON = frozenset((
    "PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "LANG", "LANGUAGE", "TZ", "HOME", "TMPDIR",
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS", "RAYON_NUM_THREADS", "GOMAXPROCS", "JULIA_NUM_THREADS",
    # Folder of compiled kernels, which an agent without a sandbox shares.
    "GSLCOSIM_CACHE", "XDG_CACHE_HOME",
    # Without these no process starts on Windows.
    "SYSTEMROOT", "PATHEXT", "TEMP", "TMP",
))  # fmt: skip
PASSED_ON_PREFIXES = ("LC_", "NUMBA_")
# Of our own Python: its search for packages, and its output.
_OF_PYTHON = frozenset((
    "PYTHONPATH", "PYTHONHOME", "PYTHONNOUSERSITE", "PYTHONUSERBASE", "PYTHONUNBUFFERED", "PYTHONDONTWRITEBYTECODE",
    "PYTHONUTF8", "PYTHONIOENCODING", "PYTHONHASHSEED",
))  # fmt: skip


def build_short_environment(command: Sequence[str], surroundings: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the initial variables of an agent's or participant's program: only those that every program needs.

    Args:
        command: Its command line; gslcosim's own Python gets Python's variables too.
        surroundings: Variables to choose from; absent: this process's own.
    """
    around = os.environ if surroundings is None else surroundings
    is_ours = bool(command) and command[0] == sys.executable
    return {
        name: value
        for name, value in around.items()
        if name in PASSED_ON or name.startswith(PASSED_ON_PREFIXES) or (is_ours and name in _OF_PYTHON)
    }


@dataclass(frozen=True)
class Streams:
    """Standard streams of a process: descriptors, or constants of `subprocess`; None stands for this process's own."""

    stdin: int | None = subprocess.DEVNULL
    stdout: int | None = subprocess.DEVNULL
    stderr: int | None = subprocess.STDOUT

    @property
    def are_pipes(self) -> bool:
        """True if the process communicates by its standard input and output."""
        return self.stdin == subprocess.PIPE


def spawn(
    name: str,
    command: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    cwd: Path | None = None,
    streams: Streams | None = None,
    inherited: Sequence[int] = (),
    ends_with_parent: bool = True,
) -> "subprocess.Popen[bytes]":
    """Start a program as a process that leads its own session, so that a signal reaches it with its descendants.

    Args:
        name: Name of the process in messages.
        command: Program and arguments.
        environment: All its variables; absent: those of this process.
        cwd: Its working directory; absent: that of this process.
        streams: Its standard streams; absent: no input, and its output is dropped.
        inherited: Descriptors that it inherits; they are closed here in any case.
        ends_with_parent: Whether Linux kills it when the calling thread ends.
    """
    streams = streams or Streams()
    try:
        return subprocess.Popen(
            [*(build_parent_death_prefix() if ends_with_parent else ()), *command],
            bufsize=0,
            stdin=streams.stdin,
            stdout=streams.stdout,
            stderr=streams.stderr,
            env=environment,
            cwd=cwd,
            start_new_session=True,
            pass_fds=tuple(inherited),
        )
    except OSError as error:
        if error.errno in RESOURCE_ERRNOS:
            raise build_machine_error(error, name, "a process that starts") from error
        raise UsageError(f"{name}: expected a command that starts, was {list(command)} ({error}).") from error
    finally:
        for descriptor in inherited:
            os.close(descriptor)


def check_program(name: str, command: Sequence[str], cwd: Path | None) -> None:
    """Refuse a command line whose program does not exist or cannot be executed."""
    program = Path(cwd or ".") / command[0] if "/" in command[0] else shutil.which(command[0])
    if program is None or not os.access(program, os.X_OK) or Path(program).is_dir():
        reason = "no such program" if program is None or not Path(program).exists() else "it cannot be executed"
        raise UsageError(f"{name}: expected a command that starts, was {list(command)} ({reason}).")


def signal_group(pid: int, number: int) -> None:
    """Send a signal to a process that leads its own session, and to all its descendants in it; 0 stands for none."""
    if pid:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(pid, number)


def open_memory_file(data: bytes) -> int:
    """Return the descriptor of a file in memory that only processes inheriting it can read."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("gslcosim", 0)
    else:
        descriptor, path = tempfile.mkstemp()
        Path(path).unlink()
    with os.fdopen(descriptor, "wb", closefd=False) as file:
        file.write(data)
    os.lseek(descriptor, 0, os.SEEK_SET)
    return descriptor
