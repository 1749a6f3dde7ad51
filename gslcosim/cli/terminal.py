"""Writing to the terminal: results to stdout, everything else to stderr.

All output of commands goes through here. Foreign text in it (errors of agents, names in files, logs) can neither move
the cursor nor set a title: `escape_terminal_text`.
"""

import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TextIO, cast

from gslcosim.base.errors import build_machine_error
from gslcosim.base.untrusted_input import escape_json_text, escape_terminal_text

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text


def write(text: str = "") -> None:
    """Write a line of the result to stdout."""
    _write_result(f"{escape_terminal_text(text)}\n")


def _write_result(text: str) -> None:
    with _reporting_refusals():
        sys.stdout.write(text)


def finish_output() -> None:
    """Write out stdout's buffer."""
    with _reporting_refusals():
        sys.stdout.flush()


def give_up_output() -> None:
    """Discard stdout's buffer: Python would report the error once more when it flushes at exit."""
    _give_up(sys.stdout)


def _give_up(stream: TextIO) -> None:
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def open_missing_streams() -> None:
    """Replace standard streams that the caller has closed, so that no other file gets their numbers.

    Writing to such a stdout raises an error of the machine; text written to such a stderr is lost.
    """
    # Python's value for a closed stream; a new file gets the lowest free number.
    missing: Any = None
    if sys.stdin is missing:
        os.open(os.devnull, os.O_RDONLY)
    if sys.stdout is missing:
        sys.stdout = os.fdopen(os.open(os.devnull, os.O_RDONLY), "w", closefd=False)
    if sys.stderr is missing:
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", closefd=False)


# The reader of a broken pipe needs no error.
@contextlib.contextmanager
def _reporting_refusals() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        remedy = "Send it to a file on a disk with room, or to a terminal."
        raise build_machine_error(error, "standard output", "to take the result", remedy=remedy) from error


def write_json(content: Any) -> None:
    """Write the result to stdout as JSON."""
    _write_result(f"{escape_json_text(json.dumps(content, indent=2, ensure_ascii=False))}\n")


def write_note(text: str) -> None:
    """Write a line to stderr that is not part of the result; an error of stderr is ignored."""
    _write_to_stderr(f"{escape_terminal_text(text)}\n")


def write_prompt(text: str) -> None:
    """Write a prompt to stderr; the answer follows on the same line."""
    _write_to_stderr(escape_terminal_text(text))


def _write_to_stderr(text: str) -> None:
    try:
        sys.stderr.write(text)
        sys.stderr.flush()
    except OSError:
        _give_up(sys.stderr)


class _GuardedStream:
    # A stream for Rich that handles the machine's errors as for all other output.

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._is_result = stream is sys.stdout

    # Such as `isatty` and `encoding`.
    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> None:
        self._guard(lambda: self._stream.write(text))

    def flush(self) -> None:
        self._guard(self._stream.flush)

    def _guard(self, call: Callable[[], object]) -> None:
        try:
            with _reporting_refusals() if self._is_result else contextlib.nullcontext():
                call()
        except OSError:
            if self._is_result:
                raise
            _give_up(self._stream)


def open_console(stream: TextIO) -> "Console":
    """Return a console for lines and pages that are redrawn on a terminal: stdout or stderr."""
    from rich.console import Console

    return Console(file=cast("TextIO", _GuardedStream(stream)), highlight=False)


def plain_text(text: str, style: str = "") -> "Text":
    """Return text for Rich, in which neither markup (`[red]`) nor control characters have a meaning."""
    from rich.text import Text

    return Text(escape_terminal_text(text, is_one_line=True), style=style)


def escape_library_messages() -> None:
    """Write warnings and log records of libraries, which quote the files they read, as notes."""
    # Commands that only read small files do not import these.
    import logging
    import warnings

    class NoteHandler(logging.Handler):
        """Handler that writes a log record as a note."""

        def emit(self, record: logging.LogRecord) -> None:
            write_note(record.getMessage())

    def write_warning(message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any) -> None:
        write_note(f"{filename}:{lineno}: {category.__name__}: {message}")

    cast("Any", warnings).showwarning = write_warning
    # Python's handler where logging is not configured.
    cast("Any", logging).lastResort = NoteHandler(logging.WARNING)


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return rows as aligned columns under their headings; a pipe gets the same text as a terminal."""
    cells = [[escape_terminal_text(cell, is_one_line=True) for cell in row] for row in (headings, *rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(headings))]
    lines = ("   ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in cells)
    return "\n".join(line.rstrip() for line in lines)


def drawn_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> "Table":
    """Return the table for a redrawn page: cells wrap in their columns, numbers are right-aligned."""
    from rich.table import Table

    drawn = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0), header_style="bold")
    for i, heading in enumerate(headings):
        are_numbers = bool(rows) and all(row[i][:1].isdigit() or row[i] == "-" for row in rows)
        drawn.add_column(heading, justify="right" if are_numbers else "left", overflow="fold")
    for row in rows:
        drawn.add_row(*(plain_text(cell) for cell in row))
    return drawn


def add_json_option(parser: Any) -> None:
    """Add `--json`, which every command that prints data has."""
    parser.add_argument(
        "--json", action="store_true", help="print the result as JSON on stdout, and nothing else there"
    )
