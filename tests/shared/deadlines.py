"""Deadlines that tests need to end at all: generous, for how busy the machine is must decide nothing.

What is to be fast is printed by `make bench`; no test asserts it.
"""

import os
import select

EVENT_S = 180.0  # what is there at once on a machine with nothing else to do: a message, a file, the end of a process
KILLED_S = 20.0  # the end of a process that was killed: shorter than what keeps a process that was left over
PROCESS_S = 300.0  # a command from its start to its end
BUILD_S = 900.0  # a program built from sources, with packages that are fetched first


def has_ended(pid: int) -> bool:
    """Wait until a process that was killed has ended, whoever takes note of it; return whether it has. Linux only."""
    try:
        end = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([end], [], [], EVENT_S)[0])
    finally:
        os.close(end)
