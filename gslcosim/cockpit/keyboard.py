"""A terminal taken over for a while: single keys in, whole pictures out, and left as it was whatever happens."""

import contextlib
import os
import sys
from collections.abc import Sequence
from typing import Any, Self

from gslcosim.errors import UsageError
from gslcosim.terminal_text import escape_terminal_text

if sys.platform != "win32":
    import termios
    import tty

_SEQUENCES = {
    "\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left",
    "\x1bOA": "up", "\x1bOB": "down", "\x1bOC": "right", "\x1bOD": "left",
    "\x1b[5~": "page_up", "\x1b[6~": "page_down",
}  # fmt: skip
_NAMES = {" ": "space", "\r": "enter", "\n": "enter"}
_ENTER = "\x1b[?1049h\x1b[?25l"
_LEAVE = "\x1b[?25h\x1b[?1049l"


def keys_in(text: str) -> list[str]:
    """Return the keys in what a terminal has sent: names of special ones, others as they are, in lower case."""
    keys: list[str] = []
    at = 0
    while at < len(text):
        special = next((known for known in _SEQUENCES if text.startswith(known, at)), None)
        if special is not None:
            keys.append(_SEQUENCES[special])
        elif text[at] == "\x1b":
            # An escape sequence of another key says nothing here.
            at = _end_of_sequence(text, at)
            continue
        elif text[at] in _NAMES or text[at].isprintable():
            keys.append(_NAMES.get(text[at], text[at].lower()))
        at += len(special or text[at])
    return keys


def _end_of_sequence(text: str, at: int) -> int:
    if at + 1 >= len(text) or text[at + 1] not in "[O":
        return at + 1
    end = at + 2
    while end < len(text) and not ("@" <= text[end] <= "~"):
        end += 1
    return end + 1


def check_terminal(columns: int, rows: int) -> None:
    """Refuse to begin where nobody could see or press anything.

    Args:
        columns: The least width.
        rows: The least height.

    Raises:
        UsageError: standard input or output is no terminal, or it is too small.
    """
    if sys.platform == "win32":
        raise UsageError("fly: expected a terminal of Linux or macOS, this system has none of that kind.")
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise UsageError("fly: expected a terminal as standard input and output, was none. Run it in one.")
    size = os.get_terminal_size(sys.stdout.fileno())
    if size.columns < columns or size.lines < rows:
        raise UsageError(
            f"fly: expected a terminal of at least {columns} columns and {rows} rows, was {size.columns} x "
            f"{size.lines}. Enlarge it, or take a smaller font."
        )


class Keyboard:
    """The terminal of this process within this context. Ctrl-C stays a signal."""

    def __init__(self) -> None:
        self._input = sys.stdin.fileno()
        self._output = sys.stdout.fileno()
        self._before: list[Any] | None = None

    def __enter__(self) -> Self:
        self._before = termios.tcgetattr(self._input)
        tty.setcbreak(self._input)
        self._write(_ENTER)
        return self

    def __exit__(self, *_: object) -> None:
        self._write(_LEAVE)
        if self._before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._input, termios.TCSADRAIN, self._before)

    @property
    def number(self) -> int:
        """The file descriptor to wait for."""
        return self._input

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        size = os.get_terminal_size(self._output)
        return size.columns, size.lines

    def read(self) -> list[str]:
        """Return the keys that were pressed."""
        return keys_in(os.read(self._input, 1024).decode(errors="ignore"))

    def show(self, lines: Sequence[str]) -> None:
        """Draw a picture over the last one."""
        shown = (escape_terminal_text(line, is_one_line=True) for line in lines)
        self._write("\x1b[H" + "\x1b[K\r\n".join(shown) + "\x1b[K\x1b[J")

    def _write(self, text: str) -> None:
        left = text.encode()
        with contextlib.suppress(OSError):
            while left:
                left = left[os.write(self._output, left) :]
