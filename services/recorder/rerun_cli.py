"""Rerun's command line program, as it comes with the package of this Python environment."""

import importlib.util
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from gslcosim.base.command_lines import build_parent_death_prefix
from gslcosim.base.errors import RecordingError

# Rerun's usage statistics are off wherever this is set, on every platform and without touching the user's settings.
_WITHOUT_ANALYTICS = {"CI": "1"}
_ANALYTICS_SWITCH = "FORCE_RERUN_ANALYTICS"


def rerun_program() -> Path:
    """Return the path of the program.

    Raises:
        RecordingError: the rerun-sdk package of this environment has no program.
    """
    spec = importlib.util.find_spec("rerun_cli")
    folder = Path(spec.origin).parent if spec is not None and spec.origin else Path(sys.prefix)
    program = folder / ("rerun.exe" if sys.platform == "win32" else "rerun")
    if not program.is_file():
        raise RecordingError(
            "rerun: expected the program that comes with the package rerun-sdk, was missing. "
            f"Reinstall it: {sys.executable} -m pip install --force-reinstall rerun-sdk\nFile: {program}"
        )
    return program


def rerun_path(path: Path) -> str:
    """Return a path as Rerun takes it.

    Raises:
        RecordingError: its bytes are no UTF-8.
    """
    try:
        os.fsencode(path).decode()
    except UnicodeDecodeError as error:
        raise RecordingError(
            "recording: expected a path in UTF-8, without which Rerun opens no file, was one in another encoding. "
            f"Rename its folder, or choose another.\nFile: {path}"
        ) from error
    return str(path)


def rerun_environment(extra: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the environment variables for the program: ours, no usage statistics, and `extra`."""
    inherited = {name: value for name, value in os.environ.items() if name != _ANALYTICS_SWITCH}
    return inherited | _WITHOUT_ANALYTICS | dict(extra or {})


def run_rerun(arguments: Sequence[str | Path], *, timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Run the program to its end and return what it wrote.

    Raises:
        RecordingError: it cannot be started, cannot be given a path, or takes longer than `timeout_s`.
    """
    paths = [rerun_path(each) if isinstance(each, Path) else each for each in arguments]
    call = [*build_parent_death_prefix(), str(rerun_program()), *paths]
    try:
        return subprocess.run(
            call,
            capture_output=True,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
            timeout=timeout_s,
            env=rerun_environment(),
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise RecordingError(
            f"rerun {arguments[0]}: expected an end within {timeout_s:g} s, was still running."
        ) from error
    except OSError as error:
        raise RecordingError(f"rerun: expected a program that starts, was {error}.") from error
