"""A file as it grows."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

POLL_S = 0.1
_AT_ONCE_BYTES = 1 << 18


def follow(path: Path, is_over: Callable[[], bool]) -> Iterator[bytes]:
    """Yield the bytes of a file from its beginning, and on as it grows, until nobody writes it any more.

    Args:
        path: The file; it may not be there yet. It is read as it was opened, whoever puts another in its place.
        is_over: Whether nobody writes it any more; what was written before is still read.
    """
    was_over = False
    while not path.exists():
        if was_over:
            return
        was_over = is_over()
        time.sleep(0 if was_over else POLL_S)
    was_over = False
    with path.open("rb") as file:
        while True:
            data = file.read(_AT_ONCE_BYTES)
            if data:
                yield data
            elif was_over:
                return
            else:
                was_over = is_over()
                time.sleep(0 if was_over else POLL_S)
