"""Writing to the terminal: results to stdout, everything else to stderr."""

import json
import sys
from collections.abc import Sequence
from typing import Any


def write(text: str = "") -> None:
    """Write a line of the result to stdout."""
    sys.stdout.write(f"{text}\n")


def write_json(content: Any) -> None:
    """Write the result to stdout as JSON."""
    write(json.dumps(content, indent=2, ensure_ascii=False))


def write_note(text: str) -> None:
    """Write a line that is not part of the result to stderr."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


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
