"""Bubblewrap (`bwrap`): an agent in namespaces of its own, with a file system that holds what its policy names."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from gslcosim.runtime.processes.sandbox.confinement import PIPES_AT
from gslcosim.runtime.processes.sandbox.policy import SYSTEM_FOLDERS, SandboxPolicy

PROBE_TIMEOUT_S = 5.0
SCRATCH_BYTES = 256 << 20
SHARED_MEMORY_BYTES = 64 << 20
_SCRATCH = "/tmp"
HOME = Path(_SCRATCH, "home")
_BASE_OPTIONS = (
    "--unshare-user-try", "--unshare-ipc", "--unshare-pid", "--unshare-uts", "--unshare-cgroup-try",
    "--die-with-parent", "--cap-drop", "ALL", "--proc", "/proc",
    # An agent that runs as root could change settings of the machine there.
    "--ro-bind", "/proc/sys", "/proc/sys", "--dev", "/dev",
    "--size", str(SHARED_MEMORY_BYTES), "--tmpfs", "/dev/shm", "--size", str(SCRATCH_BYTES), "--tmpfs", _SCRATCH,
)  # fmt: skip


@cache
def find_bubblewrap_failure() -> str:
    """Return why bubblewrap does not work here, empty when it works: it is tried once."""
    program = _find_program()
    if sys.platform != "linux" or program is None:
        return "bubblewrap is not installed"
    call = [program, *_BASE_OPTIONS, "--clearenv", "--unshare-net", "--ro-bind", "/usr", "/usr", *_list_system_links()]
    call += ["/usr/bin/env", "true"]
    try:
        tried = subprocess.run(
            call, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=PROBE_TIMEOUT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"bubblewrap does not start: {error}"
    return tried.stderr.strip() or f"bubblewrap ended with exit code {tried.returncode}" if tried.returncode else ""


# A relative entry of PATH would find one in a folder of another user.
def _find_program() -> str | None:
    program = shutil.which("bwrap")
    return program if program is not None and Path(program).is_absolute() else None


def build_bubblewrap_command(
    cell: SandboxPolicy,
    command: Sequence[str],
    *,
    has_pipes: bool,
    arguments: int,
    calls: int | None = None,
) -> list[str]:
    """Return the command line that starts a command in its cell.

    Args:
        has_pipes: Whether its standard input and output come as `launcher.PIPES_AT`, so that bubblewrap, which stays
            beside it, does not keep them open.
        arguments: The descriptor of a file with those of `build_bubblewrap_arguments`.
    """
    places: dict[Path, list[str]] = {}
    for path in cell.reads:
        if path.exists() and not (path.is_symlink() and str(path) in SYSTEM_FOLDERS):
            places[path] = ["--ro-bind", str(path), str(path)]
    empty: list[str] = []
    # Folders around single files are made in the private /tmp where they lie below it, and would be writable.
    for folder in dict.fromkeys(path.parent for path in places if path.is_relative_to(_SCRATCH) and path.is_file()):
        if not any(folder.is_relative_to(path) for path in places):
            places[folder] = ["--tmpfs", str(folder)]
            empty += ["--remount-ro", str(folder)]
    for path in cell.hidden:
        # A link leads to what is hidden in its own place.
        if any(path.is_relative_to(folder) for folder in cell.reads) and path not in places and not path.is_symlink():
            places[path] = ["--tmpfs", str(path)] if path.is_dir() else ["--ro-bind", "/dev/null", str(path)]
            empty += ["--remount-ro", str(path)] if path.is_dir() else []
    for path in (*cell.writes, *cell.sockets):
        places[path] = ["--bind", str(path), str(path)]
    places.setdefault(cell.directory, ["--dir", str(cell.directory)])
    line = [_find_program() or "bwrap", *_BASE_OPTIONS, "--dir", str(HOME), "--args", str(arguments)]
    line += [] if cell.tcp_port is not None else ["--unshare-net"]
    line += [] if calls is None else ["--seccomp", str(calls)]
    line += _list_system_links()
    # Outer folders first: inner ones are mounted upon them.
    for path in sorted(places, key=lambda path: len(path.parts)):
        line += places[path]
    line += [*empty, "--remount-ro", "/", "--remount-ro", "/dev", "--chdir", str(cell.directory), "--"]
    if has_pipes:
        in_, out = PIPES_AT
        line += ["/bin/sh", "-c", f'exec "$@" <&{in_} >&{out} {in_}<&- {out}>&-', "sh"]
    return [*line, *command]


def build_bubblewrap_arguments(variables: Mapping[str, str]) -> list[str]:
    """Return arguments that are no part of the command line, where other users could read them: the variables.

    Args:
        variables: All variables of the process, but for its private folders.
    """
    private = {"HOME": str(HOME), "TMPDIR": _SCRATCH}
    return ["--clearenv", *(word for pair in {**variables, **private}.items() for word in ("--setenv", *pair))]


def _list_system_links() -> list[str]:
    line: list[str] = []
    for folder in SYSTEM_FOLDERS:
        if Path(folder).is_symlink():
            line += ["--symlink", os.readlink(folder), folder]  # noqa: PTH115 - as it stands
    return line
