"""Capabilities of Linux: a process of root gives up, for itself and its descendants, what root may do.

Without packages of other people, as `landlock`. See `man 7 capabilities`.
"""

import ctypes
import os
import struct

_PR_CAPBSET_DROP, _PR_SET_SECUREBITS = 24, 28
# Being user 0 gives nothing, changing users neither, and none of that can be taken back.
_SECURE_BITS = 0b1110_1111
_VERSION = 0x20080522
_MAX_CAPABILITIES = 64


def give_up_capabilities() -> None:
    """Give up all capabilities; who has none keeps none.

    Raises:
        OSError: the kernel refuses.
    """
    library = ctypes.CDLL(None, use_errno=True)
    # Only who has the right to may do these two, and only there they mean something.
    library.prctl(_PR_SET_SECUREBITS, _SECURE_BITS, 0, 0, 0)
    for capability in range(_MAX_CAPABILITIES):
        library.prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0)
    if library.capset(struct.pack("<Ii", _VERSION, 0), bytes(24)) < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"capabilities: {os.strerror(number)}")
