"""Processes: command lines of those that end with this one, exit codes in words, and requests to end."""

import os
import shutil
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, NoReturn, Self

_HANGUP = getattr(signal, "SIGHUP", None)
SIGNALS = (signal.SIGINT, signal.SIGTERM, *(() if _HANGUP is None else (_HANGUP,)))
_asked_to_end = threading.Event()


def describe_exit(code: int) -> str:
    """Return a process's exit in words."""
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
    """Return the prefix of a command whose process ends with this one.

    A killed supervisor cannot end its children; Linux can, on a request before the program starts.
    """
    setpriv = shutil.which("setpriv")
    return [setpriv, "--pdeathsig", "KILL"] if sys.platform == "linux" and setpriv else []


def raise_on_signals() -> None:
    """Raise KeyboardInterrupt on each signal that requests an end, as Ctrl-C does; forks have the default handlers.

    A signal that the parent of this process has set to be ignored, as `nohup` does with SIGHUP, stays ignored. Outside
    the main thread nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _raise)
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=_use_defaults)


def is_asked_to_end() -> bool:
    """Return whether `raise_on_signals` has raised; libraries may have replaced or swallowed the exception."""
    return _asked_to_end.is_set()


class Interruption:
    """Context in which a signal that requests an end sets a flag and calls `on_set`; a second one acts as usual.

    A closed terminal causes SIGHUP twice, from the shell and from the system: it is ignored after the first one, and
    from the start if the parent of this process has it ignored, as `nohup` does. Outside the main thread Python cannot
    catch signals, and nothing changes.
    """

    def __init__(self, on_set: Callable[[], None] = lambda: None) -> None:
        self._on_set = on_set
        self._is_set = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            numbers = [n for n in SIGNALS if n != _HANGUP or signal.getsignal(n) != signal.SIG_IGN]
            self._before = {number: signal.signal(number, self._catch) for number in numbers}
        if is_asked_to_end():
            self._is_set = True
            self._on_set()
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    def is_set(self) -> bool:
        """Return whether a signal has come."""
        return self._is_set

    def _catch(self, number: int, frame: FrameType | None) -> None:
        del frame
        self._is_set = True
        if number == _HANGUP:
            self._before.pop(number, None)
            signal.signal(number, signal.SIG_IGN)
        self._restore()
        self._on_set()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()


def _raise(number: int, frame: FrameType | None) -> NoReturn:
    del frame
    _asked_to_end.set()
    if number == _HANGUP:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


# A fork ends at its parent's request, at once.
def _use_defaults() -> None:
    for number in SIGNALS:
        if signal.getsignal(number) is _raise:
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
