"""Keeping a process's secrets from other processes of the same user."""

import ctypes
import sys

_PR_GET_DUMPABLE = 3
_PR_SET_DUMPABLE = 4


def keep_memory_private() -> None:
    """Let no other process of this user read this one's memory or environment, where the run's passwords are.

    Linux only, and not against root; elsewhere nothing is changed. Ends the possibility of core dumps and of attaching
    a debugger.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_DUMPABLE, 0)


def is_memory_private() -> bool:
    """Return whether `keep_memory_private` is in force."""
    return sys.platform == "linux" and ctypes.CDLL(None).prctl(_PR_GET_DUMPABLE) == 0
