"""Addresses of unix sockets in folders with long names."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def socket_address(path: Path) -> Iterator[str]:
    """Give the address to bind or connect a unix socket at a path with, however long the path is.

    An address has room for 107 bytes on Linux, where it leads here through the open folder. Elsewhere it is the path.

    Raises:
        OSError: the folder cannot be opened.
    """
    if sys.platform != "linux":
        yield str(path)
        return
    folder = os.open(path.parent, os.O_PATH | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)
