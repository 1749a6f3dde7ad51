"""Writing to the terminal: results to stdout, everything else to stderr."""

import contextlib
import json
import os
import sys
from collections.abc import Sequence
from typing import Any, TextIO

from gslcosim.errors import MachineError
from gslcosim.machine import machine_error


def write(text: str = "") -> None:
    """Write a line of the result to stdout.

    Raises:
        MachineError: it cannot be written.
        BrokenPipeError: whoever has read it is gone.
    """
    try:
        sys.stdout.write(f"{text}\n")
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _no_output(error) from error


def finish_output() -> None:
    """Write what waits in stdout's buffer.

    Raises:
        MachineError: it cannot be written.
        BrokenPipeError: whoever has read it is gone.
    """
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _no_output(error) from error


def give_up_output() -> None:
    """Let what waits in stdout's buffer go nowhere: Python would complain once more when it flushes at exit."""
    _give_up(sys.stdout)


def _give_up(stream: TextIO) -> None:
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def open_missing_streams() -> None:
    """Stand in for standard streams that the caller has closed, so that no other file gets their numbers.

    What is written to such a stdout is refused by the machine; what is written to such a stderr is lost.
    """
    # Python's name for a stream that is closed; a new file gets the lowest number that is free.
    missing: Any = None
    if sys.stdin is missing:
        os.open(os.devnull, os.O_RDONLY)
    if sys.stdout is missing:
        sys.stdout = os.fdopen(os.open(os.devnull, os.O_RDONLY), "w", closefd=False)
    if sys.stderr is missing:
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", closefd=False)


def _no_output(error: OSError) -> MachineError:
    remedy = "Send it to a file on a disk with room, or to a terminal."
    return machine_error(error, "standard output", "to take the result", remedy=remedy)


def write_json(content: Any) -> None:
    """Write the result to stdout as JSON."""
    write(json.dumps(content, indent=2, ensure_ascii=False))


def write_note(text: str) -> None:
    """Write a line that is not part of the result to stderr; where that is full or gone, nobody needs it."""
    try:
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()
    except OSError:
        _give_up(sys.stderr)


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return rows as aligned columns under their headings; a pipe gets the same text as a terminal."""
    widths = [max(len(row[i]) for row in (headings, *rows)) for i in range(len(headings))]
    lines = (
        "   ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in (headings, *rows)
    )
    return "\n".join(line.rstrip() for line in lines)


def add_json_option(parser: Any) -> None:
    """Add `--json`, which every command that prints data has."""
    parser.add_argument(
        "--json", action="store_true", help="print the result as JSON on stdout, and nothing else there"
    )
