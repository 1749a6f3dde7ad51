"""Ctrl-C and SIGTERM as a flag that the runtime looks at, so that a run ends in order."""

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, Self

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """Within this context SIGINT and SIGTERM set a flag and call `on_set`; a second signal acts as usual.

    Outside the main thread Python cannot catch signals; then nothing is changed.
    """

    def __init__(self, on_set: Callable[[], None] = lambda: None) -> None:
        self._on_set = on_set
        self._is_set = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._catch) for number in SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    def is_set(self) -> bool:
        """Return whether a signal has come."""
        return self._is_set

    def _catch(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._is_set = True
        self._restore()
        self._on_set()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()
