"""Command lines of processes that end with this one, and exit codes in words; imports nothing that is slow."""

import shutil
import signal
import sys


def describe_exit(code: int) -> str:
    """Return in words how a process ended."""
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"was killed by signal {-code}"


def build_python_command(*arguments: str) -> list[str]:
    """Return a command line for this Python, without the working directory on its import path."""
    return [sys.executable, "-P", *arguments]


def build_parent_death_prefix() -> list[str]:
    """Return what precedes a command so that its process ends with this one.

    A supervisor that is killed cannot end its children; Linux can, when asked before the program starts.
    """
    setpriv = shutil.which("setpriv")
    return [setpriv, "--pdeathsig", "KILL"] if sys.platform == "linux" and setpriv else []
