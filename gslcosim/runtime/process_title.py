"""What tools that list processes show of this one."""

import ctypes
import sys
from pathlib import Path

_ARG_START, _ARG_END = 48, 49


def set_process_title(title: str) -> None:
    """Show a command line in place of the one that the process was started with, as far as it fits; Linux only.

    Tools read it from where the kernel has put the program's arguments, so it is overwritten there.
    """
    if sys.platform != "linux":
        return
    try:
        fields = Path("/proc/self/stat").read_text().rsplit(")", 1)[1].split()
        start, end = (int(fields[number - 3]) for number in (_ARG_START, _ARG_END))
    except (OSError, ValueError, IndexError):
        return
    if 0 < start < end:
        words = title.encode().replace(b" ", b"\0")[: end - start - 1]
        ctypes.memmove(start, words.ljust(end - start, b"\0"), end - start)
